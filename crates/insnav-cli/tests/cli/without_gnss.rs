//! `run --imu-only`: from rest, with what the inertial unit alone tells.

use crate::fixture::{
    Folder, drive, insnav, insnav_json, messages, recordings, rewrite, write_log,
};
use insnav_core::sample::Sample;
use insnav_core::sim::{ImuErrorModel, ImuOutput, NavigationDrive};
use insnav_log::{Log, ReadOptions};
use serde_json::Value;

fn inertial() -> Vec<Sample> {
    let all = drive().samples.iter().copied();
    all.filter(Sample::is_inertial).collect()
}

fn imu_only(folder: &Folder, log: &str, more: &[&str]) -> Value {
    let (log, out) = (folder.text(log), folder.text("out.mcap"));
    let mut arguments = vec!["run", &log, "-o", &out, "--imu-only", "--force"];
    arguments.extend(more);
    let done = insnav_json(arguments);
    assert_eq!(done.code, 0, "{}", done.stderr);
    done.json()
}

fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("{value}: not a number"))
}

/// Horizontal distance and height between the ends of the drive, m, and the heading at its begin, degrees.
fn truth() -> (f64, f64, f64) {
    let imu = inertial();
    let (first, last) = (
        drive().truth_at(imu[0].time()).nav,
        drive().truth_at(imu[imu.len() - 1].time()).nav,
    );
    let way = first.position.offset_to(&last.position);
    let heading = insnav_core::attitude::Euler::from_quaternion(&first.q_nb).heading_deg();
    (way.xy().norm(), -way.z, heading)
}

#[test]
fn positions_count_from_the_start_with_honest_sigmas() {
    let folder = Folder::new();
    write_log(&folder.path("imu.mcap"), &inertial());
    let (distance, height, heading) = truth();
    let given = format!("{heading}");
    for (more, source) in [
        (vec!["--latitude-deg", "50"], "relative"),
        (
            vec![
                "--set",
                "output.origin=[50, 14, 300]",
                "--heading-deg",
                &given,
            ],
            "given",
        ),
    ] {
        // The stop tells tilt and accelerometer bias apart from velocity.
        let stop = ["--set", "stationary.intervals_s=[[0, 29]]"];
        let run = imu_only(&folder, "imu.mcap", &[&more[..], &stop].concat());
        let end = &run["final"];
        assert_eq!(run["alignment"]["heading_source"], source, "{run:#}");
        // A minute and a half of driving after half a minute at rest.
        let sigma = number(&end["sigma_horizontal_m"]);
        assert!(sigma > 1.0 && sigma < distance, "{sigma} of {distance}");
        let off = number(&end["closure_horizontal_m"]) - distance;
        assert!(off.abs() < 3.0 * sigma, "{off} ± {sigma}");
        let off = number(&end["closure_height_m"]) - height;
        assert!(
            off.abs() < 3.0 * number(&end["sigma_height_m"]),
            "{off}: {end:#}"
        );
        assert_eq!(run["imu_only"]["latitude_deg"], 50.0);
        assert_eq!(run["imu_only"]["latitude_assumed"], false);
        assert_eq!(
            run["aiding"]
                .as_array()
                .unwrap()
                .iter()
                .filter(|a| a["name"].as_str().unwrap().starts_with("gnss"))
                .count(),
            0
        );
    }
}

/// The same to the last bit with GNSS in the log and without; the summary names what was left out.
#[test]
fn gnss_of_the_log_is_not_used_and_that_is_said() {
    let folder = Folder::with_drive();
    write_log(&folder.path("imu.mcap"), &inertial());
    let without = imu_only(&folder, "imu.mcap", &[]);
    assert_eq!(without["imu_only"]["gnss_left_out"], serde_json::json!([]));
    assert_eq!(without["imu_only"]["latitude_assumed"], true);
    let with = imu_only(&folder, "drive.mcap", &[]);
    assert_eq!(with["final"], without["final"]);
    assert_eq!(with["imu_only"]["gnss_left_out"][0], "/gps/fix");
    let set = insnav_json([
        "run",
        &folder.text("drive.mcap"),
        "--force",
        "--set",
        "gnss.use=false",
    ]);
    assert_eq!(
        set.json()["final"],
        with["final"],
        "the flag is the setting"
    );
    let text = insnav(["run", &folder.text("drive.mcap"), "--force", "--imu-only"]).stdout;
    for part in [
        "not used: /gps/fix",
        "from the start",
        "assumed",
        "north is",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let usual = insnav_json(["run", &folder.text("drive.mcap"), "--force"]).json();
    assert!(usual["final"]["closure_horizontal_m"].is_null() && usual["imu_only"].is_null());
    assert_ne!(usual["final"], with["final"]);
}

#[test]
fn a_log_in_motion_is_refused_before_it_is_read() {
    let folder = Folder::new();
    let begin = drive().samples[0].time();
    let moving: Vec<Sample> = inertial()
        .into_iter()
        .filter(|s| s.time().since(begin) > 40.0)
        .collect();
    write_log(&folder.path("moving.mcap"), &moving);
    let done = insnav_json(["run", &folder.text("moving.mcap"), "--imu-only"]);
    let (message, remedy) = done.failed(1, "no_rest");
    assert!(message.contains("rest"), "{message}");
    assert!(remedy.contains("without any motion"), "{remedy}");
    assert_eq!(folder.names(), ["moving.mcap"], "nothing is left behind");
}

/// A motorway, smooth for a second at a time, at 25 m/s and more: no start anywhere in the minute.
#[test]
fn a_motorway_is_no_rest() {
    let Some(recording) = recordings("mcap_real/comma2k19_ros2_none.mcap") else {
        return;
    };
    let log = Log::open(&recording, ReadOptions::default()).unwrap();
    let samples = log.samples().unwrap().map(|s| s.unwrap());
    let all: Vec<Sample> = samples.filter(Sample::is_inertial).collect();
    let folder = Folder::new();
    for skip in 0..10 {
        let begin = all[0].time().plus(5.0 * f64::from(skip));
        let later: Vec<Sample> = all.iter().filter(|s| s.time() >= begin).copied().collect();
        let name = format!("motorway_{skip}.mcap");
        write_log(&folder.path(&name), &later);
        let done = insnav_json(["run", &folder.text(&name), "--imu-only"]);
        let (message, _) = done.failed(1, "no_rest");
        assert!(message.contains("do not begin with rest"), "{message}");
    }
}

#[test]
fn what_is_about_gnss_is_refused() {
    let folder = Folder::with_drive();
    let log = folder.text("drive.mcap");
    for option in [["--withhold", "40:50"], ["--time-offset", "auto"]] {
        let (message, remedy) =
            insnav_json(["run", &log, "--imu-only", option[0], option[1]]).failed(1, "needs_gnss");
        assert!(message.contains(option[0]), "{message}");
        assert!(remedy.contains("--imu-only"), "{remedy}");
    }
    let (message, _) =
        insnav_json(["run", &log, "--latitude-deg", "50"]).failed(2, "bad_config_value");
    assert!(message.contains("--imu-only"), "{message}");
    let too_far = ["run", &log, "--imu-only", "--latitude-deg", "91"];
    let (message, _) = insnav_json(too_far).failed(2, "bad_config_value");
    assert!(message.contains("--latitude-deg 91"), "{message}");
}

#[test]
fn put_aside_and_gone_on_with_it_is_one_run() {
    let folder = Folder::new();
    write_log(&folder.path("imu.mcap"), &inertial());
    let at = inertial()[0].time().plus(55.5).0 as u64;
    for (name, first) in [("a.mcap", true), ("b.mcap", false)] {
        rewrite(&folder.path("imu.mcap"), &folder.path(name), |m| {
            if (m.log_time < at) == first {
                vec![m]
            } else {
                vec![]
            }
        });
    }
    let done = insnav_json([
        "run",
        "--print-config",
        "--imu-only",
        &folder.text("a.mcap"),
    ]);
    let settings = folder.text("settings.toml");
    std::fs::write(&settings, done.json()["config"].as_str().unwrap()).unwrap();
    let run = |log: &str, out: &str, more: &[&str]| {
        let (log, out) = (folder.text(log), folder.text(out));
        let mut arguments = vec!["run", &log, "-o", &out, "-c", &settings];
        arguments.extend(more);
        let done = insnav_json(arguments);
        assert_eq!(done.code, 0, "{}", done.stderr);
        done.json()
    };
    let state = folder.text("run.state");
    let whole = run("imu.mcap", "whole.mcap", &[]);
    run("a.mcap", "a.out.mcap", &["--save-state", &state]);
    let second = run("b.mcap", "b.out.mcap", &["--resume", &state]);
    assert_eq!(second["final"], whole["final"]);
    let mut parts = messages(&folder.path("a.out.mcap"));
    let in_first = parts.len();
    parts.extend(messages(&folder.path("b.out.mcap")));
    assert!(in_first < parts.len());
    assert!(parts == messages(&folder.path("whole.mcap")));
}

/// A table of inertial data alone becomes a log, and the log a solution.
#[test]
fn a_table_without_gnss_is_enough() {
    let folder = Folder::new();
    write_log(&folder.path("imu.mcap"), &inertial());
    let step = |arguments: &[&str]| {
        let done = insnav_json(arguments);
        assert_eq!(done.code, 0, "{}", done.stderr);
        done.json()
    };
    step(&[
        "convert",
        &folder.text("imu.mcap"),
        "-o",
        &folder.text("table"),
    ]);
    assert_eq!(
        std::fs::read_dir(folder.path("table")).unwrap().count(),
        1,
        "imu.csv.gz"
    );
    let (table, log) = (folder.text("table"), folder.text("again.mcap"));
    let converted = step(&["convert", &table, "-o", &log]);
    assert_eq!(converted["gnss_positions"], 0);
    let (a, b) = (
        imu_only(&folder, "imu.mcap", &[]),
        imu_only(&folder, "again.mcap", &[]),
    );
    // Numbers in the table have 17 digits.
    assert_eq!(
        a["final"]["closure_horizontal_m"],
        b["final"]["closure_horizontal_m"]
    );
}

/// A foot feels more than gravity most of the time: no finding may come of it.
#[test]
fn a_foot_is_no_wrong_unit() {
    let Some(recording) = recordings("openshoe_2") else {
        return;
    };
    let folder = Folder::new();
    let log = folder.text("foot.mcap");
    let done = insnav_json(["convert", &recording.display().to_string(), "-o", &log]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let info = insnav_json(["info", &log]).json();
    assert_eq!(info["findings"], serde_json::json!([]), "{info:#}");
    let remedy = info["problem"]["remedy"].as_str().unwrap();
    assert!(remedy.contains("--imu-only"), "{remedy}");
}

/// Walks of 86 m that end where they began (to 1 cm), with no setting but that it is a foot; thresholds halved and doubled close
/// them as well, so that nothing hangs on them.
#[test]
fn loops_on_foot_close_by_their_stances() {
    let foot = ["--set", "vehicle.kind=foot", "--latitude-deg", "59.35"];
    for scale in ["1.5", "0.75", "3"] {
        let scaled = format!("stationary.threshold_scale={scale}");
        let mut closed = 0;
        for name in ["openshoe_2", "openshoe_30", "openshoe_31"] {
            let Some(recording) = recordings(name) else {
                return;
            };
            let folder = Folder::new();
            let log = folder.text("foot.mcap");
            let done = insnav_json(["convert", &recording.display().to_string(), "-o", &log]);
            assert_eq!(done.code, 0, "{}", done.stderr);
            let run = imu_only(
                &folder,
                "foot.mcap",
                &[&foot[..], &["--set", &scaled]].concat(),
            );
            let closure = number(&run["final"]["closure_horizontal_m"]);
            let sigma = number(&run["final"]["sigma_horizontal_m"]);
            eprintln!("{name}, thresholds × {scale}: closes to {closure:.2} m ± {sigma:.2} m");
            closed += i32::from(closure <= 0.5);
            assert!(sigma < 0.6 && closure < 3.0 * sigma, "{closure} ± {sigma}");
            // A step a second or so for a minute; long stops are at the ends.
            let stances = number(&run["stances"]);
            let stops = run["stops"].as_array().unwrap();
            assert!((35.0..70.0).contains(&stances), "{stances}");
            assert!((1..=5).contains(&stops.len()), "{}", stops.len());
            if scale == "1.5" {
                let off = [&foot[..], &["--stationary", "off"]].concat();
                let off = imu_only(&folder, "foot.mcap", &off);
                let closure = number(&off["final"]["closure_horizontal_m"]);
                assert!(closure > 100.0, "without zero velocities: {closure}");
            }
        }
        assert!(closed >= 2, "{closed} of 3 with thresholds × {scale}");
    }
}

/// A unit that feels the Earth turn finds north itself, and every stop of a minute and more is taken as a whole.
#[test]
fn a_navigation_grade_unit_finds_north_and_calibrates_at_its_stops() {
    let noise = insnav_core::imu::ImuGrade::Navigation.noise();
    let drive = NavigationDrive {
        legs: 1,
        rate_hz: 50.0,
        errors: ImuErrorModel::from_noise(noise),
        ..NavigationDrive::default()
    };
    let mut scenario = drive.scenario();
    scenario.imu.output = ImuOutput::Rates;
    let simulation = scenario.simulate(5).expect("a drive");
    let imu: Vec<Sample> = simulation
        .samples
        .iter()
        .copied()
        .filter(Sample::is_inertial)
        .collect();
    let folder = Folder::new();
    write_log(&folder.path("nav.mcap"), &imu);
    let settings = [
        "--stationary",
        "batch",
        "--set",
        "output.origin=[60, 30, 100]",
        "--set",
        "imu.grade=\"navigation\"",
    ];
    let run = imu_only(&folder, "nav.mcap", &settings);
    assert_eq!(run["alignment"]["heading_source"], "gyrocompass", "{run:#}");
    let stops = run["stops"].as_array().expect("stops");
    let sigmas: Vec<f64> = stops
        .iter()
        .map(|stop| {
            assert_eq!(stop["mode"], "batch", "{stop:#}");
            60.0 * number(&stop["sigma_heading_deg"])
        })
        .collect();
    // 0.01 °/h of drift are 4.6′ at 60°, the rest is noise; half a turn later the drift is told from the heading.
    assert!(
        sigmas.len() == 3 && (4.6..7.0).contains(&sigmas[0]),
        "{sigmas:?}"
    );
    assert!(
        sigmas[1] < 0.7 * sigmas[0] && sigmas[2] < sigmas[1],
        "{sigmas:?}"
    );
    let [first, last] = [0, imu.len() - 1].map(|i| simulation.truth_at(imu[i].time()).nav);
    let way = first.position.offset_to(&last.position).xy().norm();
    let end = &run["final"];
    let sigma = number(&end["sigma_horizontal_m"]);
    let off = number(&end["closure_horizontal_m"]) - way;
    println!("{off:.1} m ± {sigma:.1} of {way:.0}; heading sigmas {sigmas:.2?}′");
    assert!(sigma < 20.0 && off.abs() < 3.0 * sigma, "{off} ± {sigma}");
    // With GNSS the fixes of a stop would be lost: that is said.
    let log = Folder::with_drive();
    let told = insnav_json(["run", &log.text("drive.mcap"), "--stationary", "batch"]).json();
    let codes: Vec<&str> = told["warnings"]
        .as_array()
        .expect("warnings")
        .iter()
        .filter_map(|w| w["code"].as_str())
        .collect();
    assert!(codes.contains(&"batch_with_gnss"), "{codes:?}");
}
