//! Magnetometers of tables, and orientations against quaternions.

use crate::fixture::{Folder, insnav, insnav_json};
use insnav_log::csv::read_imu;
use nalgebra::{UnitQuaternion, Vector3};
use std::fmt::Write as _;

/// A second at rest at 100 Hz, sensor axes forward-left-up, with a field of so many microtesla along z, and where a benchmark scores.
fn imu_table(field_z: f64) -> String {
    let mut text = String::from("t_s,gx,gy,gz,ax,ay,az,mx,my,mz,moving\n");
    for i in 0..100 {
        let t = f64::from(i) * 0.01;
        writeln!(
            text,
            "{t},0.01,0.02,0.03,0.1,0.2,9.8,{},0.5,{field_z},0",
            0.1 * f64::from(i)
        )
        .unwrap();
    }
    text
}

#[test]
fn a_magnetometer_of_a_table_goes_into_the_log_and_back() {
    let folder = Folder::new();
    std::fs::write(folder.path("imu.csv"), imu_table(-41.5)).unwrap();
    let (table, log) = (folder.text("imu.csv"), folder.text("a.mcap"));
    let done = insnav_json(["convert", &table, "-o", &log, "--axes", "flu"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    assert_eq!(json["magnetic_fields"], 100);
    // Where a benchmark scores is no measurement.
    assert_eq!(json["ignored"], serde_json::json!(["moving"]));
    assert_eq!(json["warnings"], serde_json::json!([]));
    let info = insnav_json(["info", &log]).json();
    let topics = info["topics"].as_array().unwrap();
    let magnetic = topics.iter().find(|t| t["name"] == "/imu/mag").unwrap();
    assert_eq!(magnetic["count"], 100, "{magnetic}");
    assert_eq!(magnetic["schema"], "sensor_msgs/msg/MagneticField");
    assert!(insnav(["info", &log]).stdout.contains("/imu/mag"));
    // Back as forward-right-down.
    let done = insnav(["convert", &log, "-o", &folder.text("back")]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let (before, after) = (
        read_imu(&folder.path("imu.csv")).unwrap(),
        read_imu(&folder.path("back/imu.csv.gz")).unwrap(),
    );
    assert_eq!(after.magnetic_field.len(), 100);
    for (a, b) in before.magnetic_field.iter().zip(&after.magnetic_field) {
        // To tesla and back in double precision.
        assert!(
            (Vector3::new(a.x, -a.y, -a.z) - b).norm() < 1e-12,
            "{a} {b}"
        );
    }
}

#[test]
fn a_normalised_field_is_told() {
    let folder = Folder::new();
    std::fs::write(
        folder.path("imu.csv"),
        imu_table(-0.9).replace(",0.5,", ",0.0,"),
    )
    .unwrap();
    // The field grows from 0.9 to 9.9: the mean is neither 1 nor the Earth's.
    let (table, log) = (folder.text("imu.csv"), folder.text("a.mcap"));
    let done = insnav_json(["convert", &table, "-o", &log, "--axes", "flu"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let warnings = &done.json()["warnings"];
    assert_eq!(warnings[0]["code"], "magnetic_units", "{warnings}");
    assert!(
        !warnings[0]["message"]
            .as_str()
            .unwrap()
            .contains("normalised")
    );
    let mut normalised = String::from("t_s,gx,gy,gz,ax,ay,az,mx,my,mz\n");
    for i in 0..50 {
        writeln!(
            normalised,
            "{},0,0,0,0,0,9.8,0.6,0,-0.8",
            0.01 * f64::from(i)
        )
        .unwrap();
    }
    std::fs::write(folder.path("imu.csv"), normalised).unwrap();
    let done = insnav_json(["convert", &table, "-o", &log, "--force"]);
    let message = done.json()["warnings"][0]["message"].clone();
    assert!(
        message.as_str().unwrap().contains("normalised to 1"),
        "{message}"
    );
    assert_eq!(done.json()["magnetic_fields"], 50, "written all the same");
}

/// The sensor turns about a tilted axis: its orientation in ENU at an instant.
fn truth(t: f64) -> UnitQuaternion<f64> {
    let axis = nalgebra::Unit::new_normalize(Vector3::new(0.3, -0.2, 1.0));
    UnitQuaternion::from_axis_angle(&axis, 0.9 * t)
        * UnitQuaternion::from_euler_angles(0.2, 0.1, 0.5)
}

fn row(t: f64, q: &UnitQuaternion<f64>, rest: &str) -> String {
    format!("{t},{},{},{},{}{rest}\n", q.w, q.i, q.j, q.k)
}

/// Ten seconds at 50 Hz; the truth lacks three rows and does not score its first second. The solution is off by `heading_deg` and
/// `inclination_deg`, at its own 40 Hz and from 0.5 s on, and states `sigma_deg` of each.
fn write_trial(
    folder: &Folder,
    (solution, reference): (&str, &str),
    [heading_deg, inclination_deg, sigma_deg]: [f64; 3],
) {
    let mut text = String::from("t_s,qw,qx,qy,qz,moving\n");
    for i in 0..=500 {
        let t = 0.02 * f64::from(i);
        if (200..203).contains(&i) {
            writeln!(text, "{t},nan,nan,nan,nan,1").unwrap();
        } else {
            text.push_str(&row(t, &truth(t), if t < 1.0 { ",0" } else { ",1" }));
        }
    }
    std::fs::write(folder.path(reference), text).unwrap();
    let error = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading_deg.to_radians())
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), inclination_deg.to_radians());
    let mut text = String::from(
        "t_s,qw,qx,qy,qz,sigma_rotation_north_deg,sigma_rotation_east_deg,sigma_heading_deg\n",
    );
    for i in 20..=420 {
        let t = 0.025 * f64::from(i);
        let sigmas = format!(",{sigma_deg},{sigma_deg},{sigma_deg}");
        text.push_str(&row(t, &(error * truth(t)), &sigmas));
    }
    std::fs::write(folder.path(solution), text).unwrap();
}

#[test]
fn quaternions_are_scored_as_the_benchmark_does() {
    let folder = Folder::new();
    write_trial(&folder, ("a.csv", "truth_quat.csv"), [3.0, 1.0, 5.0]);
    let (solution, reference) = (folder.text("a.csv"), folder.text("truth_quat.csv"));
    let done = insnav_json(["compare", &solution, &reference]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    let number = |key: &str| {
        json[key]
            .as_f64()
            .unwrap_or_else(|| panic!("{key}: {json:#}"))
    };
    // 451 instants from 1 s on without the three of no truth; the turn is at a constant rate, so that interpolation is exact.
    assert_eq!(json["orientation_count"], 448, "{json:#}");
    assert!((number("heading_rmse_deg") - 3.0).abs() < 1e-6);
    assert!((number("inclination_rmse_deg") - 1.0).abs() < 1e-6);
    let half = |deg: f64| (deg / 2.0).to_radians();
    let total = 2.0 * (half(3.0).cos() * half(1.0).cos()).acos().to_degrees();
    assert!((number("total_rmse_deg") - total).abs() < 1e-6);
    // 3.16° of error are inside the ellipsoid of 5° times 2.8, and outside that of 1° times 2.8.
    assert_eq!(number("coverage_95"), 1.0);
    write_trial(&folder, ("a.csv", "truth_quat.csv"), [3.0, 1.0, 1.0]);
    let done = insnav_json([
        "compare",
        &solution,
        &reference,
        "--max",
        "total_rmse_deg=3",
    ]);
    assert_eq!(
        (done.code, done.json()["coverage_95"].as_f64()),
        (1, Some(0.0))
    );
    let text = insnav(["compare", &solution, &reference]).stdout;
    assert!(text.contains("heading 3.00°, inclination 1.000°"), "{text}");
    // Without the column, and without sigmas: all that is valid is scored.
    let strip = |name: &str, columns: usize| {
        let text = std::fs::read_to_string(folder.path(name)).unwrap();
        let cut = |line: &str| line.split(',').take(columns).collect::<Vec<_>>().join(",");
        let lines: Vec<String> = text.lines().map(cut).collect();
        std::fs::write(folder.path(name), lines.join("\n")).unwrap();
    };
    strip("truth_quat.csv", 5);
    strip("a.csv", 5);
    let json = insnav_json(["compare", &solution, &reference]).json();
    // From 0.5 s on, where the solution begins: nothing is extrapolated.
    assert_eq!(json["orientation_count"], 473, "{json:#}");
    assert_eq!(json["coverage_95"], serde_json::Value::Null);
}

#[test]
fn folders_of_trials_give_one_table_with_the_mean() {
    let folder = Folder::new();
    for name in ["solutions", "data/one", "data/two"] {
        std::fs::create_dir_all(folder.path(name)).unwrap();
    }
    write_trial(
        &folder,
        ("solutions/one.ahrs.csv", "data/one/truth_quat.csv"),
        [2.0, 0.0, 5.0],
    );
    write_trial(
        &folder,
        ("solutions/two.csv.gz", "data/two/truth_quat.csv"),
        [4.0, 0.0, 1.0],
    );
    let (a, b) = (folder.text("solutions"), folder.text("data"));
    let json = insnav_json(["compare", &a, &b]).json();
    assert_eq!(json["mean"]["trials"], 2, "{json:#}");
    let mean = |key: &str| json["mean"][key].as_f64().unwrap();
    assert!((mean("total_rmse_deg") - 3.0).abs() < 1e-6);
    assert_eq!(
        (mean("pooled_coverage_95"), mean("least_coverage_95")),
        (0.5, 0.0)
    );
    let text = insnav(["compare", &a, &b]).stdout;
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 4, "{text}");
    assert!(
        lines[3].starts_with("mean") && lines[3].contains("3.00"),
        "{text}"
    );
}
