//! The main job.

use crate::fixture::{Folder, insnav, insnav_json};
use insnav_log::SolutionTable;
use serde_json::Value;

fn run(folder: &Folder, more: &[&str]) -> Value {
    let log = folder.text("drive.mcap");
    let mut arguments = vec!["run", log.as_str(), "--force"];
    arguments.extend(more);
    let done = insnav_json(arguments);
    assert_eq!(done.code, 0, "{}", done.stderr);
    done.json()
}

fn used(report: &Value, name: &str) -> u64 {
    let aid = report["aiding"]
        .as_array()
        .unwrap()
        .iter()
        .find(|a| a["name"] == name)
        .expect("in use");
    ["used", "inflated", "rejected"]
        .iter()
        .map(|k| aid[k].as_u64().unwrap())
        .sum()
}

#[test]
fn the_report_has_the_keys_of_the_contract() {
    let folder = Folder::with_drive();
    let report = run(&folder, &[]);
    for (path, is) in [
        ("/input", Value::is_string as fn(&Value) -> bool),
        ("/output", Value::is_string),
        ("/imu_samples", Value::is_u64),
        ("/duration_s", Value::is_f64),
        ("/elapsed_s", Value::is_f64),
        ("/distance_m", Value::is_f64),
        ("/time_offset_s/value", Value::is_number),
        ("/time_offset_s/sigma", |v| v.is_null() || v.is_number()),
        ("/gnss_velocity_lag_s/value", Value::is_number),
        ("/gnss_velocity_lag_s/sigma", |v| {
            v.is_null() || v.is_number()
        }),
        ("/alignment/heading_deg", Value::is_f64),
        ("/alignment/sigma_heading_deg", Value::is_f64),
        ("/stops/0/begin_s", Value::is_f64),
        ("/stops/0/end_s", Value::is_f64),
        ("/stops/0/heading_before_deg", Value::is_f64),
        ("/stops/0/heading_after_deg", Value::is_f64),
        ("/stops/0/sigma_heading_deg", Value::is_f64),
        ("/aiding/0/name", Value::is_string),
        ("/aiding/0/used", Value::is_u64),
        ("/aiding/0/rejected", Value::is_u64),
        ("/aiding/0/inflated", Value::is_u64),
        ("/aiding/0/nis_mean", Value::is_f64),
        ("/final/heading_deg", Value::is_f64),
        ("/warnings", Value::is_array),
    ] {
        let value = report
            .pointer(path)
            .unwrap_or_else(|| panic!("no {path} in {report:#}"));
        assert!(is(value), "{path}: {value}");
    }
    assert_eq!(report["imu_samples"], 12_001);
    assert!((report["duration_s"].as_f64().unwrap() - 120.0).abs() < 0.02);
    // The drive stands for half a minute and then starts gently: 0.1 m/s takes it some more than a second.
    assert!(report["stops"][0]["begin_s"].as_f64().unwrap() < 1.0);
    assert!((report["stops"][0]["end_s"].as_f64().unwrap() - 30.0).abs() < 2.0);
    // The lever arm comes from the log's transforms.
    let arm = &report["lever_arm_b_m"];
    assert!(
        (arm[0].as_f64().unwrap() - 0.3).abs() < 1e-9
            && (arm[2].as_f64().unwrap() + 1.2).abs() < 1e-9,
        "{arm}"
    );
}

#[test]
fn the_solution_is_beside_the_log_and_says_how_it_was_made() {
    let folder = Folder::with_drive();
    run(&folder, &["--set", "imu.grade=consumer"]);
    assert_eq!(folder.names(), ["drive.insnav.mcap", "drive.mcap"]);
    let solution = SolutionTable::read(&folder.path("drive.insnav.mcap")).unwrap();
    assert!(
        solution.metadata["config"].contains("grade = \"consumer\""),
        "{:?}",
        solution.metadata
    );
    assert!(solution.metadata["input"].ends_with("drive.mcap"));
    assert_eq!(solution.metadata["input_crc32"].len(), 8);
}

#[test]
fn every_second_epoch_withheld_is_neither_used_nor_lost() {
    let folder = Folder::with_drive();
    let whole = run(&folder, &[]);
    let half = run(&folder, &["--withhold", "every:2"]);
    let positions = used(&whole, "gnss_position");
    let withheld = half["withheld"].as_u64().unwrap();
    // Fixes before the first inertial sample are not counted as used.
    assert!(
        withheld.abs_diff(positions / 2) <= 2,
        "{withheld} of {positions}"
    );
    assert!(used(&half, "gnss_position").abs_diff(positions / 2) <= 2);
    assert!(
        used(&half, "gnss_velocity").abs_diff(used(&whole, "gnss_velocity") / 2) <= 2,
        "velocities go with their positions"
    );
    let solution = SolutionTable::read(&folder.path("drive.insnav.mcap")).unwrap();
    assert_eq!(solution.withheld.len() as u64, withheld);
    assert_eq!(solution.metadata["withhold"], "every:2");
}

#[test]
fn inside_a_withheld_interval_nothing_is_used() {
    let folder = Folder::with_drive();
    run(&folder, &["--withhold", "60:75,90:100"]);
    let solution = SolutionTable::read(&folder.path("drive.insnav.mcap")).unwrap();
    let origin = solution.t0().unwrap();
    let times: Vec<f64> = solution
        .updates
        .iter()
        .filter(|u| u.measurement.starts_with("gnss"))
        .map(|u| u.time.since(origin))
        .collect();
    let inside = |t: &&f64| (60.0..=75.0).contains(*t) || (90.0..=100.0).contains(*t);
    assert_eq!(times.iter().filter(inside).count(), 0);
    assert!(
        times.iter().any(|t| (75.0..90.0).contains(t)),
        "and between them it is"
    );
}

#[test]
fn the_rate_is_what_was_asked_for() {
    let folder = Folder::with_drive();
    for (rate, epochs) in [("10", 1200), ("imu", 12_001)] {
        run(&folder, &["--rate", rate]);
        let written = SolutionTable::read(&folder.path("drive.insnav.mcap"))
            .unwrap()
            .len();
        assert!(written.abs_diff(epochs) <= 2, "{rate}: {written}");
    }
}

#[test]
fn a_given_offset_and_heading_are_used() {
    let folder = Folder::with_drive();
    let report = run(&folder, &["--time-offset", "-0.25", "--heading-deg", "70"]);
    assert_eq!(report["time_offset_s"]["value"], -0.25);
    assert_eq!(report["time_offset_s"]["sigma"], Value::Null);
    assert_eq!(report["alignment"]["heading_source"], "given");
    assert!((report["alignment"]["heading_deg"].as_f64().unwrap() - 70.0).abs() < 1e-6);
}

#[test]
fn several_logs_are_several_runs() {
    let folder = Folder::with_drive();
    std::fs::copy(folder.path("drive.mcap"), folder.path("again.mcap")).unwrap();
    let done = insnav_json([
        "run",
        &folder.text("drive.mcap"),
        &folder.text("again.mcap"),
    ]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    let runs = json["runs"].as_array().unwrap();
    assert_eq!(runs.len(), 2);
    assert_eq!(
        runs[0]["final"], runs[1]["final"],
        "the same log gives the same solution"
    );
    assert_eq!(folder.names().len(), 4);
}

#[test]
fn the_text_is_for_people_and_warnings_go_to_standard_error() {
    let folder = Folder::with_drive();
    let done = insnav([
        "run",
        &folder.text("drive.mcap"),
        "--set",
        "gnss.lever_arm_b_m=[0.3, -0.4, -1.2]",
    ]);
    assert_eq!(done.code, 0);
    for part in [
        "2 min 00 s",
        "stop",
        "gnss_position",
        "heading",
        "°",
        "sigmas",
    ] {
        assert!(done.stdout.contains(part), "{part}: {}", done.stdout);
    }
    assert!(!done.stdout.contains("warning:"));
}

#[test]
fn altitudes_above_the_sea_are_raised_by_the_geoid() {
    let folder = Folder::with_drive();
    let height = |more: &[&str]| run(&folder, more)["final"]["height_m"].as_f64().unwrap();
    let raised = height(&["--altitude", "msl=45.5"]) - height(&[]);
    // Gravity and curvature change by 1e-5 over such a height.
    assert!((raised - 45.5).abs() < 1e-2, "{raised}");
}

/// At 5 Hz a lag of 0.11 s is more than half the interval: half of the velocities must be left all the same.
#[test]
fn withholding_leaves_velocities_whatever_their_lag() {
    let folder = Folder::with_drive();
    let whole = run(&folder, &["--set", "gnss.velocity_lag_s=0.11"]);
    let half = run(
        &folder,
        &["--withhold", "every:2", "--set", "gnss.velocity_lag_s=0.11"],
    );
    let (all, left) = (used(&whole, "gnss_velocity"), used(&half, "gnss_velocity"));
    assert!(left.abs_diff(all / 2) <= 2, "{left} of {all}");
}

/// Sigmas of a hundredth of what the fixes scatter by: what is refused for ten seconds and more is told as such.
#[test]
fn measurements_that_cannot_be_true_are_told() {
    let folder = Folder::with_drive();
    let told = |flags: &[&str]| {
        let report = run(&folder, flags);
        let all = report["warnings"].as_array().unwrap();
        let one = all.iter().find(|w| w["code"] == "diverged").cloned();
        (one, report["aiding"][0]["misfit"].clone())
    };
    assert_eq!(told(&[]), (None, Value::Null));
    let (warning, misfit) = told(&["--set", "gnss.sigma_scale=0.01"]);
    let message = warning.expect("a warning")["message"].to_string();
    assert!(message.contains("gnss_position"), "{message}");
    let lasts = misfit["end_s"].as_f64().unwrap() - misfit["begin_s"].as_f64().unwrap();
    assert!(
        lasts >= 10.0 && misfit["count"].as_u64().unwrap() >= 10,
        "{misfit}"
    );
}
