//! Scenarios to logs, and back by a run.

use crate::fixture::{Folder, insnav, insnav_json, messages};
use insnav_core::sample::Sample;
use insnav_log::{Log, ReadOptions};

/// A folder with the example scenario, changed line by line.
fn with_scenario(change: impl Fn(&str) -> String) -> Folder {
    let folder = Folder::new();
    let done = insnav(["simulate", "--example"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let text: Vec<String> = done.stdout.lines().map(change).collect();
    std::fs::write(folder.path("drive.toml"), text.join("\n")).unwrap();
    folder
}

fn simulate(folder: &Folder, to: &str, more: &[&str]) -> serde_json::Value {
    let (scenario, to) = (folder.text("drive.toml"), folder.text(to));
    let mut arguments = vec!["simulate", &scenario, "-o", &to];
    arguments.extend(more);
    let done = insnav_json(arguments);
    assert_eq!(done.code, 0, "{}", done.stderr);
    done.json()
}

#[test]
fn a_seed_is_a_log() {
    let folder = with_scenario(str::to_owned);
    let (truth, again) = (folder.text("a.truth.csv.gz"), folder.text("b.truth.csv"));
    let report = simulate(&folder, "a.mcap", &["--truth", &truth]);
    assert_eq!(report["seed"], 1);
    assert!((report["duration_s"].as_f64().unwrap() - 371.0).abs() < 1e-9);
    assert_eq!(report["imu_samples"], 37_101);
    // Mean speeds of legs lie halfway between their ends: the sum of half the ends' sums times their durations.
    let way = 0.5 * 14.0 * 12.0
        + 14.0 * 20.0
        + 10.0 * 8.0
        + 6.0 * 7.0
        + 13.0 * 15.0
        + 20.0 * 40.0
        + 10.0 * 10.0
        + 9.0 * 14.0
        + 18.0 * 60.0
        + 21.5 * 30.0
        + 25.0 * 50.0
        + 12.5 * 25.0;
    assert!(
        (report["distance_m"].as_f64().unwrap() - way).abs() < 1.0,
        "{way} {}",
        report["distance_m"]
    );
    simulate(&folder, "b.mcap", &["--seed", "1", "--truth", &again]);
    simulate(&folder, "c.mcap", &["--seed", "2"]);
    let log = |name: &str| messages(&folder.path(name));
    assert!(log("a.mcap") == log("b.mcap") && log("a.mcap") != log("c.mcap"));
    let read = |path: &str| insnav_log::csv::read_truth(path.as_ref()).unwrap();
    let (one, two) = (read(&truth), read(&again));
    assert_eq!(one.t_s.len(), 3711);
    // Gzip or not.
    assert!(one.t_s == two.t_s && one.position == two.position && one.velocity_n == two.velocity_n);
}

/// The way round: what is simulated is found again, within what the solution states. One run holds some tens of independent
/// errors: the 99.9 % band of a mean of 20 unit chi-squares is 0.28 to 2.3.
#[test]
fn a_run_over_it_is_honest() {
    let folder = with_scenario(|line| match line {
        l if l.starts_with("time_offset_s") => "time_offset_s = 0.2".into(),
        l => l.to_owned(),
    });
    let (truth, log) = (folder.text("truth.csv.gz"), folder.text("a.mcap"));
    for grade in ["consumer", "tactical"] {
        let report = simulate(
            &folder,
            "a.mcap",
            &["--truth", &truth, "--imu-grade", grade, "--force"],
        );
        assert_eq!(report["imu_grade"], grade);
        let setting = format!("imu.grade={grade}");
        let done = insnav_json([
            "run",
            &log,
            "--force",
            "--set",
            &setting,
            "--set",
            "gnss.correlation_time_s=0",
            "--time-offset",
            "0.2",
        ]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        let run = done.json();
        assert!(
            (run["distance_m"].as_f64().unwrap() / report["distance_m"].as_f64().unwrap() - 1.0)
                .abs()
                < 0.01
        );
        assert!((run["lever_arm_b_m"][2].as_f64().unwrap() + 1.2).abs() < 1e-9);
        let done = insnav_json(["compare", &folder.text("a.insnav.mcap"), &truth, "--strict"]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        let all = &done.json()["all"];
        for quantity in ["position", "velocity", "attitude"] {
            let nees = all["nees"][quantity].as_f64().unwrap();
            assert!(nees > 0.28 && nees < 2.3, "{grade} {quantity}: {nees}");
        }
        // The check can fail: not taken into account, the offset of 0.2 s is 4 m at 20 m/s.
        let done = insnav_json([
            "run",
            &log,
            "--force",
            "--set",
            &setting,
            "--time-offset",
            "0",
        ]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        let done = insnav_json(["compare", &folder.text("a.insnav.mcap"), &truth]);
        let nees = &done.json()["all"]["nees"];
        assert!(nees["attitude"].as_f64().unwrap() > 2.3, "{nees}");
    }
    // The truth of another place is doubted.
    let elsewhere =
        with_scenario(|line| line.replace("latitude_deg = 50.1", "latitude_deg = 51.1"));
    let other = elsewhere.text("truth.csv");
    simulate(&elsewhere, "a.mcap", &["--truth", &other]);
    let done = insnav_json(["compare", &folder.text("a.insnav.mcap"), &other, "--strict"]);
    assert_eq!(done.code, 3, "{}", done.stdout);
    let warnings = done.json()["warnings"].to_string();
    assert!(
        warnings.contains("reference_elsewhere") && warnings.contains("nees_absurd"),
        "{warnings}"
    );
}

/// Fixes are recorded when they arrive, and stamped when they are valid, on the receiver's clock.
#[test]
fn latency_and_clocks_are_in_the_log() {
    let folder = with_scenario(|line| match line {
        l if l.starts_with("latency_s") => "latency_s = 0.35".into(),
        l if l.starts_with("time_offset_s") => "time_offset_s = 18".into(),
        l => l.to_owned(),
    });
    simulate(&folder, "a.mcap", &[]);
    let log = Log::open(&folder.path("a.mcap"), ReadOptions::default()).unwrap();
    let statistics = log.statistics().unwrap();
    let fixes = statistics.iter().find(|s| s.topic == "/gps/fix").unwrap();
    let spread = fixes.header_minus_log_s.unwrap();
    assert!((spread.mean - (18.0 - 0.35)).abs() < 1e-6, "{spread:?}");
    // In an outage there is nothing: 20 s of the 5 Hz.
    let positions = log
        .samples()
        .unwrap()
        .filter(|s| matches!(s, Ok(Sample::GnssPosition(_))));
    assert_eq!(positions.count(), 371 * 5 + 1 - 100);
}

#[test]
fn mistakes_in_a_scenario_are_named() {
    let folder = with_scenario(|line| line.replace("velocity_lag_s", "velocity_lag"));
    let (scenario, to) = (folder.text("drive.toml"), folder.text("a.mcap"));
    let (message, remedy) =
        insnav_json(["simulate", &scenario, "-o", &to]).failed(1, "unknown_config_key");
    assert!(
        message.contains("drive.toml") && message.contains("gnss.velocity_lag"),
        "{message}"
    );
    assert!(remedy.contains("gnss.velocity_lag_s"), "{remedy}");
    insnav_json(["simulate", &scenario]).failed(2, "usage");
    insnav_json(["simulate", &scenario, "-o", &to, "--imu-grade", "best"]).failed(2, "usage");
    insnav_json(["simulate", &folder.text("no.toml"), "-o", &to]).failed(1, "config_not_readable");
    assert_eq!(folder.names(), ["drive.toml"]);
    std::fs::write(folder.path("a.mcap"), "precious").unwrap();
    let good = with_scenario(str::to_owned);
    insnav_json(["simulate", &good.text("drive.toml"), "-o", &to]).failed(1, "output_exists");
    let same = good.text("x.mcap");
    insnav_json([
        "simulate",
        &good.text("drive.toml"),
        "-o",
        &same,
        "--truth",
        &same,
    ])
    .failed(2, "usage");
    let own = good.text("drive.toml");
    insnav_json(["simulate", &own, "-o", &own, "--force"]).failed(1, "output_is_input");
}

/// Coarse gyros end to end: simulated, run, told in the summary, stop by stop; and a unit without steps is not accused.
#[test]
fn steps_of_gyros_are_told() {
    for (step, warned) in [("0.57", true), ("0", false)] {
        let folder = with_scenario(|line| {
            // White noise of 0.17 °/s a sample: nine of ten would be equal.
            line.replace(
                "#gyro_step_deg_per_s = 0 ",
                &format!("gyro_step_deg_per_s = {step} "),
            )
            .replace(
                "#gyro_arw_deg_per_sqrt_hour = 0.5",
                "gyro_arw_deg_per_sqrt_hour = 1",
            )
        });
        simulate(&folder, "drive.mcap", &[]);
        let (log, out) = (folder.text("drive.mcap"), folder.text("out.mcap"));
        let run = insnav_json(["run", &log, "-o", &out]);
        assert_eq!(run.code, 0, "{}", run.stderr);
        let run = run.json();
        let stops = run["stops"].as_array().unwrap();
        assert!(stops.len() >= 3, "{stops:?}");
        for stop in stops {
            assert_eq!(stop["mode"], "static");
            for axis in 0..3 {
                let told = stop["gyro_step_deg_per_s"][axis].as_f64().unwrap();
                let repeats = stop["gyro_repeats"][axis].as_bool().unwrap();
                assert!(told == 0.0 || (told / 0.57 - 1.0).abs() < 1e-3, "{stop}");
                assert_eq!(told > 0.0 || repeats, warned, "{stop}");
            }
        }
        // A step of 0.57 °/s, uniform, is 592 °/h, and the consumer class 500 °/h. Later stops begin with what the drive told.
        for sigma in stops[0]["sigma_gyro_bias_deg_per_hour"].as_array().unwrap() {
            let sigma = sigma.as_f64().unwrap();
            assert_eq!(sigma > 400.0, warned, "{sigma}");
            assert!(!(100.0..=400.0).contains(&sigma), "{sigma}");
        }
        let warnings = run["warnings"].as_array().unwrap();
        let told = warnings.iter().find(|w| w["code"] == "gyro_quantised");
        assert_eq!(told.is_some(), warned, "{warnings:?}");
        if let Some(told) = told {
            let message = told["message"].as_str().unwrap();
            assert!(message.contains("0.570°/s"), "{message}");
        }
    }
}
