//! What a receiver says of its positions: their sigmas, the same one again, none.

use super::{
    at, clean, codes, drive, errors, findings, folder_with_drive, warning, worst_ratio, write_log,
};
use crate::fixture::{Folder, insnav_json, rewrite};
use insnav_core::earth::Geodetic;
use insnav_core::sample::Sample;
use nalgebra::Vector3;

/// The drive with every stated position sigma changed.
fn stated(change: impl Fn(f64) -> f64) -> Vec<Sample> {
    let mut samples = drive().samples.clone();
    for sample in &mut samples {
        if let Sample::GnssPosition(p) = sample {
            p.covariance_n = p.covariance_n.map(|c| c.map(&change));
        }
    }
    samples
}

#[test]
fn sigmas_that_do_not_match_the_scatter() {
    let folder = Folder::new();
    for (log, code, range) in [
        (
            stated(|v| v * 1e-4),
            "position_sigma_too_small",
            40.0..160.0,
        ),
        (stated(|v| v * 1e2), "position_sigma_too_large", 0.05..0.4),
    ] {
        let name = format!("{code}.mcap");
        write_log(&folder.path(&name), &log);
        let found = findings(&folder, &name, &[]);
        assert_eq!(codes(&found), [code], "{found:#?}");
        let flag = found[0]["flag"].as_str().unwrap();
        let scale: f64 = flag
            .strip_prefix("--set gnss.sigma_scale=")
            .unwrap()
            .parse()
            .unwrap();
        assert!(range.contains(&scale), "{flag}");
        let flags: Vec<&str> = flag.split(' ').collect();
        assert_eq!(codes(&findings(&folder, &name, &flags)), [""; 0]);
        let (spoilt, e) = (
            errors(&folder, &name, &[]).unwrap(),
            errors(&folder, &name, &flags).unwrap(),
        );
        println!("{code}: {spoilt:?} → {e:?}, clean {:?}", clean());
        assert!(e.horizontal_m < 1.5 * clean().horizontal_m + 0.05, "{e:?}");
    }
}

#[test]
fn a_receiver_that_repeats_its_position() {
    let mut samples = drive().samples.clone();
    // The first ten seconds in which it never goes slower than 5 m/s.
    let speed = |t: u32| {
        let start = drive().trajectory.start();
        drive()
            .truth_at(start.plus(f64::from(t)))
            .nav
            .velocity_n
            .norm()
    };
    let begin = (60..220)
        .find(|t| (*t..=t + 10).all(|t| speed(t) > 5.0))
        .expect("a stretch of road");
    let begin = f64::from(begin);
    let mut frozen: Option<Geodetic> = None;
    for sample in &mut samples {
        let t = at(sample);
        if let Sample::GnssPosition(p) = sample
            && (begin..begin + 10.0).contains(&t)
        {
            p.position = *frozen.get_or_insert(p.position);
        }
    }
    let folder = Folder::new();
    write_log(&folder.path("spoilt.mcap"), &samples);
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["gnss_frozen"], "{found:#?}");
    let flag = found[0]["flag"].as_str().unwrap();
    let flags: Vec<&str> = flag.split(' ').collect();
    let (spoilt, mended) = (
        errors(&folder, "spoilt.mcap", &[]).unwrap(),
        errors(&folder, "spoilt.mcap", &flags).unwrap(),
    );
    // Ten seconds without fixes cost what they cost: the same as withholding them from the good log.
    let outage = errors(&folder_with_drive(), "drive.mcap", &flags).unwrap();
    println!("frozen {spoilt:?}, withheld {mended:?}, outage {outage:?}");
    assert!(
        mended.horizontal_m < 1.05 * outage.horizontal_m + 0.01,
        "{mended:?} {outage:?}"
    );
    // And the run with the flag says nothing more of it.
    let log = folder.text("spoilt.mcap");
    let mut arguments = vec!["run", &log, "-o", "-"];
    arguments.truncate(2);
    let out = folder.text("out.mcap");
    arguments.extend(["-o", &out, "--force"]);
    arguments.extend(&flags);
    let json = insnav_json(&arguments).json();
    let warned = json["warnings"].as_array().unwrap();
    assert!(
        warned.iter().all(|w| w["code"] != "gnss_frozen"),
        "{warned:#?}"
    );
}

#[test]
fn fixes_at_zero_and_no_fixes() {
    let folder = Folder::new();
    let mut samples = drive().samples.clone();
    let mut count = 0;
    for sample in &mut samples {
        if let Sample::GnssPosition(p) = sample {
            count += 1;
            if count % 20 == 0 {
                p.position = Geodetic::from_degrees(0.0, 0.0, 0.0);
            }
        }
    }
    write_log(&folder.path("zero.mcap"), &samples);
    let mut count = 0;
    rewrite(
        &folder.path("zero.mcap"),
        &folder.path("spoilt.mcap"),
        |mut m| {
            if m.topic == "/gps/fix" {
                count += 1;
                if count % 20 == 10 {
                    // Encapsulation, stamp, and the frame's name with its length and end: then the status.
                    let name = u32::from_le_bytes(m.data[12..16].try_into().unwrap()) as usize;
                    m.data[16 + name] = -1_i8 as u8;
                }
            }
            vec![m]
        },
    );
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["no_fix", "zero_position"], "{found:#?}");
    let e = errors(&folder, "spoilt.mcap", &[]).unwrap();
    assert!(worst_ratio(&e) < 1.3, "{e:?} {:?}", clean());
    let out = folder.text("o.mcap");
    let json = insnav_json(["run", &folder.text("spoilt.mcap"), "-o", &out]).json();
    assert!(warning(&json, "zero_position").contains("latitude and longitude zero"));
    assert!(warning(&json, "no_fix").contains("no fix"));
}

/// The drive with every position made another.
fn placed(change: impl Fn(f64, f64) -> (f64, f64)) -> Vec<Sample> {
    let mut samples = drive().samples.clone();
    for sample in &mut samples {
        if let Sample::GnssPosition(p) = sample {
            let at = &p.position;
            let (latitude, longitude) = change(at.latitude.to_degrees(), at.longitude.to_degrees());
            p.position = Geodetic::from_degrees(latitude, longitude, at.height);
        }
    }
    samples
}

/// Such positions were taken for accelerometers that are upside down, since they move in mirror images.
#[test]
fn positions_in_radians_or_the_other_way_round() {
    let folder = Folder::new();
    for (log, code, words) in [
        (
            placed(|a, b| (a.to_radians(), b.to_radians())),
            "positions_in_radians",
            "in radians, not in degrees",
        ),
        (
            placed(|a, b| (b, a)),
            "positions_swapped",
            "longitude and latitude, not latitude and longitude",
        ),
    ] {
        let name = format!("{code}.mcap");
        write_log(&folder.path(&name), &log);
        let found = findings(&folder, &name, &[]);
        assert_eq!(codes(&found)[0], code, "{found:#?}");
        assert!(found[0]["evidence"].as_str().unwrap().contains(words));
        assert_eq!(errors(&folder, &name, &[]).unwrap_err(), code);
    }
}

/// At the zeros of latitude and longitude a velocity east before north looks the same: nobody is told that the positions are wrong.
#[test]
fn a_velocity_east_before_north_is_not_taken_for_positions_the_other_way_round() {
    let folder = Folder::new();
    let first = drive().samples.iter().find_map(|sample| match sample {
        Sample::GnssPosition(p) => Some(p.position),
        _ => None,
    });
    let (a0, b0) = first.map_or((0.0, 0.0), |p| {
        (p.latitude.to_degrees(), p.longitude.to_degrees())
    });
    for (latitude, longitude) in [(5.5, -0.2), (a0, b0)] {
        let wider = a0.to_radians().cos() / f64::to_radians(latitude).cos();
        let mut samples = placed(|a, b| (latitude + a - a0, longitude + (b - b0) * wider));
        for sample in &mut samples {
            if let Sample::GnssVelocity(v) = sample {
                v.velocity_n = Vector3::new(v.velocity_n.y, v.velocity_n.x, -v.velocity_n.z);
            }
        }
        let name = format!("{latitude}.mcap");
        write_log(&folder.path(&name), &samples);
        let found = findings(&folder, &name, &[]);
        let severity = |code: &str| {
            let told = found.iter().find(|f| f["code"] == code);
            told.map(|f| f["severity"].as_str().unwrap_or_default().to_owned())
        };
        assert!(severity("velocity_axes").is_some(), "{found:#?}");
        assert_ne!(
            severity("positions_swapped").as_deref(),
            Some("fatal"),
            "{found:#?}"
        );
    }
}

/// Latitudes beyond 90°: every fix is dropped, and `info` says what they seem to be.
#[test]
fn positions_that_are_no_place() {
    let folder = Folder::new();
    write_log(
        &folder.path("spoilt.mcap"),
        &placed(|latitude, longitude| (longitude + 100.0, latitude)),
    );
    let found = findings(&folder, "spoilt.mcap", &[]);
    let told = found.iter().find(|f| f["code"] == "no_place");
    let told = told.unwrap_or_else(|| panic!("{found:#?}"));
    let evidence = told["evidence"].as_str().unwrap();
    assert!(evidence.contains("are no place on Earth, the first latitude 1"));
    assert!(evidence.contains("the other way round: latitude comes first"));
    assert_eq!(
        errors(&folder, "spoilt.mcap", &[]).unwrap_err(),
        "no_gnss_samples"
    );
}
