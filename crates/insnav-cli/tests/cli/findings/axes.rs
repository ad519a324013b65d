//! Axes, mountings, and what velocities are given in.

use super::{Without, codes, findings, folder_with_drive, imu, mended, velocity, write_log};
use crate::fixture::Folder;
use insnav_core::sample::Sample;
use nalgebra::{Matrix3, Rotation3, Vector3};

#[test]
fn forward_right_down_declared_as_forward_left_up() {
    let turned = Vector3::new(1.0, -1.0, -1.0);
    let log = imu(|w, f| {
        w.component_mul_assign(&turned);
        f.component_mul_assign(&turned);
    });
    // Only where roll is counted from, but lever arm and attitude are wrong by half a turn.
    mended(&log, &["imu_axes"], "--imu-axes frd", &Without::Worse(50.0));
    // And the reverse.
    let folder = folder_with_drive();
    let found = findings(&folder, "drive.mcap", &["--imu-axes", "frd"]);
    assert_eq!(codes(&found), ["imu_axes"]);
    assert_eq!(found[0]["flag"], "--imu-axes flu");
}

/// `v_imu = Rᵀ v_body` for a mounting of these angles in forward-left-up.
fn mounted(roll: f64, pitch: f64, yaw: f64) -> Vec<Sample> {
    let flu = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    let r = Rotation3::from_euler_angles(roll.to_radians(), pitch.to_radians(), yaw.to_radians());
    let m = flu * r.matrix().transpose() * flu;
    imu(|w, f| {
        *w = m * *w;
        *f = m * *f;
    })
}

#[test]
fn mountings_of_right_angles() {
    // As on the husky.
    let flag = "--imu-mounting-deg roll=90,yaw=-90";
    mended(
        &mounted(90.0, 0.0, -90.0),
        &["imu_mounting"],
        flag,
        &Without::Worse(20.0),
    );
    let flag = "--imu-mounting-deg yaw=180";
    mended(
        &mounted(0.0, 0.0, 180.0),
        &["imu_mounting"],
        flag,
        &Without::Worse(20.0),
    );
}

#[test]
fn a_mounting_of_any_angles() {
    let folder = Folder::new();
    write_log(&folder.path("spoilt.mcap"), &mounted(0.0, 0.0, 40.0));
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["imu_mounting"], "{found:#?}");
    let flag = found[0]["flag"].as_str().unwrap();
    let yaw: f64 = flag.rsplit("yaw=").next().unwrap().parse().unwrap();
    assert!((yaw - 40.0).abs() < 6.0, "{flag}");
    let flags: Vec<&str> = flag.split(' ').collect();
    assert_eq!(codes(&findings(&folder, "spoilt.mcap", &flags)), [""; 0]);
}

#[test]
fn velocity_in_other_axes() {
    // Written as east, north, up: these come out as north, east, down; as north, west, up; as east, north, down.
    let ned = velocity(|v| *v = Vector3::new(v.y, v.x, -v.z));
    mended(
        &ned,
        &["velocity_axes"],
        "--gnss-velocity-axes ned",
        &Without::Worse(1.5),
    );
    let nwu = velocity(|v| *v = Vector3::new(-v.y, v.x, v.z));
    mended(
        &nwu,
        &["velocity_axes"],
        "--gnss-velocity-axes nwu",
        &Without::Worse(1.5),
    );
}

#[test]
fn velocity_that_is_no_use() {
    let along = velocity(|v| *v = Vector3::new(0.0, v.xy().norm(), 0.0));
    let folder = Folder::new();
    write_log(&folder.path("spoilt.mcap"), &along);
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert!(
        codes(&found).contains(&"velocity_in_body_axes"),
        "{found:#?}"
    );
    let knots = velocity(|v| *v *= 1.943_844);
    write_log(&folder.path("knots.mcap"), &knots);
    let found = findings(&folder, "knots.mcap", &[]);
    assert_eq!(codes(&found), ["velocity_scale"], "{found:#?}");
    assert!(found[0]["evidence"].as_str().unwrap().contains("knots"));
    let left = findings(&folder, "knots.mcap", &["--topic", "gnss-velocity=none"]);
    assert_eq!(codes(&left), ["no_gnss_velocity"]);
}
