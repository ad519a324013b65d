//! Everything that can be wrong with a log or a command is said with its place and its remedy.

use crate::fixture::{
    Folder, Raw, drive, insnav, insnav_json, recordings, rewrite, shift_stamp, write_log,
};
use insnav_core::sample::Sample;
use nalgebra::Matrix3;

fn only(kind: fn(&Sample) -> bool) -> Vec<Sample> {
    drive().samples.iter().copied().filter(kind).collect()
}

#[test]
fn no_imu_topic_lists_what_there_is() {
    let folder = Folder::new();
    write_log(&folder.path("drive.mcap"), &only(|s| !s.is_inertial()));
    let (message, remedy) =
        insnav_json(["run", &folder.text("drive.mcap")]).failed(1, "no_imu_topic");
    for part in ["drive.mcap", "/gps/fix", "sensor_msgs/msg/NavSatFix", "Hz"] {
        assert!(message.contains(part), "{part}: {message}");
    }
    assert!(remedy.contains("--topic imu="), "{remedy}");
    assert_eq!(folder.names(), ["drive.mcap"], "nothing is left behind");
}

#[test]
fn no_gnss_topic() {
    let folder = Folder::new();
    write_log(&folder.path("drive.mcap"), &only(Sample::is_inertial));
    let (message, remedy) =
        insnav_json(["run", &folder.text("drive.mcap")]).failed(1, "no_gnss_topic");
    assert!(message.contains("/imu/data"), "{message}");
    for flag in ["--topic gnss=", "--imu-only"] {
        assert!(remedy.contains(flag), "{remedy}");
    }
}

#[test]
fn two_candidates_come_with_a_flag_to_paste_each() {
    let folder = Folder::with_drive();
    rewrite(&folder.path("drive.mcap"), &folder.path("two.mcap"), |m| {
        if m.topic != "/imu/data" {
            return vec![m];
        }
        let other = Raw {
            topic: "/imu/raw".into(),
            log_time: m.log_time,
            data: m.data.clone(),
        };
        vec![m, other]
    });
    let (_, remedy) = insnav_json(["run", &folder.text("two.mcap")]).failed(1, "ambiguous_topic");
    for flag in ["--topic imu=/imu/data", "--topic imu=/imu/raw"] {
        assert!(remedy.contains(flag), "{remedy}");
    }
    // What was offered works.
    let done = insnav(["run", &folder.text("two.mcap"), "--topic", "imu=/imu/raw"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    insnav_json([
        "run",
        &folder.text("two.mcap"),
        "--topic",
        "imu=/imu/other",
        "--force",
    ])
    .failed(1, "unknown_topic");
}

#[test]
fn an_unknown_setting_is_refused_with_the_nearest() {
    let folder = Folder::with_drive();
    std::fs::write(folder.path("car.toml"), "[gnss]\nlever_arm = [0, 0, 0]\n").unwrap();
    let done = insnav_json([
        "run",
        &folder.text("drive.mcap"),
        "-c",
        &folder.text("car.toml"),
    ]);
    let (message, remedy) = done.failed(1, "unknown_config_key");
    assert!(
        message.contains("car.toml") && message.contains("gnss.lever_arm"),
        "{message}"
    );
    assert!(remedy.contains("gnss.lever_arm_b_m"), "{remedy}");
    let done = insnav_json([
        "run",
        &folder.text("drive.mcap"),
        "--set",
        "imu.grad=tactical",
    ]);
    assert!(done.failed(2, "unknown_config_key").1.contains("imu.grade"));
    let done = insnav_json([
        "run",
        &folder.text("drive.mcap"),
        "--set",
        "gnss.sigma_scale=-1",
    ]);
    assert!(
        done.failed(2, "bad_config_value")
            .0
            .contains("--set gnss.sigma_scale=-1")
    );
    let done = insnav_json(["run", &folder.text("drive.mcap"), "--time-offset", "9"]);
    let (message, _) = done.failed(2, "bad_config_value");
    assert!(
        message.contains("--time-offset 9") && message.contains("between -5 and 5"),
        "{message}"
    );
    std::fs::write(folder.path("wide.toml"), "[gnss]\nsigma_scale = -2\n").unwrap();
    let done = insnav_json([
        "info",
        &folder.text("drive.mcap"),
        "-c",
        &folder.text("wide.toml"),
    ]);
    assert!(
        done.failed(1, "bad_config_value")
            .0
            .contains("wide.toml: gnss.sigma_scale = -2")
    );
    insnav_json([
        "run",
        &folder.text("drive.mcap"),
        "-c",
        &folder.text("no.toml"),
    ])
    .failed(1, "config_not_readable");
}

/// All inertial samples for which `bad` says so become NaN.
fn with_nan(bad: impl Fn(usize) -> bool) -> Vec<Sample> {
    let mut samples = drive().samples.clone();
    let inertial = samples.iter_mut().filter_map(|s| {
        if let Sample::Imu(imu) = s {
            Some(imu)
        } else {
            None
        }
    });
    for (_, imu) in inertial.enumerate().filter(|(i, _)| bad(*i)) {
        imu.angular_rate_b.y = f64::NAN;
    }
    samples
}

#[test]
fn some_nan_samples_are_left_out_and_counted() {
    let folder = Folder::new();
    write_log(&folder.path("drive.mcap"), &with_nan(|i| i % 1000 == 500));
    let done = insnav_json(["run", &folder.text("drive.mcap"), "--strict"]);
    assert_eq!(done.code, 3, "warnings under --strict: {}", done.stderr);
    let json = done.json();
    let warning = json["warnings"]
        .as_array()
        .unwrap()
        .iter()
        .find(|w| w["code"] == "not_finite")
        .expect("a warning");
    assert!(
        warning["message"].as_str().unwrap().contains("12 samples"),
        "{warning}"
    );
    // The first, and which kind.
    let message = warning["message"].as_str().unwrap();
    assert!(message.contains("the first at 5.000 s: "), "{message}");
    assert!(
        json["final"]["sigma_horizontal_m"]
            .as_f64()
            .unwrap()
            .is_finite()
    );
}

#[test]
fn an_impossible_covariance_is_told_as_such_and_costs_one_sample() {
    let folder = Folder::new();
    let mut samples = drive().samples.clone();
    let fix = samples
        .iter_mut()
        .filter_map(|s| match s {
            Sample::GnssPosition(fix) => Some(fix),
            _ => None,
        })
        .nth(30)
        .expect("many fixes");
    let at = fix.time.since(drive().trajectory.start());
    // A correlation of 1.5.
    fix.covariance_n = Some(Matrix3::new(2.0, 3.0, 0.0, 3.0, 2.0, 0.0, 0.0, 0.0, 9.0));
    write_log(&folder.path("bad.mcap"), &samples);
    write_log(&folder.path("clean.mcap"), &drive().samples);
    let run = |name: &str| {
        let done = insnav_json(["run", &folder.text(name)]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        done.json()
    };
    let (bad, clean) = (run("bad.mcap"), run("clean.mcap"));
    let told = |json: &serde_json::Value, code: &str| {
        let warnings = json["warnings"].as_array().expect("a list").clone();
        let one = warnings.into_iter().find(|w| w["code"] == code);
        one.map(|w| w["message"].as_str().expect("text").to_owned())
    };
    let message = told(&bad, "impossible_values").expect("a warning");
    for part in [
        "1 sample with a value that cannot be was not used",
        &format!("the first at {at:.3} s: GNSS position covariance is none"),
        "correlation beyond",
    ] {
        assert!(message.contains(part), "{part}: {message}");
    }
    assert_eq!(told(&bad, "not_finite"), None);
    assert_eq!(told(&bad, "unusable_samples"), None);
    assert_eq!(told(&clean, "impossible_values"), None);
    assert_eq!(bad["final"]["time_s"], clean["final"]["time_s"]);
    let used = |json: &serde_json::Value| {
        let aiding = json["aiding"].as_array().expect("a list");
        let of = aiding.iter().find(|a| a["name"] == "gnss_position");
        let of = of.expect("positions");
        ["used", "rejected", "inflated", "reset", "frozen"]
            .iter()
            .map(|key| of[key].as_u64().unwrap_or(0))
            .sum::<u64>()
    };
    assert_eq!(used(&bad) + 1, used(&clean));
}

#[test]
fn nan_in_most_samples_is_an_error() {
    let folder = Folder::new();
    write_log(&folder.path("drive.mcap"), &with_nan(|i| i % 10 != 0));
    let (message, _) = insnav_json(["run", &folder.text("drive.mcap")]).failed(1, "not_finite");
    assert!(message.contains("of 12001"), "{message}");
}

#[test]
fn stamps_that_go_backward_name_both_times() {
    let folder = Folder::with_drive();
    let mut count = 0;
    rewrite(
        &folder.path("drive.mcap"),
        &folder.path("jump.mcap"),
        |mut m| {
            count += usize::from(m.topic == "/imu/data");
            if m.topic == "/imu/data" && count > 6000 {
                shift_stamp(&mut m.data, -10);
            }
            vec![m]
        },
    );
    let (message, remedy) =
        insnav_json(["run", &folder.text("jump.mcap")]).failed(1, "backward_stamps");
    assert!(
        message.contains("/imu/data")
            && message.contains("1704067250.0")
            && message.contains("1704067258.99"),
        "{message}"
    );
    assert!(remedy.contains("--time log"), "{remedy}");
    // What was offered works.
    let done = insnav(["run", &folder.text("jump.mcap"), "--time", "log"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
}

#[test]
fn an_output_that_cannot_be_written() {
    let folder = Folder::with_drive();
    let to = folder.text("no/such/folder/out.mcap");
    let (message, _) = insnav_json(["run", &folder.text("drive.mcap"), "-o", &to])
        .failed(1, "output_not_writable");
    assert!(message.contains("no/such/folder"), "{message}");
}

#[test]
fn the_recording_is_never_the_output() {
    let folder = Folder::with_drive();
    let log = folder.text("drive.mcap");
    let before = std::fs::read(folder.path("drive.mcap")).unwrap();
    insnav_json(["run", &log, "-o", &log, "--force"]).failed(1, "output_is_input");
    assert_eq!(std::fs::read(folder.path("drive.mcap")).unwrap(), before);
}

#[test]
fn an_output_that_exists_is_kept_without_force() {
    let folder = Folder::with_drive();
    std::fs::write(folder.path("drive.insnav.mcap"), "precious").unwrap();
    let (_, remedy) = insnav_json(["run", &folder.text("drive.mcap")]).failed(1, "output_exists");
    assert!(remedy.contains("--force"), "{remedy}");
    assert_eq!(
        std::fs::read_to_string(folder.path("drive.insnav.mcap")).unwrap(),
        "precious"
    );
    assert_eq!(
        insnav(["run", &folder.text("drive.mcap"), "--force"]).code,
        0
    );
    assert_eq!(
        folder.names(),
        ["drive.insnav.mcap", "drive.mcap"],
        "no temporary file is left"
    );
}

#[test]
fn something_else_than_an_mcap() {
    let folder = Folder::new();
    std::fs::write(folder.path("notes.mcap"), "Dear diary,").unwrap();
    let (message, remedy) =
        insnav_json(["run", &folder.text("notes.mcap")]).failed(1, "not_an_mcap");
    assert!(
        message.contains("notes.mcap") && remedy.contains("insnav convert"),
        "{message} {remedy}"
    );
    insnav_json(["run", &folder.text("absent.mcap")]).failed(1, "no_such_file");
    insnav_json(["info", &folder.text("notes.mcap")]).failed(1, "not_an_mcap");
}

#[test]
fn wrong_usage_ends_with_two() {
    for arguments in [
        vec!["run"],
        vec!["fly", "x.mcap"],
        vec!["run", "x.mcap", "--withhold", "every:1"],
        vec!["run", "x.mcap", "--withhold", "20:10"],
        vec!["run", "x.mcap", "--time-offset", "soon"],
        vec!["run", "x.mcap", "--rate", "0"],
        vec!["run", "x.mcap", "--imu-axes", "enu"],
        vec!["compare", "a", "b", "--max", "horizontal_rms_m"],
        vec!["run", "-", "-o", "x.mcap", "--time-offset", "auto"],
        vec!["run", "-"],
        vec!["run", "x.mcap", "-o", "-", "--also", "kml"],
        vec!["run", "x.mcap", "-o", "x.csv"],
        vec!["run", "x.mcap", "-o", "x.KML"],
        vec!["run", "x.mcap", "--jobs", "0"],
        vec!["compare", "a", "b", "--from", "nan"],
        vec!["compare", "a", "b", "--from", "5", "--to", "4"],
        vec!["convert", "a.csv", "-o", "b.mcap", "--t0", "1e30"],
        vec!["convert", "a.csv", "-o", "b.mcap", "--t0", "NaN"],
        vec!["convert", "a.mcap", "-o", "-"],
        vec!["demo", "--dir", "-"],
        vec!["run", "x.mcap", "--save-state", "-"],
        vec!["run", "x.mcap", "--imu-mounting-deg", "yaw=9999"],
    ] {
        insnav_json(&arguments).failed(2, "usage");
        let text = insnav(&arguments);
        assert_eq!((text.code, text.stdout.as_str()), (2, ""), "{arguments:?}");
        assert!(!text.stderr.is_empty());
    }
}

/// Whatever sets a number out of its range, the flag and the range are in the message, and it is wrong usage.
#[test]
fn a_flag_out_of_range_is_named_with_the_range() {
    for (flags, range) in [
        (["--heading-deg", "9999"], "between -360 and 360"),
        (["--heading-deg", "NaN"], "between -360 and 360"),
        (["--latitude-deg", "95"], "between -89 and 89"),
        (["--time-offset", "77"], "between -5 and 5"),
        (["--set", "output.origin=[95, 0, 0]"], "between -89 and 89"),
        (
            ["--set", "output.origin=[59, 500, 0]"],
            "between -360 and 360",
        ),
        (
            ["--set", "alignment.heading_deg=9999"],
            "between -360 and 360",
        ),
    ] {
        let done = insnav_json(["run", "x.mcap", "--imu-only"].into_iter().chain(flags));
        let (message, _) = done.failed(2, "bad_config_value");
        assert!(
            message.contains(&flags.join(" ")) && message.contains(range),
            "{flags:?}: {message}"
        );
    }
}

#[test]
fn colour_never_reaches_a_file() {
    let done = insnav(["run", "absent.mcap"]);
    assert!(
        !done.stderr.contains('\x1b') && done.stderr.starts_with("error: "),
        "{:?}",
        done.stderr
    );
    assert_eq!(done.stdout, "");
}

/// Damaged files end in an error with a code, or in a run; never in a panic (which `insnav` here checks).
#[test]
fn damaged_logs_are_named_not_crashed_on() {
    let Some(broken) = recordings("mcap_real/broken") else {
        return;
    };
    let folder = Folder::new();
    for entry in std::fs::read_dir(broken).expect("readable") {
        let path = entry.expect("an entry").path();
        let to = folder.text("out.mcap");
        let done = insnav_json(["run", &path.display().to_string(), "-o", &to, "--force"]);
        assert!(
            [0, 1].contains(&done.code),
            "{}: {}",
            path.display(),
            done.code
        );
        let json = done.json();
        assert_eq!(
            done.code == 1,
            json["error"]["remedy"].is_string(),
            "{json:#}"
        );
        println!(
            "{}: {} {}",
            path.display(),
            done.code,
            json["error"]["message"]
        );
    }
}
