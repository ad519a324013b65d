//! Between tables and logs.

use crate::fixture::{Folder, insnav, insnav_json};
use insnav_log::csv::{read_gnss, read_imu};

const IMU: &str = "t_s,gx,gy,gz,ax,ay,az\n0.0,0.01,0.02,0.03,0.1,0.2,-9.8\n0.01,0.011,0.021,0.031,0.11,0.21,-9.81\n";
const GNSS: &str = "t_s,lat_deg,lon_deg,h_m,vn,ve,vd,sn,se,sd,svn,sve,svd,fix\n\
                    -0.1,59.1,18.2,30.5,1.0,2.0,0.1,0.5,0.6,0.7,0.05,0.06,0.07,3\n";

#[test]
fn tables_to_a_log_and_back() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("tables")).unwrap();
    std::fs::write(folder.path("tables/imu.csv"), IMU).unwrap();
    std::fs::write(folder.path("tables/gnss.csv"), GNSS).unwrap();
    let done = insnav_json([
        "convert",
        &folder.text("tables"),
        "-o",
        &folder.text("drive.mcap"),
    ]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert_eq!(done.json()["imu_samples"], 2);
    // What has no place in messages is said.
    assert_eq!(done.json()["ignored"], serde_json::json!(["fix"]));
    let done = insnav_json([
        "convert",
        &folder.text("drive.mcap"),
        "-o",
        &folder.text("back"),
    ]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let (before, after) = (
        read_imu(&folder.path("tables/imu.csv")).unwrap(),
        read_imu(&folder.path("back/imu.csv.gz")).unwrap(),
    );
    assert_eq!(before.angular_rate, after.angular_rate);
    assert_eq!(before.specific_force, after.specific_force);
    let (before, after) = (
        read_gnss(&folder.path("tables/gnss.csv")).unwrap(),
        read_gnss(&folder.path("back/gnss.csv.gz")).unwrap(),
    );
    assert_eq!(
        after.t_s,
        [-0.1],
        "seconds count from the same instant again"
    );
    // Degrees are written and radians kept: the last digit may differ.
    assert!(before.position[0].offset_to(&after.position[0]).norm() < 1e-7);
    assert_eq!(before.velocity_n, after.velocity_n);
    assert!((before.position_sigma_n[0] - after.position_sigma_n[0]).norm() < 1e-12);
}

#[test]
fn other_axes_of_the_table_are_another_log() {
    let folder = Folder::new();
    std::fs::write(folder.path("imu.csv"), IMU).unwrap();
    let (imu, log) = (folder.text("imu.csv"), folder.text("drive.mcap"));
    assert_eq!(
        insnav(["convert", &imu, "-o", &log, "--axes", "flu"]).code,
        0
    );
    assert_eq!(
        insnav(["convert", &log, "-o", &folder.text("back")]).code,
        0
    );
    let after = read_imu(&folder.path("back/imu.csv.gz")).unwrap();
    assert_eq!(
        after.specific_force[0],
        nalgebra::Vector3::new(0.1, -0.2, 9.8),
        "FLU read, FRD written"
    );
}

#[test]
fn wrong_endings_are_usage_errors() {
    let folder = Folder::with_drive();
    std::fs::write(folder.path("imu.csv"), IMU).unwrap();
    insnav_json([
        "convert",
        &folder.text("imu.csv"),
        "-o",
        &folder.text("x.tum"),
    ])
    .failed(2, "usage");
    insnav_json([
        "convert",
        &folder.text("drive.mcap"),
        "-o",
        &folder.text("x.tum"),
    ])
    .failed(2, "usage");
    std::fs::write(
        folder.path("bad.csv"),
        "t_s,gx,gy,gz,ax,ay,az\n0,1,2,3,4,five,6\n",
    )
    .unwrap();
    let (message, _) = insnav_json([
        "convert",
        &folder.text("bad.csv"),
        "-o",
        &folder.text("x.mcap"),
    ])
    .failed(1, "bad_cell");
    assert!(
        message.contains("bad.csv:2") && message.contains("ay"),
        "{message}"
    );
    assert!(!folder.path("x.mcap").exists());
}
