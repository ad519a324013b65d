//! Standard input and output as files.

use crate::fixture::{Folder, drive, insnav_json, lever_arm, messages};
use insnav_log::LogWriter;
use std::fs::File;
use std::process::{Command, Stdio};

/// Run with a file as standard input and another as standard output.
fn piped(
    arguments: &[&str],
    stdin: Option<&std::path::Path>,
    stdout: Stdio,
) -> (i32, Vec<u8>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_insnav"));
    command
        .args(arguments)
        .stdout(stdout)
        .stderr(Stdio::piped());
    command.stdin(match stdin {
        Some(path) => Stdio::from(File::open(path).expect("readable")),
        None => Stdio::null(),
    });
    let done = command
        .spawn()
        .expect("starts")
        .wait_with_output()
        .expect("ends");
    let text = String::from_utf8(done.stderr).expect("UTF-8");
    assert!(!text.contains("panicked"), "{text}");
    (done.status.code().unwrap_or(-1), done.stdout, text)
}

#[test]
fn from_a_stream_and_into_one_it_is_the_same_file() {
    let folder = Folder::with_drive();
    let (log, out) = (folder.path("drive.mcap"), folder.text("a.mcap"));
    let done = insnav_json(["run", &folder.text("drive.mcap"), "-o", &out]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let (code, _, text) = piped(
        &["run", "-", "-o", &folder.text("b.mcap")],
        Some(&log),
        Stdio::null(),
    );
    assert_eq!(code, 0, "{text}");
    let (code, bytes, text) = piped(
        &["run", "-", "-o", "-", "--format", "json"],
        Some(&log),
        Stdio::piped(),
    );
    assert_eq!(code, 0, "{text}");
    // The solution alone is on standard output, the report beside it.
    std::fs::write(folder.path("c.mcap"), &bytes).unwrap();
    let whole = messages(&folder.path("a.mcap"));
    assert!(whole.len() > 10_000);
    assert!(whole == messages(&folder.path("b.mcap")), "standard input");
    assert!(whole == messages(&folder.path("c.mcap")), "standard output");
    // An index is behind it: it is a whole file. Only the names in the metadata differ.
    assert!(bytes.ends_with(b"\x89MCAP0\r\n"));
    let json = text
        .find('{')
        .map(|at| &text[at..])
        .expect("JSON on standard error");
    let report: serde_json::Value = serde_json::from_str(json).expect("one object");
    assert_eq!(
        (&report["input"], &report["output"]),
        (&"-".into(), &"-".into())
    );
    let done = insnav_json([
        "compare",
        &folder.text("c.mcap"),
        &out,
        "--max",
        "horizontal_rms_m=0",
    ]);
    assert_eq!(done.code, 0, "{}{}", done.stdout, done.stderr);
}

#[test]
fn a_reader_that_goes_away_ends_it_quietly() {
    let folder = Folder::with_drive();
    let log = folder.text("drive.mcap");
    let script = |tail: &str| {
        let insnav = env!("CARGO_BIN_EXE_insnav");
        let text = format!("set -o pipefail; {insnav} {tail}");
        let done = Command::new("bash")
            .args(["-c", &text])
            .output()
            .expect("bash");
        (
            done.status.code(),
            String::from_utf8_lossy(&done.stderr).into_owned(),
        )
    };
    assert_eq!(script(&format!("info {log} 2>/dev/null | true")).0, Some(0));
    let (code, text) = script(&format!(
        "run {log} -o - 2>/dev/null | head -c 10 > /dev/null"
    ));
    assert_eq!(code, Some(141), "{text}");
    let (_, text) = script(&format!("run {log} -o - | head -c 10 > /dev/null"));
    assert!(!text.contains("error"), "{text}");
}

/// Every write to /dev/full fails for want of room.
#[test]
fn a_full_standard_output_is_an_error() {
    let full = std::path::Path::new("/dev/full");
    if !full.exists() {
        println!("SKIPPED: there is no /dev/full");
        return;
    }
    let folder = Folder::with_drive();
    let log = folder.text("drive.mcap");
    let open = || Stdio::from(File::options().write(true).open(full).expect("writable"));
    for arguments in [
        vec!["info", log.as_str()],
        vec!["info", log.as_str(), "--format", "json"],
        vec!["run", log.as_str(), "-o", "-"],
        vec!["completions", "bash"],
    ] {
        let (code, _, text) = piped(&arguments, None, open());
        assert_eq!(code, 1, "{arguments:?}: {text}");
        assert!(text.contains("No space left"), "{arguments:?}: {text}");
    }
}

/// What a recorder does: fixes come 0.3 s after the inertial samples of their time, and shuffled.
#[test]
fn late_and_shuffled_fixes_change_no_bit() {
    let folder = Folder::with_drive();
    let mut writer = LogWriter::create(&folder.path("late.mcap"), lever_arm()).unwrap();
    let (mut held, mut late) = (Vec::new(), 0);
    for sample in &drive().samples {
        if !sample.is_inertial() {
            held.push(*sample);
            continue;
        }
        // Two instants of fixes and more come together, the newest first.
        let now = sample.time();
        if held.len() > 3 && now.since(held[0].time()) >= 0.3 {
            late += held.len();
            for fix in held.drain(..).rev() {
                writer.write_recorded(&fix, now).unwrap();
            }
        }
        writer.write(sample).unwrap();
    }
    let end = drive().samples.last().expect("a drive").time().plus(0.3);
    for fix in held.iter().rev() {
        writer.write_recorded(fix, end).unwrap();
    }
    writer.finish().unwrap();
    assert!(late > 1000, "{late} fixes came late");
    let run = |log: &str, out: &str| {
        let (log, out) = (folder.text(log), folder.text(out));
        let done = insnav_json(["run", &log, "-o", &out, "--rate", "imu"]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        done.json()
    };
    let in_order = |name: &str| {
        let mut all = messages(&folder.path(name));
        all.retain(|m| m.0.starts_with("/insnav"));
        all
    };
    let (sorted, shuffled) = (run("drive.mcap", "a.mcap"), run("late.mcap", "b.mcap"));
    assert_eq!(sorted["aiding"], shuffled["aiding"]);
    assert!(in_order("a.mcap") == in_order("b.mcap"));
    let warned = |report: &serde_json::Value| report["warnings"].to_string();
    assert!(!warned(&shuffled).contains("late_aiding"), "{shuffled:#}");
}

/// The drive with its fixes recorded so much later than they are stamped, those whose number `which` wants.
fn with_latency(folder: &Folder, seconds: f64, which: fn(usize) -> bool) -> String {
    let mut all: Vec<_> = drive().samples.iter().map(|s| (s.time(), *s)).collect();
    let fixes = all.iter_mut().filter(|(_, s)| !s.is_inertial());
    for (_, (recorded, _)) in fixes.enumerate().filter(|(i, _)| which(*i)) {
        *recorded = recorded.plus(seconds);
    }
    all.sort_by_key(|(recorded, _)| *recorded);
    let mut writer = LogWriter::create(&folder.path("late.mcap"), lever_arm()).unwrap();
    for (recorded, sample) in all {
        writer.write_recorded(&sample, recorded).unwrap();
    }
    writer.finish().unwrap();
    folder.text("late.mcap")
}

/// What comes later than anybody waits for is lost, but not in silence.
#[test]
fn fixes_that_come_much_too_late_are_counted() {
    let folder = Folder::new();
    let log = with_latency(&folder, 5.0, |i| i % 50 == 3);
    let done = insnav_json(["run", &log]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report = done.json();
    let warnings = report["warnings"].as_array().unwrap();
    let late = warnings.iter().find(|w| w["code"] == "late_aiding");
    let text = late.expect("a warning")["message"].as_str().unwrap();
    let count: u64 = text.split(' ').next().unwrap().parse().unwrap();
    let fixes = drive().samples.iter().filter(|s| !s.is_inertial()).count() as u64;
    // The last ones find their places, since nothing comes after them.
    assert!(count.abs_diff(fixes / 50) <= 2, "{count} of {fixes}");
}
