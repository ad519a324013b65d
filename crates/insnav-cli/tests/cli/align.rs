//! `insnav align`: attitude, azimuth and drifts from stops.

use crate::fixture::{Folder, insnav, insnav_json, recordings};

/// Two stops of 200 s, turned by half a circle in place between them.
fn two_positions(grade: &str) -> Folder {
    let folder = Folder::new();
    let scenario = format!(
        "seed = 3\n\
         route = [\n\
         {{ duration_s = 200, speed_m_per_s = 0 }},\n\
         {{ duration_s = 20, turn_deg = 180 }},\n\
         {{ duration_s = 200 }},\n\
         ]\n\
         [start]\nlatitude_deg = 60\nlongitude_deg = 30\nheight_m = 100\nheading_deg = 45\n\
         [imu]\ngrade = \"{grade}\"\nrate_hz = 50\n[gnss]\n"
    );
    std::fs::write(folder.path("stops.toml"), scenario).unwrap();
    let made = insnav([
        "simulate",
        &folder.text("stops.toml"),
        "-o",
        &folder.text("stops.mcap"),
    ]);
    assert_eq!(made.code, 0, "{}", made.stderr);
    folder
}

const BOTH: [&str; 4] = ["--stop", "5:195", "--stop", "225:415"];

#[test]
fn two_stops_with_a_turn_tell_heading_and_drift() {
    let folder = two_positions("navigation");
    let log = folder.text("stops.mcap");
    let done = insnav_json(["align", &log].into_iter().chain(BOTH));
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    let number = |key: &str| {
        json[key]
            .as_f64()
            .unwrap_or_else(|| panic!("{key} in {json:#}"))
    };
    assert_eq!(json["method"], "kalman", "{json:#}");
    assert_eq!(number("at_s"), 415.0);
    assert_eq!(json["latitude_source"], "fixes");
    for (key, truth) in [("heading_deg", 225.0), ("azimuth_deg", 45.0)] {
        let off = number(key) - truth;
        assert!(
            off.abs() <= 3.0 * number("sigma_heading_deg"),
            "{key} {off}"
        );
    }
    // A unit of 0.002 °/√h and 0.01 m/s/√h in two stops of 190 s.
    let sigma = number("sigma_heading_deg");
    assert!((0.03..0.15).contains(&sigma), "{sigma}");
    for key in [
        "roll_deg",
        "pitch_deg",
        "sigma_roll_deg",
        "sigma_pitch_deg",
        "geometry_ratio",
    ] {
        number(key);
    }
    assert_eq!(json["covariance"].as_array().map(Vec::len), Some(9));
    assert_eq!(json["stops"].as_array().map(Vec::len), Some(2));
    assert!(json["stops"][0]["residual_rate_ned_rad_per_s"][2].is_number());
    assert_eq!(json["observable"]["attitude"][2], true);

    // Without --stop a run proposes them, and what it prints gives the same.
    let proposed = insnav_json(["align", &log]).json();
    assert_eq!(proposed["stops_proposed"], true);
    let stops = proposed["stops"].as_array().unwrap();
    assert_eq!(stops.len(), 2, "{proposed:#}");
    let begin = stops[1]["begin_s"].as_f64().unwrap();
    assert!((218.0..226.0).contains(&begin), "{begin}");
    let text = insnav(["align", &log]);
    let line = text.stdout.lines().find(|l| l.contains("to state it"));
    let flags = line.unwrap().split_once("to state it").unwrap().1;
    let pasted = insnav_json(["align", &log].into_iter().chain(flags.split_whitespace())).json();
    let heading = |json: &serde_json::Value| json["heading_deg"].as_f64().unwrap();
    assert!((heading(&pasted) - heading(&proposed)).abs() < 1e-3);
}

#[test]
fn a_mems_unit_is_levelled_and_told_why() {
    let folder = two_positions("automotive");
    let log = folder.text("stops.mcap");
    let auto = insnav_json(["align", &log].into_iter().chain(BOTH).chain(["--strict"]));
    assert_eq!(auto.code, 3, "{}", auto.stderr);
    let json = auto.json();
    assert_eq!(json["method"], "levelling");
    assert!(json["heading_deg"].is_null() && json["azimuth_deg"].is_null());
    assert!(json["sigma_heading_deg"].as_f64().unwrap() > 5.0);
    assert_eq!(json["warnings"][0]["code"], "azimuth_unobservable");
    let roll = json["roll_deg"].as_f64().unwrap();
    assert!(roll.abs() < 3.0 * json["sigma_roll_deg"].as_f64().unwrap());
    let fine = ["align", &log, "--method", "fine"];
    let (message, remedy) = insnav_json(fine.into_iter().chain(BOTH)).failed(1, "low_grade");
    assert!(
        message.contains('°') && remedy.contains("levelling"),
        "{message}"
    );
}

/// From standard input without GNSS, for which the log is looked at twice; and what the table means by "(not seen)".
#[test]
fn a_log_from_standard_input_is_aligned() {
    let folder = two_positions("automotive");
    let log = std::fs::File::open(folder.path("stops.mcap")).unwrap();
    let done = std::process::Command::new(env!("CARGO_BIN_EXE_insnav"))
        .args(["align", "-", "--latitude-deg", "60", "--topic", "gnss=none"])
        .args(["--topic", "gnss-velocity=none"])
        .args(BOTH)
        .stdin(log)
        .output()
        .unwrap();
    let text = String::from_utf8(done.stdout).unwrap();
    let said = String::from_utf8(done.stderr).unwrap();
    assert!(done.status.success(), "{said}");
    assert!(text.contains("aligned by levelling"), "{text}");
    assert!(text.contains("no more of it than was known"), "{text}");
}

#[test]
fn what_cannot_be_is_refused_in_seconds_of_the_log() {
    let folder = two_positions("navigation");
    let log = folder.text("stops.mcap");
    let with = |more: &[&str]| insnav_json(["align", &log].iter().chain(more));
    let (message, _) = with(&["--stop", "300:500"]).failed(1, "outside_data");
    assert!(message.contains("300.000..500.000"), "{message}");
    with(&["--stop", "5:195,190:300"]).failed(1, "stops_overlap");
    with(&["--stop", "5:30"]).failed(1, "stop_too_short");
    with(&["--stop", "5:150,160:195", "--method", "two_position"]).failed(1, "stop_too_short");
    with(&["--stop", "5:95,100:195", "--method", "two_position"]).failed(1, "missing_rotation");
    let (message, remedy) = with(&["--stop", "5:215"]).failed(1, "not_stationary");
    assert!(
        message.contains("stop at 5.000 s") && !remedy.is_empty(),
        "{message}"
    );
    with(&["--method", "zupt2", "--stop", "5:195"]).failed(2, "usage");
    with(&["--latitude-deg", "95", "--stop", "5:195"]).failed(2, "usage");
    with(&["--heading-deg", "45", "--stop", "5:195"]).failed(2, "usage");
    with(&[
        "--latitude-deg",
        "89.5",
        "--method",
        "fine",
        "--stop",
        "5:195",
    ])
    .failed(1, "azimuth_unobservable");
    // No latitude from anywhere.
    with(&[
        "--topic",
        "gnss=none",
        "--topic",
        "gnss-velocity=none",
        "--stop",
        "5:195",
    ])
    .failed(1, "no_latitude");
}

/// Real units at rest: levelled, the azimuth refused with what it would be.
#[test]
fn real_mems_units_are_levelled() {
    for name in ["vn100_static_12min", "adis16405_static_imu1"] {
        let Some(recording) = recordings(name) else {
            continue;
        };
        let folder = Folder::new();
        let log = folder.text("static.mcap");
        let recording = recording.to_str().unwrap();
        let made = insnav(["convert", recording, "-o", &log]);
        assert_eq!(made.code, 0, "{}", made.stderr);
        let done = insnav_json(["align", &log, "--latitude-deg", "50", "--stop", "60:660"]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        let json = done.json();
        assert_eq!(json["method"], "levelling", "{name}");
        let number = |key: &str| json[key].as_f64().expect("a number");
        println!(
            "{name}: roll {:.2} ± {:.2}, azimuth would have {:.0}°",
            number("roll_deg"),
            number("sigma_roll_deg"),
            number("sigma_heading_deg")
        );
        // Another ten minutes agree within the sigmas; the accelerometers' constant bias is common to both.
        let later =
            insnav_json(["align", &log, "--latitude-deg", "50", "--stop", "400:700"]).json();
        for key in ["roll", "pitch"] {
            let key = format!("{key}_deg");
            let apart = number(&key) - later[&key].as_f64().unwrap();
            assert!(
                apart.abs() <= number(&format!("sigma_{key}")),
                "{name} {key} {apart}"
            );
        }
        assert!(number("sigma_heading_deg") > 10.0);
    }
}
