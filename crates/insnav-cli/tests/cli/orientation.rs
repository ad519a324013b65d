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

/// Half a minute at rest, then a turn by 90° about the vertical in nine seconds, then rest: at 50 Hz, with noise. The sensor begins
/// 5° rolled and looking 40° east of magnetic north, in a field that dips by 60°; without `field`, 6 axes.
fn write_turn(folder: &Folder, name: &str, with_field: bool) {
    use insnav_core::attitude::Euler;
    use insnav_core::sample::{ImuSample, MagneticField, Sample};
    use insnav_core::sim::{Source, Stream};
    use insnav_core::time::Time;
    let mut noise = Source::new(7, Stream::GyroWhite);
    let mut vector =
        |sigma: f64| Vector3::new(noise.normal(), noise.normal(), noise.normal()) * sigma;
    let mut samples = Vec::new();
    let mut truth = String::from("t_s,qw,qx,qy,qz\n");
    let t0 = 1.6e9;
    for i in 0..3000 {
        let t = 0.02 * f64::from(i);
        let heading = 40.0 + 10.0 * (t - 30.0).clamp(0.0, 9.0);
        let q_nb = Euler::from_degrees(5.0, 0.0, heading).to_quaternion();
        let turning = (30.0..39.0).contains(&(t - 0.01));
        let rate_n = Vector3::new(0.0, 0.0, if turning { 10.0_f64.to_radians() } else { 0.0 });
        let time = Time::from_seconds(t0 + t);
        if with_field && i % 2 == 0 {
            let field_n = Vector3::new(25e-6, 0.0, 43e-6);
            samples.push(Sample::Magnetic(MagneticField {
                time,
                field_b: q_nb.inverse() * field_n + vector(0.3e-6),
            }));
        }
        samples.push(Sample::Imu(ImuSample {
            time,
            angular_rate_b: q_nb.inverse() * rate_n
                + vector(2e-3)
                + Vector3::new(3e-3, -2e-3, 1e-3),
            specific_force_b: q_nb.inverse() * Vector3::new(0.0, 0.0, -9.80665) + vector(0.02),
        }));
        let q = insnav_core::metrics::to_enu_flu(&q_nb);
        truth.push_str(&row(t, &q, ""));
    }
    let options = insnav_log::LogWriterOptions {
        t0: Some(Time::from_seconds(t0)),
        ..Default::default()
    };
    crate::fixture::write_log_with(&folder.path(&format!("{name}.mcap")), &samples, options);
    std::fs::create_dir_all(folder.path(&format!("truth/{name}"))).unwrap();
    std::fs::write(folder.path(&format!("truth/{name}/truth_quat.csv")), truth).unwrap();
}

#[test]
fn an_orientation_is_found_written_and_scored() {
    let folder = Folder::new();
    write_turn(&folder, "turn", true);
    let log = folder.text("turn.mcap");
    let done = insnav_json(["ahrs", &log, "--also", "csv"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    assert_eq!(json["imu_samples"], 3000);
    assert_eq!(json["magnetic_fields"], 1500);
    assert_eq!(json["heading_reference"], "magnetic_north");
    assert_eq!(json["noise"]["source"], "log");
    // 2 mrad/s at 50 Hz are 0.28 mrad/√s.
    let arw = json["noise"]["gyro_arw_deg_per_sqrt_hour"]
        .as_f64()
        .unwrap();
    let true_arw = (2e-3 / 50f64.sqrt()).to_degrees() * 60.0;
    assert!((arw / true_arw - 1.0).abs() < 0.2, "{arw} {true_arw}");
    assert!(json["rest_s"].as_f64().unwrap() > 40.0, "{json:#}");
    let heading = json["final"]["heading_deg"].as_f64().unwrap();
    assert!((heading - 130.0).abs() < 3.0, "{heading}");
    // The file and the table beside it say the same, and the truth agrees with both within what they state.
    let truth = folder.text("truth/turn/truth_quat.csv");
    let score = |solution: &str| {
        let done = insnav_json(["compare", &folder.text(solution), &truth]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        done.json()
    };
    let (log_score, table_score) = (score("turn.ahrs.mcap"), score("turn.ahrs.csv"));
    for key in ["total_rmse_deg", "heading_rmse_deg", "inclination_rmse_deg"] {
        let [a, b] = [&log_score, &table_score].map(|s| s[key].as_f64().unwrap());
        assert!((a - b).abs() < 1e-4, "{key}: {a} {b}");
        assert!(a < 2.0, "{key}: {a}");
    }
    assert!(
        log_score["coverage_95"].as_f64().unwrap() > 0.9,
        "{log_score:#}"
    );
    // With the whole log, and the noise as a block from a file.
    std::fs::write(
        folder.path("noise.toml"),
        json["noise"]["config"].as_str().unwrap(),
    )
    .unwrap();
    let smooth = folder.text("smooth.mcap");
    let noise = folder.text("noise.toml");
    let done = insnav_json(["ahrs", &log, "--smooth", "--noise", &noise, "-o", &smooth]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let again = done.json();
    assert_eq!(again["noise"]["source"], "settings");
    let same = again["noise"]["gyro_arw_deg_per_sqrt_hour"]
        .as_f64()
        .unwrap();
    assert!((same / arw - 1.0).abs() < 1e-3, "four digits: {same} {arw}");
    assert!(score("smooth.mcap")["total_rmse_deg"].as_f64().unwrap() < 2.0);
    // An orientation is no recording to be found again in its folder, and nothing is overwritten.
    insnav_json(["ahrs", &log]).failed(1, "output_exists");
    let json = insnav_json(["ahrs", &folder.text(""), "--force"]).json();
    assert_eq!(json["runs"].as_array().unwrap().len(), 2, "{json:#}");
}

#[test]
fn declinations_turn_the_heading_and_six_axes_have_none() {
    let folder = Folder::new();
    write_turn(&folder, "turn", true);
    write_turn(&folder, "six", false);
    let heading = |log: &str, more: &[&str]| {
        let path = folder.text(log);
        let mut arguments = vec!["ahrs", path.as_str(), "--noise", "datasheet", "--force"];
        arguments.extend(more);
        let done = insnav_json(arguments);
        assert_eq!(done.code, 0, "{}", done.stderr);
        let json = done.json();
        (
            json["final"]["heading_deg"].as_f64().unwrap(),
            json["heading_reference"].as_str().unwrap().to_owned(),
        )
    };
    let (magnetic, reference) = heading("turn.mcap", &[]);
    assert_eq!(reference, "magnetic_north");
    let (north, reference) = heading("turn.mcap", &["--set", "alignment.declination_deg=5"]);
    assert_eq!(reference, "true_north");
    assert!((north - magnetic - 5.0).abs() < 1e-9, "{north} {magnetic}");
    // From where it began, by the gyros alone: 90°, and what a bias learnt at rest leaves in a minute.
    let (turned, reference) = heading("six.mcap", &[]);
    assert_eq!(reference, "start");
    assert!((turned - 90.0).abs() < 2.0, "{turned}");
    let none = heading("turn.mcap", &["--topic", "magnetometer=none"]);
    assert_eq!(none.1, "start");
    let text = insnav(["ahrs", &folder.text("six.mcap"), "--force"]).stdout;
    assert!(
        text.contains("no magnetometer") && text.contains("6 axes"),
        "{text}"
    );
}

#[test]
fn what_ahrs_cannot_do_is_told() {
    let folder = Folder::new();
    write_turn(&folder, "turn", true);
    let log = folder.text("turn.mcap");
    insnav_json(["ahrs", &log, "--noise", "nowhere.toml"]).failed(2, "usage");
    insnav_json(["ahrs", &log, "-o", &folder.text("a.csv")]).failed(2, "usage");
    insnav_json(["ahrs", &log, "--rate", "0"]).failed(2, "usage");
    insnav_json(["ahrs", &folder.text("nothing.mcap")]).failed(1, "no_such_file");
    std::fs::write(folder.path("wrong.toml"), "[noise]\ngyro_arw = 3\n").unwrap();
    let (message, _) = insnav_json(["ahrs", &log, "--noise", &folder.text("wrong.toml")])
        .failed(1, "unknown_config_key");
    assert!(message.contains("gyro_arw"), "{message}");
}
