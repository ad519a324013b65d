//! What a log holds.

use crate::fixture::{Folder, drive, insnav, insnav_json, write_log};
use insnav_core::sample::Sample;

#[test]
fn topics_roles_and_what_run_would_do() {
    let folder = Folder::with_drive();
    let done = insnav_json(["info", &folder.text("drive.mcap")]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    let topic = |name: &str| {
        json["topics"]
            .as_array()
            .unwrap()
            .iter()
            .find(|t| t["name"] == name)
            .cloned()
            .expect("listed")
    };
    let imu = topic("/imu/data");
    assert_eq!(
        (imu["role"].as_str(), imu["count"].as_u64()),
        (Some("imu"), Some(12_001))
    );
    assert!((imu["rate_hz"].as_f64().unwrap() - 100.0).abs() < 0.1);
    assert_eq!(topic("/gps/vel")["role"], "gnss-velocity");
    assert_eq!(
        json["run"]["gnss_positions"],
        json["run"]["gnss_velocities"]
    );
    assert!(json["run"]["config"].as_str().unwrap().contains("[gnss]"));
    assert_eq!(json["problem"], serde_json::Value::Null);
    let text = insnav(["info", &folder.text("drive.mcap")]).stdout;
    assert!(
        text.contains("/imu/data") && text.contains("100.0 Hz"),
        "{text}"
    );
}

/// The settings that `info` prints are a file that `run` takes.
#[test]
fn the_printed_settings_can_be_used() {
    let folder = Folder::with_drive();
    let json = insnav_json(["info", &folder.text("drive.mcap")]).json();
    std::fs::write(
        folder.path("car.toml"),
        json["run"]["config"].as_str().unwrap(),
    )
    .unwrap();
    let done = insnav_json([
        "run",
        &folder.text("drive.mcap"),
        "-c",
        &folder.text("car.toml"),
    ]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert_eq!(done.json()["config"], json["run"]["config"]);
}

#[test]
fn a_log_that_cannot_be_run_is_still_shown() {
    let folder = Folder::new();
    let samples: Vec<Sample> = drive()
        .samples
        .iter()
        .copied()
        .filter(|s| !s.is_inertial())
        .collect();
    write_log(&folder.path("drive.mcap"), &samples);
    let done = insnav_json(["info", &folder.text("drive.mcap")]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    assert_eq!(json["problem"]["code"], "no_imu_topic");
    assert_eq!(json["run"], serde_json::Value::Null);
    assert!(json["topics"].as_array().unwrap().len() >= 2);
    assert_eq!(
        insnav(["info", &folder.text("drive.mcap"), "--strict"]).code,
        3
    );
}
