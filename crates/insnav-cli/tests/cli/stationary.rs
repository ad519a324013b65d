//! Stops: declared by the user, by a topic, found; and what may be wrong with that.

use crate::fixture::{Folder, drive, insnav, insnav_json, lever_arm, write_log, write_log_with};
use insnav_core::sample::{Sample, Speed, Standstill};
use insnav_log::LogWriterOptions;
use serde_json::Value;

fn run(folder: &Folder, log: &str, more: &[&str]) -> Value {
    let log = folder.text(log);
    let mut arguments = vec!["run", log.as_str(), "--force"];
    arguments.extend(more);
    let done = insnav_json(arguments);
    assert_eq!(done.code, 0, "{}", done.stderr);
    done.json()
}

fn stops(report: &Value) -> &Vec<Value> {
    report["stops"].as_array().expect("a list")
}

fn number(value: &Value, key: &str) -> f64 {
    value[key]
        .as_f64()
        .unwrap_or_else(|| panic!("{key} of {value:#}"))
}

fn warning<'a>(report: &'a Value, code: &str) -> Option<&'a str> {
    let warnings = report["warnings"].as_array().expect("a list");
    let found = warnings.iter().find(|w| w["code"] == code)?;
    found["message"].as_str()
}

/// The drive with more samples, each in its place.
fn write_with(folder: &Folder, name: &str, more: impl IntoIterator<Item = Sample>) {
    let mut samples = drive().samples.clone();
    samples.extend(more);
    samples.sort_by_key(Sample::time);
    write_log(&folder.path(name), &samples);
}

/// What somebody says at seconds of the drive.
fn standstills(says: &[(f64, bool)]) -> Vec<Sample> {
    let zero = drive().trajectory.start();
    let sample = |(t, standing): &(f64, bool)| {
        Sample::Standstill(Standstill {
            time: zero.plus(*t),
            standing: *standing,
        })
    };
    says.iter().map(sample).collect()
}

#[test]
fn a_stop_that_the_user_knows_is_in_the_report() {
    let folder = Folder::with_drive();
    let known = ["--stop", "5:20", "--set", "stationary.detector=none"];
    let report = run(&folder, "drive.mcap", &known);
    let [stop] = &stops(&report)[..] else {
        panic!("one stop: {:#}", report["stops"]);
    };
    assert!((number(stop, "begin_s") - 5.0).abs() < 0.02, "{stop:#}");
    assert!((number(stop, "end_s") - 20.0).abs() < 0.02, "{stop:#}");
    assert_eq!(stop["evidence"]["witness"], "interval");
    for key in [
        "held_from_s",
        "heading_before_deg",
        "sigma_heading_before_deg",
        "heading_at_entry_deg",
        "heading_growth_deg",
        "heading_corrections_deg",
        "heading_after_deg",
        "sigma_heading_deg",
    ] {
        assert!(stop[key].is_f64(), "{key}: {stop:#}");
    }
    for key in ["gyro_bias_deg_per_hour", "sigma_gyro_bias_deg_per_hour"] {
        assert_eq!(
            stop[key].as_array().map(Vec::len),
            Some(3),
            "{key}: {stop:#}"
        );
    }
    assert!(stop["ended_by"].is_string());
    // What it was told is not lost on the way to the settings that were used.
    let config = report["config"].as_str().unwrap();
    assert!(config.contains("intervals_s = [[5.0, 20.0]]"), "{config}");
    assert!(number(&report, "rest_gyro_arw_deg_per_sqrt_hour") > 0.0);

    let off = run(
        &folder,
        "drive.mcap",
        &[&known[..], &["--stationary", "off"]].concat(),
    );
    assert_eq!(stops(&off).len(), 1, "told, though nothing is made of it");
    assert_ne!(off["final"], report["final"], "something was made of it");
}

#[test]
fn the_summary_has_a_line_a_stop() {
    let folder = Folder::with_drive();
    let log = folder.text("drive.mcap");
    let done = insnav([
        "run",
        &log,
        "--stop",
        "5:12,14:20",
        "--set",
        "stationary.detector=none",
    ]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let lines: Vec<&str> = done.stdout.lines().collect();
    let at = lines
        .iter()
        .position(|l| l.starts_with("  stops "))
        .expect("a table");
    assert!(lines[at].contains("heading °") && lines[at].contains("ended by"));
    for (line, begin) in lines[at + 1..].iter().zip(["5.0", "14.0"]) {
        assert_eq!(line.split_whitespace().next(), Some(begin), "{line}");
    }
}

#[test]
fn intervals_that_cannot_be_are_refused_with_the_place() {
    let folder = Folder::with_drive();
    let log = folder.text("drive.mcap");
    let run = |more: &[&str]| {
        let arguments: Vec<&str> = ["run", &log]
            .into_iter()
            .chain(more.iter().copied())
            .collect();
        insnav_json(arguments)
    };
    for reversed in ["20:5", "5:5", "5", "five:six"] {
        let (message, _) = run(&["--stop", reversed]).failed(2, "usage");
        assert!(
            message.contains("--stop") && message.contains(reversed),
            "{message}"
        );
    }
    let overlapping = run(&["--stop", "40:60", "--stop", "50:70"]);
    let (message, _) = overlapping.failed(2, "bad_config_value");
    assert!(
        message
            .contains("--stop 40:60,50:70: 50 s must be after the end of the interval before it"),
        "{message}"
    );
    let many: Vec<String> = (0..40).map(|i| format!("{i}:{i}.5")).collect();
    let (message, _) = run(&["--stop", &many.join(",")]).failed(2, "usage");
    assert!(message.contains("40 intervals"), "{message}");

    let file = folder.path("car.toml");
    std::fs::write(&file, "[stationary]\nintervals_s = [[40, 60], [50, 70]]\n").unwrap();
    let path = folder.text("car.toml");
    let (message, _) = run(&["-c", &path]).failed(1, "bad_config_value");
    assert!(
        message.contains("car.toml: stationary.intervals_s = 50"),
        "{message}"
    );
    for (key, value) in [
        ("threshold_scale", "0"),
        ("threshold_scale", "-1"),
        ("speed_m_per_s", "0"),
        ("window_s", "0"),
        ("gyro_arw_deg_per_sqrt_hour", "-0.1"),
    ] {
        let set = format!("stationary.{key}={value}");
        let (message, _) = run(&["--set", &set]).failed(2, "bad_config_value");
        assert!(
            message.contains(&set) && message.contains("above 0"),
            "{message}"
        );
    }
    let (message, remedy) = run(&["--set", "stationary.window_s=150"]).failed(1, "window_too_long");
    assert!(
        message.contains("150 s") && message.contains("120.0 s"),
        "{message}"
    );
    assert!(remedy.contains("shorter"));
    let (message, _) = run(&["--stationary", "hold"]).failed(2, "usage");
    assert!(message.contains("heading_hold"), "{message}");
    // Every name is in the message, and the nearest is the remedy, wherever the value comes from.
    let (message, remedy) = run(&["--stationary", "zup"]).failed(2, "usage");
    assert!(
        message.contains("auto, off, zupt, zihr") && remedy.contains("zupt"),
        "{message} {remedy}"
    );
    let set = run(&["--set", "stationary.mode=zup"]);
    let (message, remedy) = set.failed(2, "bad_config_value");
    assert!(
        message.contains("auto, off, zupt, zihr") && remedy.contains("`zupt`"),
        "{message} {remedy}"
    );
    assert_eq!(
        folder.names(),
        ["car.toml", "drive.mcap"],
        "nothing was written"
    );
}

#[test]
fn an_interval_outside_the_log_is_told_with_the_span_of_the_log() {
    let folder = Folder::with_drive();
    let report = run(&folder, "drive.mcap", &["--stop", "5:20,500:600"]);
    let message = warning(&report, "stop_outside").expect("a warning");
    assert!(
        message.contains("500:600") && message.contains("0.0 to 120.0 s"),
        "{message}"
    );
    let report = run(&folder, "drive.mcap", &["--stop", "5:20"]);
    assert_eq!(warning(&report, "stop_outside"), None);
}

#[test]
fn a_topic_declares_standing_only_when_it_is_named() {
    let folder = Folder::new();
    let says = [
        (0.1, false),
        (5.0, true),
        (10.0, true),
        (25.0, false),
        (60.0, false),
    ];
    write_with(&folder, "drive.mcap", standstills(&says));
    let no_detector = ["--set", "stationary.detector=none"];
    let report = run(&folder, "drive.mcap", &no_detector);
    assert_eq!(stops(&report).len(), 0, "{report:#}");
    let by_flag = ["--topic", "standing=/vehicle/standing"];
    let report = run(&folder, "drive.mcap", &[no_detector, by_flag].concat());
    let [stop] = &stops(&report)[..] else {
        panic!("one stop: {:#}", report["stops"]);
    };
    assert!((number(stop, "begin_s") - 5.0).abs() < 0.02, "{stop:#}");
    // What says "moving" has seen motion first.
    assert!((number(stop, "end_s") - 24.5).abs() < 0.02, "{stop:#}");
    assert_eq!(stop["evidence"]["witness"], "declared");
    let config = report["config"].as_str().unwrap();
    assert!(config.contains("topic = \"/vehicle/standing\""), "{config}");
    // The settings do as the flag does, and what a run used can be given to another.
    std::fs::write(folder.path("car.toml"), config).unwrap();
    let path = folder.text("car.toml");
    let again = run(&folder, "drive.mcap", &["-c", &path]);
    assert_eq!(again["stops"], report["stops"]);

    let info = insnav_json(["info", &folder.text("drive.mcap"), "-c", &path]).json();
    assert_eq!(info["run"]["standstills"], 5);
    let topics = info["topics"].as_array().unwrap();
    let topic = topics
        .iter()
        .find(|t| t["name"] == "/vehicle/standing")
        .unwrap();
    assert_eq!(
        (&topic["role"], &topic["unstamped"]),
        (&"standing".into(), &0.into())
    );

    let log = folder.text("drive.mcap");
    let wrong = insnav_json(["run", &log, "--force", "--topic", "standing=/gps/fix"]);
    let (_, remedy) = wrong.failed(1, "wrong_type");
    for accepted in [
        "std_msgs/msg/Bool",
        "Float64",
        "nav_msgs/msg/Odometry",
        "[[map]]",
    ] {
        assert!(remedy.contains(accepted), "{accepted}: {remedy}");
    }
    let none = insnav_json(["run", &log, "--force", "--set", "stationary.topic=/no/such"]);
    assert!(none.failed(1, "unknown_topic").0.contains("/no/such"));
}

/// While the vehicle drives at 12 m/s somebody says that it stands.
#[test]
fn a_declaration_that_the_solution_contradicts_is_counted() {
    let folder = Folder::new();
    write_with(
        &folder,
        "drive.mcap",
        standstills(&[(0.1, false), (45.0, true), (55.0, false)]),
    );
    let by_topic = ["--topic", "standing=/vehicle/standing"];
    let report = run(&folder, "drive.mcap", &by_topic);
    let message = warning(&report, "stop_contradicted").expect("a warning");
    assert!(message.contains("while the vehicle moves"), "{message}");
    let inside = |s: &&Value| (40.0..60.0).contains(&number(s, "begin_s"));
    assert_eq!(stops(&report).iter().find(inside), None);
}

#[test]
fn a_topic_that_flaps_is_counted() {
    let folder = Folder::new();
    let says: Vec<(f64, bool)> = (0..200)
        .map(|i| (5.0 + 0.1 * f64::from(i), i % 2 == 0))
        .collect();
    write_with(&folder, "drive.mcap", standstills(&says));
    let by_topic = ["--topic", "standing=/vehicle/standing"];
    let report = run(&folder, "drive.mcap", &by_topic);
    let message = warning(&report, "stop_topic_flaps").expect("a warning");
    assert!(
        message.contains("100 times") || message.contains("99 times"),
        "{message}"
    );
    // What flaps neither makes a stop nor ends one.
    assert!(stops(&report).len() < 10, "{:#}", report["stops"]);
}

/// Wheels that turn, by a receiver that is silent about speed.
#[test]
fn the_speed_of_wheels_is_heard() {
    let folder = Folder::new();
    let zero = drive().trajectory.start();
    let speeds = (0..1200).map(|i| {
        let time = zero.plus(0.1 * f64::from(i));
        let speed = drive().truth_at(time).nav.velocity_n.norm();
        Sample::Speed(Speed { time, speed })
    });
    write_with(&folder, "drive.mcap", speeds);
    let report = run(
        &folder,
        "drive.mcap",
        &["--topic", "standing=/vehicle/speed"],
    );
    assert_eq!(warning(&report, "stop_contradicted"), None);
    assert!(
        number(&stops(&report)[0], "begin_s") < 3.0,
        "{:#}",
        report["stops"]
    );
}

#[test]
fn a_hole_in_the_inertial_data_ends_a_stop() {
    let folder = Folder::new();
    let zero = drive().trajectory.start();
    let hole = zero.plus(12.0)..zero.plus(13.5);
    let kept = |s: &&Sample| !(s.is_inertial() && hole.contains(&s.time()));
    let samples: Vec<Sample> = drive().samples.iter().filter(kept).copied().collect();
    write_log(&folder.path("drive.mcap"), &samples);
    let report = run(&folder, "drive.mcap", &["--stop", "5:20"]);
    let before = stops(&report)
        .iter()
        .find(|s| s["ended_by"] == "gap")
        .unwrap_or_else(|| panic!("{:#}", report["stops"]));
    assert!((number(before, "end_s") - 12.0).abs() < 0.1, "{before:#}");
}

/// The sum of ways between the epochs of the truth.
#[test]
fn standing_adds_nothing_to_the_way() {
    let folder = Folder::with_drive();
    let report = run(&folder, "drive.mcap", &[]);
    let zero = drive().trajectory.start();
    let speed = |i: u32| {
        let nav = drive().truth_at(zero.plus(0.1 * f64::from(i))).nav;
        nav.velocity_n.xy().norm()
    };
    let truth: f64 = (0..1200)
        .map(|i| 0.1 * 0.5 * (speed(i) + speed(i + 1)))
        .sum();
    let way = number(&report, "distance_m");
    // Noise of the velocity under way, 0.03 m/s, adds its square over twice the speed; the start from standstill the rest.
    assert!((way - truth).abs() < 0.5, "{way} of {truth}");
}

/// Seconds of `--stop` count from the zero that `info` prints: here that of the metadata, with stamps of the header or of the
/// recorder, and in Unix time only to be told so.
#[test]
fn stops_count_from_the_zero_that_info_prints() {
    let folder = Folder::new();
    let first = drive().samples[0].time();
    let options = LogWriterOptions {
        t0: Some(first.plus(-100.0)),
        ..lever_arm()
    };
    write_log_with(&folder.path("stated.mcap"), &drive().samples, options);
    write_log(&folder.path("plain.mcap"), &drive().samples);
    let alone = ["--set", "stationary.detector=none"];
    for (log, zero, stated) in [
        ("stated.mcap", first.seconds() - 100.0, true),
        ("plain.mcap", first.seconds(), false),
    ] {
        let told = insnav_json(["info", &folder.text(log)]).json();
        assert!((number(&told, "zero_unix_s") - zero).abs() < 1e-3, "{log}");
        assert_eq!(told["zero_stated"], stated, "{log}");
        let text = insnav(["info", &folder.text(log)]).stdout;
        assert!(
            text.contains(&format!("seconds count from {zero:.3} s")),
            "{text}"
        );
        let shift = first.seconds() - zero;
        let known = format!("{}:{}", shift + 5.0, shift + 20.0);
        for clock in ["header", "log"] {
            let flags = ["--stop", &known, "--time", clock];
            let report = run(&folder, log, &[&flags[..], &alone].concat());
            let [stop] = &stops(&report)[..] else {
                panic!("one stop: {:#}", report["stops"]);
            };
            assert!(
                (number(stop, "begin_s") - shift - 5.0).abs() < 0.02,
                "{stop:#}"
            );
        }
        // In Unix time: not used, and the remedy is what to give instead.
        let absolute = format!("{}:{}", first.seconds() + 5.0, first.seconds() + 20.0);
        let report = run(&folder, log, &[&["--stop", &absolute][..], &alone].concat());
        let all = report["warnings"].as_array().unwrap();
        let outside = all.iter().find(|w| w["code"] == "stop_outside");
        let remedy = outside.expect("a warning")["remedy"].as_str().unwrap();
        let instead = format!("give {:.3}:{:.3}", shift + 5.0, shift + 20.0);
        assert!(remedy.contains(&instead), "{remedy}");
    }
}

/// Those of the file and of the flag are both used; what is in both is one, and what overlaps is refused with both places.
#[test]
fn stops_of_the_flag_are_added_to_those_of_the_settings() {
    let folder = Folder::with_drive();
    let file = folder.path("car.toml");
    std::fs::write(
        &file,
        "[stationary]\nintervals_s = [[12, 20]]\ndetector = \"none\"\n",
    )
    .unwrap();
    let config = folder.text("car.toml");
    let begins = |more: &[&str]| -> Vec<f64> {
        let report = run(
            &folder,
            "drive.mcap",
            &[&["-c", config.as_str()], more].concat(),
        );
        let rounded = |s: &Value| number(s, "begin_s").round();
        stops(&report).iter().map(rounded).collect()
    };
    assert_eq!(begins(&["--stop", "4:8"]), [4.0, 12.0]);
    assert_eq!(begins(&["--stop", "12:20,4:8"]), [4.0, 12.0]);
    assert_eq!(begins(&["--stop", "8:12"]), [8.0, 12.0]);
    let log = folder.text("drive.mcap");
    for (more, place) in [
        (vec![], "stationary.intervals_s in "),
        (
            vec!["--set", "stationary.intervals_s=[[15, 22]]"],
            "--set stationary.intervals_s",
        ),
    ] {
        let mut arguments = vec!["run", &log, "-c", &config, "--stop", "16:25"];
        arguments.extend(more);
        let (message, _) = insnav_json(arguments).failed(2, "bad_config_value");
        assert!(
            message.contains("--stop 16:25 overlaps") && message.contains(place),
            "{message}"
        );
    }
}

/// Wheels that say NaN now and then, and infinity once.
#[test]
fn speeds_that_are_no_numbers_are_counted_with_topic_and_time() {
    let folder = Folder::new();
    let zero = drive().trajectory.start();
    let speeds = (0..1200).map(|i| {
        let time = zero.plus(0.1 * f64::from(i));
        let speed = match i {
            700 => f64::INFINITY,
            400.. if i % 100 == 0 => f64::NAN,
            _ => drive().truth_at(time).nav.velocity_n.norm(),
        };
        Sample::Speed(Speed { time, speed })
    });
    write_with(&folder, "drive.mcap", speeds);
    let by_topic = ["--topic", "standing=/vehicle/speed"];
    let report = run(&folder, "drive.mcap", &by_topic);
    let message = warning(&report, "speed_not_finite").expect("a warning");
    for part in ["/vehicle/speed", "8 of 1200", "40.0"] {
        assert!(message.contains(part), "{part}: {message}");
    }
    let log = folder.text("drive.mcap");
    let told = insnav_json([&["info", log.as_str()][..], &by_topic].concat()).json();
    assert_eq!(warning(&told, "speed_not_finite"), Some(message));
}

/// `info` tells what a run would find and be told of, and by whom.
#[test]
fn info_lists_stops_with_their_witness() {
    let folder = Folder::new();
    let says = [(0.1, false), (5.0, true), (12.0, false)];
    write_with(&folder, "drive.mcap", standstills(&says));
    let log = folder.text("drive.mcap");
    let told = |more: &[&str]| {
        let done = insnav_json([&["info", log.as_str()][..], more].concat());
        assert_eq!(done.code, 0, "{}", done.stderr);
        let stops = done.json()["run"]["stops"].as_array().unwrap().clone();
        let row = |s: &Value| {
            let by = s["seen_by"].as_str().unwrap().to_owned();
            (by, number(s, "begin_s").round(), number(s, "end_s").round())
        };
        stops.iter().map(row).collect::<Vec<_>>()
    };
    let report = run(&folder, "drive.mcap", &[]);
    let found: Vec<_> = stops(&report)
        .iter()
        .map(|s| {
            (
                "detector".to_owned(),
                number(s, "begin_s").round(),
                number(s, "end_s").round(),
            )
        })
        .collect();
    assert!(!found.is_empty());
    assert_eq!(told(&[]), found);
    let topic = ["--topic", "standing=/vehicle/standing"];
    let declared = ["--set", "stationary.detector=none"];
    let settings = ["--set", "stationary.intervals_s=[[14, 20]]"];
    let of = |by: &str, begin, end| (by.to_owned(), begin, end);
    assert_eq!(
        told(&[&topic[..], &declared, &settings].concat()),
        [
            of("topic", 5.0, 12.0),
            of("interval", 14.0, 20.0),
            // Of this one nobody told the run, and it does not look.
            of("gnss_velocity", 70.0, 98.0)
        ]
    );
    // Nobody declares and nobody looks: GNSS velocity alone.
    let alone = told(&declared);
    assert!(
        !alone.is_empty() && alone.iter().all(|(by, ..)| by == "gnss_velocity"),
        "{alone:?}"
    );
    let text = insnav(["info", &log, "--topic", "standing=/vehicle/standing"]).stdout;
    assert!(
        text.contains("found by the detector") || text.contains("declared by the topic"),
        "{text}"
    );
}
