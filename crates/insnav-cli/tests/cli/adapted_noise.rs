//! `run --noise-adapt als`: what is told, what is used, and that it can be used again.

use crate::fixture::{Folder, drive, insnav_json, write_log};
use insnav_core::imu::ImuGrade;
use insnav_core::sim::{ImuErrorModel, Scenario, Simulation};
use serde_json::Value;
use std::sync::OnceLock;

/// Eight minutes with a consumer-grade unit and white errors of the fixes.
fn long_drive() -> &'static Simulation {
    static DRIVE: OnceLock<Simulation> = OnceLock::new();
    DRIVE.get_or_init(|| {
        let mut scenario = Scenario::car_drive(480.0);
        scenario.imu.errors = ImuErrorModel::from_noise(ImuGrade::Consumer.noise());
        scenario.imu.rate_hz = 50.0;
        scenario.gnss.lever_arm_b_m = Scenario::demo().gnss.lever_arm_b_m;
        scenario.gnss.position_rate_hz = 2.0;
        scenario.gnss.velocity_rate_hz = 2.0;
        scenario.simulate(3).expect("a valid scenario")
    })
}

fn run(log: &str, more: &[&str]) -> Value {
    let mut arguments = vec!["run", log, "--force"];
    arguments.extend(more);
    let done = insnav_json(arguments);
    assert_eq!(done.code, 0, "{}", done.stderr);
    done.json()
}

fn number<'a>(report: &'a Value, name: &str) -> &'a Value {
    let numbers = report["noise_adaptation"].as_array().expect("a list");
    let found = numbers.iter().find(|n| n["name"] == name);
    found.unwrap_or_else(|| panic!("{name} in {numbers:?}"))
}

#[test]
fn a_wrong_sigma_is_mended_told_and_kept() {
    let folder = Folder::new();
    let log = folder.text("drive.mcap");
    write_log(folder.path("drive.mcap").as_path(), &long_drive().samples);
    let wrong = ["--set", "gnss.sigma_scale=3"];
    let adapted = run(&log, &[&wrong[..], &["--noise-adapt", "als"]].concat());
    let scale = number(&adapted, "gnss_sigma_scale");
    let of = |key: &str| {
        scale[key]
            .as_f64()
            .unwrap_or_else(|| panic!("{key}: {scale}"))
    };
    assert_eq!(scale["verdict"], "accepted", "{scale}");
    assert_eq!(of("prior"), 3.0);
    assert!(of("chi2") < 3.0 * of("dof"), "{scale}");
    assert!(
        (of("estimate") - 1.0).abs() < 4.0 * of("standard_error"),
        "{scale}"
    );
    assert!(of("standard_error") < 0.05, "{scale}");
    assert_eq!(adapted["gnss_sigma_scale"]["horizontal"], scale["estimate"]);
    for n in adapted["noise_adaptation"].as_array().expect("a list") {
        // Held: the reason is said. Accepted: there is none.
        assert_eq!(n["verdict"] == "accepted", n["reason"].is_null(), "{n}");
    }
    // What was used can be given back, and is the same run.
    let config = adapted["config"].as_str().expect("TOML");
    std::fs::write(folder.path("used.toml"), config).expect("writable");
    let again = run(&log, &["--config", &folder.text("used.toml")]);
    assert_eq!(again["final"], adapted["final"]);
    assert!(again.get("noise_adaptation").is_none(), "{again:#}");
    // Without it the run knows its position worse than it could.
    let plain = run(&log, &wrong);
    let sigma = |report: &Value| report["final"]["sigma_horizontal_m"].as_f64().expect("m");
    assert!(sigma(&adapted) < 0.75 * sigma(&plain));
    // The settings' own key says the same as the flag.
    let by_key = run(&log, &[&wrong[..], &["--set", "noise.adapt=als"]].concat());
    assert_eq!(by_key["noise_adaptation"], adapted["noise_adaptation"]);
}

/// Two minutes, half a minute of which the car stands, tell next to nothing: what is not told stays as it was.
#[test]
fn what_a_short_drive_does_not_tell_stays_as_it_was() {
    let folder = Folder::with_drive();
    let log = folder.text("drive.mcap");
    let (plain, adapted) = (run(&log, &[]), run(&log, &["--noise-adapt", "als"]));
    let numbers = adapted["noise_adaptation"].as_array().expect("a list");
    assert_eq!(numbers.len(), 4, "{numbers:?}");
    let held = |name: &str| number(&adapted, name)["verdict"] != "accepted";
    assert!(held("gyro_arw_deg_per_sqrt_hour"), "{numbers:?}");
    for name in [
        "gyro_arw_deg_per_sqrt_hour",
        "accel_vrw_m_per_s_per_sqrt_hour",
    ] {
        let told = number(&adapted, name);
        let used = if held(name) { "prior" } else { "estimate" };
        let (used, run) = (told[used].as_f64(), adapted[name].as_f64());
        let off = used.zip(run).map(|(a, b)| (a / b - 1.0).abs());
        // A round trip through radians.
        assert!(off.is_some_and(|off| off < 1e-12), "{told} {run:?}");
        let prior = told["prior"].as_f64().zip(plain[name].as_f64());
        assert!(prior.is_some_and(|(a, b)| (a / b - 1.0).abs() < 1e-12));
    }
}

#[test]
fn without_gnss_there_is_nothing_to_adapt_to() {
    let folder = Folder::new();
    let log = folder.text("drive.mcap");
    write_log(folder.path("drive.mcap").as_path(), &drive().samples);
    let report = run(&log, &["--imu-only", "--noise-adapt", "als"]);
    assert!(report.get("noise_adaptation").is_none());
    let warnings = report["warnings"].as_array().expect("a list");
    assert!(
        warnings.iter().any(|w| w["code"] == "noise_not_adapted"),
        "{warnings:?}"
    );
}
