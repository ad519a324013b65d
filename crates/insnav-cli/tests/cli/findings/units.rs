//! Units, scales and signs of inertial data.

use super::{G, Without, codes, drive, errors, findings, imu, mended, worst_ratio, write_log};
use crate::fixture::{Folder, Raw, rewrite};
use insnav_core::sample::Sample;
use nalgebra::Vector3;
use serde_json::Value;

#[test]
fn accelerations_in_g() {
    mended(
        &imu(|_, f| *f /= G),
        &["imu_in_g"],
        "--imu-units=g,rad/s",
        &Without::Refused,
    );
}

#[test]
fn rates_in_degrees() {
    let log = imu(|w, _| *w *= 1f64.to_degrees());
    mended(
        &log,
        &["imu_in_deg_per_s"],
        "--imu-units=m/s2,deg/s",
        &Without::Refused,
    );
}

/// One argument mends both: each finding names it.
#[test]
fn both_units() {
    let log = imu(|w, f| {
        *f /= G;
        *w *= 1f64.to_degrees();
    });
    let both = ["imu_in_g", "imu_in_deg_per_s"];
    mended(&log, &both, "--imu-units=g,deg/s", &Without::Refused);
}

#[test]
fn counts_for_accelerations() {
    // 2048 counts per g, as ±16 g in 16 bits.
    let log = imu(|_, f| *f *= 2048.0 / G);
    let folder = Folder::new();
    write_log(&folder.path("spoilt.mcap"), &log);
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["imu_force_scale"]);
    let flag = found[0]["flag"].as_str().unwrap();
    let factor: f64 = flag
        .strip_prefix("--imu-units=")
        .and_then(|t| t.strip_suffix("m/s2,rad/s"))
        .unwrap_or_else(|| panic!("{flag}"))
        .parse()
        .unwrap();
    // The bias of a consumer unit is some per cent of gravity.
    assert!((factor / (G / 2048.0) - 1.0).abs() < 0.03, "{factor}");
    assert_eq!(
        errors(&folder, "spoilt.mcap", &[]).unwrap_err(),
        "imu_force_scale"
    );
    // A scale from gravity in motion is good to a per cent: the run is one, if not as good as with the data sheet's.
    assert!(errors(&folder, "spoilt.mcap", &[flag]).is_ok());
    assert_eq!(codes(&findings(&folder, "spoilt.mcap", &[flag])), [""; 0]);
}

#[test]
fn increments_for_rates() {
    let log = imu(|w, f| {
        *f *= 0.01;
        *w *= 0.01;
    });
    mended(
        &log,
        &["imu_increments"],
        "--imu-units=m/s,rad",
        &Without::Refused,
    );
}

#[test]
fn gravity_taken_out() {
    let truth = drive();
    let mut samples = truth.samples.clone();
    for sample in &mut samples {
        if let Sample::Imu(s) = sample {
            let q_nb = truth.truth_at(s.time).nav.q_nb;
            s.specific_force_b += q_nb.inverse_transform_vector(&Vector3::new(0.0, 0.0, 9.81));
        }
    }
    let folder = Folder::new();
    write_log(&folder.path("spoilt.mcap"), &samples);
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["gravity_removed"], "{found:#?}");
    assert_eq!(found[0]["flag"], Value::Null);
    assert!(
        found[0]["remedy"]
            .as_str()
            .unwrap()
            .contains("raw acceleration")
    );
    assert_eq!(
        errors(&folder, "spoilt.mcap", &[]).unwrap_err(),
        "gravity_removed"
    );
    // Where the raw topic is recorded too, it is named.
    write_log(&folder.path("raw.mcap"), &truth.samples);
    let mut raw = Vec::new();
    rewrite(&folder.path("raw.mcap"), &folder.path("copy.mcap"), |m| {
        raw.push((m.topic.clone(), m.log_time, m.data.clone()));
        vec![m]
    });
    let mut raw = raw.into_iter().filter(|m| m.0 == "/imu/data");
    rewrite(
        &folder.path("spoilt.mcap"),
        &folder.path("both.mcap"),
        |m| {
            if m.topic != "/imu/data" {
                return vec![m];
            }
            let (_, log_time, data) = raw.next().expect("as many");
            let topic = "/imu/raw".into();
            vec![
                m,
                Raw {
                    topic,
                    log_time,
                    data,
                },
            ]
        },
    );
    let found = findings(&folder, "both.mcap", &["--topic", "imu=/imu/data"]);
    assert_eq!(codes(&found), ["gravity_removed"]);
    assert_eq!(found[0]["flag"], "--topic imu=/imu/raw");
    let e = errors(&folder, "both.mcap", &["--topic", "imu=/imu/raw"]).unwrap();
    assert!(worst_ratio(&e) < 1.2, "{e:?}");
}

#[test]
fn accelerometers_that_give_gravity() {
    let log = imu(|_, f| *f = -*f);
    mended(
        &log,
        &["imu_force_sign"],
        "--imu-units=-1m/s2,rad/s",
        &Without::Refused,
    );
}

#[test]
fn gyros_of_the_wrong_sign() {
    let log = imu(|w, _| *w = -*w);
    mended(
        &log,
        &["imu_rate_sign"],
        "--imu-units=m/s2,-1rad/s",
        &Without::Refused,
    );
}
