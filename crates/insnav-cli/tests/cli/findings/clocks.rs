//! Stamps: late, stepping, of another time scale, missing, twice.

use super::{
    Without, clean, codes, drive, errors, findings, folder_with_drive, mended, worst_ratio,
};
use crate::fixture::{Raw, rewrite, shift_stamp};

#[test]
fn a_clock_that_is_late() {
    let mut samples = drive().samples.clone();
    for sample in &mut samples {
        if sample.is_inertial() {
            *sample = sample.delayed(0.2);
        }
    }
    mended(
        &samples,
        &["time_offset"],
        "--time-offset auto",
        &Without::Worse(1.5),
    );
}

/// Half of the inertial stamps a second ahead of the recorder's clock.
#[test]
fn a_clock_that_steps() {
    let folder = folder_with_drive();
    for (step, worse) in [(1, Without::Worse(1.5)), (-1, Without::Worse(1.5))] {
        let mut count = 0;
        rewrite(
            &folder.path("drive.mcap"),
            &folder.path("spoilt.mcap"),
            |mut m| {
                count += usize::from(m.topic == "/imu/data");
                if m.topic == "/imu/data" && count > 12_000 {
                    shift_stamp(&mut m.data, step);
                }
                vec![m]
            },
        );
        let found = findings(&folder, "spoilt.mcap", &[]);
        let first = found.iter().find(|f| f["code"] == "clock_step");
        let first = first.unwrap_or_else(|| panic!("{found:#?}"));
        assert_eq!(first["flag"], "--time log");
        let evidence = first["evidence"].as_str().unwrap();
        assert!(
            evidence.contains(&format!("{step:+}.00 s")) && evidence.contains("120.0 s"),
            "{evidence}"
        );
        match (errors(&folder, "spoilt.mcap", &[]), &worse) {
            // Back by a second: within the window at its edge, or refused by name.
            (Err(code), _) => assert_eq!(code, "backward_stamps"),
            (Ok(e), Without::Worse(factor)) => assert!(worst_ratio(&e) > *factor, "{e:?}"),
            (Ok(e), Without::Refused) => panic!("{e:?}"),
        }
        assert_eq!(
            codes(&findings(&folder, "spoilt.mcap", &["--time", "log"])),
            [""; 0]
        );
        let e = errors(&folder, "spoilt.mcap", &["--time", "log"]).unwrap();
        assert!(worst_ratio(&e) < 1.2, "{e:?} {:?}", clean());
    }
}

#[test]
fn a_receiver_on_gps_time() {
    let folder = folder_with_drive();
    rewrite(
        &folder.path("drive.mcap"),
        &folder.path("spoilt.mcap"),
        |mut m| {
            if m.topic.starts_with("/gps") {
                shift_stamp(&mut m.data, 18);
            }
            vec![m]
        },
    );
    let found = findings(&folder, "spoilt.mcap", &[]);
    let first = found.iter().find(|f| f["code"] == "different_clocks");
    let first = first.unwrap_or_else(|| panic!("{found:#?}"));
    assert!(
        first["evidence"].as_str().unwrap().contains("GPS time"),
        "{first}"
    );
    assert_eq!(first["flag"], "--time log");
    let e = errors(&folder, "spoilt.mcap", &[]);
    assert!(e.as_ref().map_or(true, |e| worst_ratio(e) > 3.0), "{e:?}");
    let e = errors(&folder, "spoilt.mcap", &["--time", "log"]).unwrap();
    assert!(worst_ratio(&e) < 1.2, "{e:?}");
}

#[test]
fn stamps_of_zero() {
    let folder = folder_with_drive();
    let zero = |data: &mut [u8]| data[4..12].fill(0);
    rewrite(
        &folder.path("drive.mcap"),
        &folder.path("spoilt.mcap"),
        |mut m| {
            if m.topic == "/imu/data" {
                zero(&mut m.data);
            }
            vec![m]
        },
    );
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["unstamped"], "{found:#?}");
    assert!(
        found[0]["evidence"]
            .as_str()
            .unwrap()
            .contains("24001 of 24001")
    );
    assert_eq!(found[0]["flag"], "--time log");
    // The recorder's time is that of the sensor here: nothing is lost by it.
    let e = errors(&folder, "spoilt.mcap", &[]).unwrap();
    assert!(worst_ratio(&e) < 1.2, "{e:?}");
}

#[test]
fn duplicates() {
    let folder = folder_with_drive();
    let mut count = 0;
    rewrite(
        &folder.path("drive.mcap"),
        &folder.path("spoilt.mcap"),
        |m| {
            count += 1;
            let again = Raw {
                topic: m.topic.clone(),
                log_time: m.log_time,
                data: m.data.clone(),
            };
            if m.topic == "/imu/data" && count % 50 == 0 {
                vec![m, again]
            } else {
                vec![m]
            }
        },
    );
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["duplicate_stamps"], "{found:#?}");
    let e = errors(&folder, "spoilt.mcap", &[]).unwrap();
    assert!(worst_ratio(&e) < 1.05, "{e:?}");
}
