//! A drive in parts: put aside and gone on with, the output is that of one run.

use crate::fixture::{Folder, drive, insnav_json, messages, recordings, rewrite, write_log};
use insnav_core::sample::Sample;
use insnav_core::time::Time;
use insnav_log::cdr::{CdrWriter, Endian};
use insnav_log::ros2::{Encode, Header, TfMessage, TransformStamped};

/// Cut `drive.mcap` in two at a log time, s after the begin: `a.mcap` and `b.mcap`.
fn cut(folder: &Folder, at_s: f64) {
    cut_at(folder, drive().samples[0].time(), at_s);
}

fn cut_at(folder: &Folder, begin: Time, at_s: f64) {
    let at = begin.plus(at_s).0 as u64;
    let drive = folder.path("drive.mcap");
    for (name, first) in [("a.mcap", true), ("b.mcap", false)] {
        rewrite(&drive, &folder.path(name), |m| {
            if (m.log_time < at) == first {
                vec![m]
            } else {
                vec![]
            }
        });
    }
}

/// The settings of the run over the first part, complete: what a whole run needs to choose nothing by itself.
fn complete_settings(folder: &Folder, more: &[&str]) -> String {
    let mut arguments = vec!["run", "--print-config"];
    let log = folder.text("a.mcap");
    arguments.push(&log);
    arguments.extend(more);
    let done = insnav_json(arguments);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let path = folder.path("car.toml");
    std::fs::write(&path, done.json()["config"].as_str().unwrap()).unwrap();
    path.display().to_string()
}

fn run(folder: &Folder, log: &str, out: &str, more: &[&str]) -> serde_json::Value {
    let (log, out) = (folder.text(log), folder.text(out));
    let mut arguments = vec!["run", &log, "-o", &out];
    arguments.extend(more);
    let done = insnav_json(arguments);
    assert_eq!(done.code, 0, "{}", done.stderr);
    done.json()
}

/// What one run over the whole writes, two runs write one after the other: every message of every topic, its sequence number
/// too. Cut before the start is found, shortly after, and under way; with fixes withheld by their number as well.
#[test]
fn two_parts_are_one_run_to_the_last_bit() {
    for (at_s, more) in [
        (12.0, vec![]),
        (45.3, vec!["--withhold", "every:3"]),
        (80.0051, vec!["--rate", "imu", "--time-offset", "0.013"]),
    ] {
        let folder = Folder::with_drive();
        cut(&folder, at_s);
        let settings = complete_settings(&folder, &more);
        let state = folder.text("run.state");
        let same: Vec<&str> = [&more[..], &["-c", &settings]].concat();
        let saving: Vec<&str> = [&same[..], &["--save-state", &state]].concat();
        let resuming: Vec<&str> = [&same[..], &["--resume", &state]].concat();
        let whole = run(&folder, "drive.mcap", "whole.mcap", &same);
        let first = run(&folder, "a.mcap", "a.out.mcap", &saving);
        let second = run(&folder, "b.mcap", "b.out.mcap", &resuming);

        let one = messages(&folder.path("whole.mcap"));
        let mut two = messages(&folder.path("a.out.mcap"));
        let in_first = two.len();
        two.extend(messages(&folder.path("b.out.mcap")));
        assert_eq!(one.len(), two.len(), "cut at {at_s} s");
        for (i, (a, b)) in one.iter().zip(&two).enumerate() {
            assert!(a == b, "message {i} of {}: {} at {}", one.len(), a.0, a.1);
        }
        // The check can fail: the parts alone are not the whole, and the first one stops where its window begins.
        assert!(in_first < one.len() && (at_s < 40.0 || in_first > one.len() / 4));
        assert_eq!(second["final"], whole["final"]);
        assert_eq!(second["aiding"], whole["aiding"]);
        assert_eq!(second["alignment"], whole["alignment"]);
        assert_eq!(second["imu_samples"], whole["imu_samples"]);
        assert_eq!(second["withheld"], whole["withheld"]);
        assert_eq!(second["stops"], whole["stops"], "cut at {at_s} s");
        assert_eq!(second["distance_m"], whole["distance_m"]);
        assert!(first["imu_samples"].as_u64() < whole["imu_samples"].as_u64());
    }
}

/// A stop that the user knows, across the cut: each part is given the intervals of the whole drive.
#[test]
fn a_declared_stop_goes_on_in_the_next_part() {
    let folder = Folder::with_drive();
    cut(&folder, 12.0);
    let known = [
        "--stop",
        "5:20,100:110",
        "--set",
        "stationary.detector=none",
    ];
    let settings = complete_settings(&folder, &known);
    let state = folder.text("run.state");
    // The interval beyond the first part's end is for the second: no warning.
    let same = ["-c", settings.as_str(), "--stop", "5:20,100:110"];
    let whole = run(&folder, "drive.mcap", "whole.mcap", &same);
    let saving = [&same[..], &["--save-state", &state]].concat();
    let first = run(&folder, "a.mcap", "a.out.mcap", &saving);
    let resuming = [&same[..], &["--resume", &state]].concat();
    let second = run(&folder, "b.mcap", "b.out.mcap", &resuming);
    assert_eq!(second["stops"], whole["stops"]);
    assert!((whole["stops"][0]["end_s"].as_f64().unwrap() - 20.0).abs() < 0.02);
    let told = |report: &serde_json::Value| report["warnings"].to_string();
    for report in [&first, &second] {
        assert!(!told(report).contains("stop_outside"), "{}", told(report));
    }
    // Other intervals than the first part had are refused, with what to do and the file.
    let log = folder.text("b.mcap");
    let other = insnav_json([
        "run",
        &log,
        "-c",
        &settings,
        "--stop",
        "5:20,100:110,112:115",
        "--resume",
        &state,
        "-o",
        &folder.text("x.mcap"),
    ]);
    let (message, remedy) = other.failed(1, "state_settings");
    assert!(
        message.contains(&state) && message.contains("stationary.intervals_s"),
        "{message}"
    );
    assert!(remedy.contains("zero of its first part"), "{remedy}");
    // The last part: what is beyond it is beyond all.
    let late = [
        "--stop",
        "5:20,500:600",
        "--set",
        "stationary.detector=none",
    ];
    run(
        &folder,
        "a.mcap",
        "a.out.mcap",
        &[&late[..], &["--save-state", &state, "--force"]].concat(),
    );
    let last = run(
        &folder,
        "b.mcap",
        "b.out.mcap",
        &[&late[..], &["--resume", &state, "--force"]].concat(),
    );
    assert!(told(&last).contains("500:600"), "{}", told(&last));
    assert!(!told(&last).contains("5:20 s"), "{}", told(&last));
}

/// A real car, cut in the middle of a turn, with the clocks found in the first part.
#[test]
fn a_real_drive_in_two_parts() {
    let Some(recording) = recordings("rtkexp_drive_0708") else {
        return;
    };
    let folder = Folder::new();
    let (from, to) = (recording.display().to_string(), folder.text("drive.mcap"));
    let done = insnav_json(["convert", &from, "-o", &to]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    cut_at(&folder, Time::from_seconds(1.6e9), 300.0);
    let state = folder.text("run.state");
    let auto = [
        "--time-offset",
        "auto",
        "--force",
        "--set",
        "gnss.lever_arm_b_m=[0.5, 0, -1]",
    ];
    let saving: Vec<&str> = [&auto[..], &["--save-state", &state]].concat();
    let first = run(&folder, "a.mcap", "a.out.mcap", &saving);
    assert!(
        first["time_offset_s"]["sigma"].is_number(),
        "found in the first part"
    );
    let second = run(
        &folder,
        "b.mcap",
        "b.out.mcap",
        &[
            "--resume",
            &state,
            "--set",
            "gnss.lever_arm_b_m=[0.5, 0, -1]",
        ],
    );
    assert_eq!(first["time_offset_s"], second["time_offset_s"]);
    // One run with what the first part chose.
    std::fs::write(folder.path("car.toml"), first["config"].as_str().unwrap()).unwrap();
    let settings = folder.text("car.toml");
    run(&folder, "drive.mcap", "whole.mcap", &["-c", &settings]);
    let mut parts = messages(&folder.path("a.out.mcap"));
    parts.extend(messages(&folder.path("b.out.mcap")));
    let whole = messages(&folder.path("whole.mcap"));
    assert!(whole.len() > 100_000 && parts == whole);
}

/// Clocks, noise and lever arm stay as the first part chose them, although the second has no transforms and other noise.
#[test]
fn what_the_first_part_chose_stays() {
    let folder = Folder::with_drive();
    cut(&folder, 70.0);
    let state = folder.text("run.state");
    let first = run(&folder, "a.mcap", "a.out.mcap", &["--save-state", &state]);
    let second = run(&folder, "b.mcap", "b.out.mcap", &["--resume", &state]);
    assert_eq!(first["config"], second["config"]);
    assert_eq!(first["lever_arm_b_m"], second["lever_arm_b_m"]);
    // Alone the second part chooses otherwise.
    let alone = run(&folder, "b.mcap", "alone.mcap", &[]);
    assert_ne!(alone["config"], second["config"]);
    // The map is that of the first part, whose first fix is its origin.
    let origin = |name: &str| {
        let solution = insnav_log::SolutionTable::read(&folder.path(name)).unwrap();
        solution.metadata["origin_lat_lon_deg_h_m"].clone()
    };
    assert_eq!(origin("a.out.mcap"), origin("b.out.mcap"));
    assert_ne!(origin("a.out.mcap"), origin("alone.mcap"));
}

#[test]
fn a_state_is_refused_where_it_does_not_fit() {
    let folder = Folder::with_drive();
    cut(&folder, 60.0);
    let (state, b) = (folder.text("run.state"), folder.text("b.mcap"));
    run(&folder, "a.mcap", "a.out.mcap", &["--save-state", &state]);
    let to = folder.text("b.out.mcap");
    let resume = |state: &str, more: &[&str]| {
        let mut arguments = vec!["run", b.as_str(), "-o", to.as_str(), "--resume", state];
        arguments.extend(more);
        insnav_json(arguments)
    };
    let (message, _) = resume(&state, &["--set", "gnss.sigma_scale=2"]).failed(1, "state_settings");
    for part in ["gnss.sigma_scale", "auto", "2.0", &state] {
        assert!(message.contains(part), "{message}");
    }
    let (message, _) = resume(&state, &["--imu-axes", "frd"]).failed(1, "state_settings");
    assert!(
        message.contains("Flu") && message.contains("Frd"),
        "{message}"
    );
    resume(&state, &["--withhold", "every:2"]).failed(1, "state_settings");
    resume(&folder.text("no.state"), &[]).failed(1, "no_such_file");

    let bytes = std::fs::read(folder.path("run.state")).unwrap();
    let changed = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut other = bytes.clone();
        change(&mut other);
        std::fs::write(folder.path("other.state"), other).unwrap();
        folder.text("other.state")
    };
    resume(&changed(&|b| b[3] ^= 1), &[]).failed(1, "not_a_state");
    resume(&changed(&|b| b[16] += 1), &[]).failed(1, "state_version");
    resume(&changed(&|b| b[20] ^= 1), &[]).failed(1, "state_version");
    resume(&changed(&|b| b.clear()), &[]).failed(1, "not_a_state");
    resume(&changed(&|b| b.push(0)), &[]).failed(1, "state_damaged");
    // Any bit behind the header, and any cut.
    for i in (24..bytes.len()).step_by(bytes.len() / 23) {
        resume(&changed(&|b| b[i] ^= 16), &[]).failed(1, "state_damaged");
        resume(&changed(&|b| b.truncate(i)), &[]).failed(1, "state_damaged");
    }
    assert!(!folder.path("b.out.mcap").exists(), "nothing was written");
    assert_eq!(resume(&state, &[]).code, 0, "and the whole one is taken");
}

#[test]
fn a_state_does_not_take_the_place_of_a_file_unasked() {
    let folder = Folder::with_drive();
    cut(&folder, 60.0);
    std::fs::write(folder.path("run.state"), "precious").unwrap();
    let (state, log) = (folder.text("run.state"), folder.text("a.mcap"));
    let (_, remedy) = insnav_json(["run", &log, "--save-state", &state]).failed(1, "output_exists");
    assert!(
        remedy.contains("--save-state") && !remedy.contains("-o"),
        "{remedy}"
    );
    assert_eq!(
        std::fs::read(folder.path("run.state")).unwrap(),
        b"precious"
    );
    let same = insnav_json(["run", &log, "--save-state", &log, "--force"]);
    let (_, remedy) = same.failed(1, "output_is_input");
    assert!(remedy.contains("--save-state"), "{remedy}");
    insnav_json(["run", &log, &folder.text("b.mcap"), "--save-state", &state]).failed(2, "usage");
    // In a loop over the parts one name is enough.
    run(
        &folder,
        "a.mcap",
        "a.out.mcap",
        &["--save-state", &state, "--force"],
    );
    run(
        &folder,
        "b.mcap",
        "b.out.mcap",
        &["--resume", &state, "--save-state", &state],
    );
}

/// The same log again: its samples are in the past of the run.
#[test]
fn a_part_that_was_there_already_is_an_error() {
    let folder = Folder::with_drive();
    cut(&folder, 60.0);
    let (state, log) = (folder.text("run.state"), folder.text("a.mcap"));
    run(&folder, "a.mcap", "a.out.mcap", &["--save-state", &state]);
    let again = insnav_json([
        "run",
        &log,
        "-o",
        &folder.text("x.mcap"),
        "--resume",
        &state,
    ]);
    again.failed(1, "backward_stamps");
    assert!(!folder.path("x.mcap").exists());
}

/// A tunnel: a part without a single fix.
#[test]
fn a_part_may_have_no_gnss() {
    let folder = Folder::with_drive();
    cut(&folder, 60.0);
    let begin = drive().samples[0].time();
    let in_tunnel = |s: &Sample| s.is_inertial() && s.time().since(begin) >= 60.0;
    let tunnel: Vec<Sample> = drive().samples.iter().copied().filter(in_tunnel).collect();
    write_log(&folder.path("tunnel.mcap"), &tunnel);
    let state = folder.text("run.state");
    run(&folder, "a.mcap", "a.out.mcap", &["--save-state", &state]);
    let report = run(&folder, "tunnel.mcap", "t.out.mcap", &["--resume", &state]);
    assert!((report["duration_s"].as_f64().unwrap() - 120.0).abs() < 0.1);
}

/// A recorder writes static transforms once: the mounting of the first part holds for the next, which has none.
#[test]
fn the_mounting_of_the_first_part_stays() {
    let folder = Folder::with_drive();
    let header = |stamp, frame_id| Header { stamp, frame_id };
    let stamp = drive().samples[0].time();
    let (s, c) = 2.5_f64.to_radians().sin_cos();
    let transforms = [
        TransformStamped {
            header: header(stamp, "imu_link"),
            child_frame_id: "gps",
            translation: nalgebra::Vector3::new(0.3, 0.4, 1.2),
            rotation: [0.0, 0.0, 0.0, 1.0],
        },
        TransformStamped {
            header: header(stamp, "base_link"),
            child_frame_id: "imu_link",
            translation: nalgebra::Vector3::zeros(),
            rotation: [0.0, 0.0, s, c],
        },
    ];
    let mut cdr = CdrWriter::new(Endian::Little);
    let message = TfMessage {
        transforms: &transforms,
    };
    message.write(&mut cdr);
    std::fs::rename(folder.path("drive.mcap"), folder.path("plain.mcap")).unwrap();
    let (from, to) = (folder.path("plain.mcap"), folder.path("drive.mcap"));
    rewrite(&from, &to, |mut m| {
        if m.topic == "/tf_static" {
            m.data = cdr.bytes().to_vec();
        }
        vec![m]
    });
    cut(&folder, 70.0);
    let state = folder.text("run.state");
    let first = run(&folder, "a.mcap", "a.out.mcap", &["--save-state", &state]);
    let second = run(&folder, "b.mcap", "b.out.mcap", &["--resume", &state]);
    let yaw = first["imu_mounting"]["rpy_deg"][2].as_f64().unwrap();
    assert!((yaw - 5.0).abs() < 1e-9, "{yaw}");
    assert_eq!(first["imu_mounting"], second["imu_mounting"]);
    std::fs::write(folder.path("car.toml"), first["config"].as_str().unwrap()).unwrap();
    let settings = folder.text("car.toml");
    run(&folder, "drive.mcap", "whole.mcap", &["-c", &settings]);
    let mut parts = messages(&folder.path("a.out.mcap"));
    parts.extend(messages(&folder.path("b.out.mcap")));
    assert!(parts == messages(&folder.path("whole.mcap")));
}
