//! Outputs: looked at before the work, whole or not there, whatever ends the program.

use crate::fixture::{Folder, insnav, insnav_json};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

#[test]
fn a_bad_output_is_said_before_the_log_is_read() {
    let folder = Folder::with_drive();
    // A log that would fail as soon as it is opened.
    std::fs::write(folder.path("drive.mcap"), "Dear diary,").unwrap();
    let log = folder.text("drive.mcap");
    std::fs::write(folder.path("there.mcap"), "precious").unwrap();
    let run = |to: &str| insnav_json(["run", &log, "-o", &folder.text(to)]);
    run("there.mcap").failed(1, "output_exists");
    run("no/such/out.mcap").failed(1, "output_not_writable");
    run("there.mcap/out.mcap").failed(1, "output_not_writable");
    run("fine.mcap").failed(1, "not_an_mcap");
    assert_eq!(folder.names(), ["drive.mcap", "there.mcap"]);
}

/// A limit on the size of files stands for a full disk: both fail in the middle of writing.
#[test]
fn a_write_that_fails_names_the_file_and_leaves_nothing() {
    let folder = Folder::with_drive();
    let insnav = env!("CARGO_BIN_EXE_insnav");
    let (log, to) = (folder.text("drive.mcap"), folder.text("out.mcap"));
    let script = format!("ulimit -f 300; {insnav} run {log} -o {to} --format json");
    let done = Command::new("bash")
        .args(["-c", &script])
        .output()
        .expect("bash");
    let text = String::from_utf8_lossy(&done.stdout);
    assert_eq!(done.status.code(), Some(1), "{text}");
    let json: serde_json::Value = serde_json::from_str(&text).expect("one object");
    let error = &json["error"];
    assert_eq!(error["code"], "output_not_writable");
    let message = error["message"].as_str().unwrap();
    assert!(
        message.contains("out.mcap") && message.contains("File too large"),
        "{message}"
    );
    assert!(error["remedy"].as_str().unwrap().contains("room"));
    assert_eq!(folder.names(), ["drive.mcap"]);
}

/// How a run ends that is interrupted while it writes, and what is left of it.
fn interrupted(signal: &str) -> (Option<i32>, Vec<String>) {
    let folder = Folder::with_drive();
    let (log, to) = (folder.text("drive.mcap"), folder.text("out.mcap"));
    let mut child = Command::new(env!("CARGO_BIN_EXE_insnav"))
        .args(["run", &log, "-o", &to, "--rate", "imu"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("starts");
    // The check of the output makes the file for a moment too: wait until it has grown.
    let grown = || {
        std::fs::read_dir(folder.path("")).is_ok_and(|all| {
            all.flatten().any(|e| {
                e.file_name().to_string_lossy().ends_with(".partial")
                    && e.metadata().is_ok_and(|m| m.len() > 0)
            })
        })
    };
    let begin = Instant::now();
    while !grown() && begin.elapsed() < Duration::from_secs(60) {
        let ended = child.try_wait().expect("waits");
        assert!(ended.is_none(), "the run ended before it was interrupted");
        std::thread::sleep(Duration::from_millis(1));
    }
    let id = child.id().to_string();
    let killed = Command::new("kill").args([signal, &id]).status();
    assert!(killed.expect("kill").success());
    let code = child.wait().expect("ends").code();
    (code, folder.names())
}

#[test]
fn an_interrupted_run_leaves_nothing_behind() {
    for (signal, code) in [("-INT", 130), ("-TERM", 143)] {
        let (ended, names) = interrupted(signal);
        assert_eq!(ended, Some(code));
        assert_eq!(names, ["drive.mcap"]);
    }
}

#[test]
fn withholding_everything_is_named_as_the_cause() {
    let folder = Folder::with_drive();
    let log = folder.text("drive.mcap");
    let (message, remedy) =
        insnav_json(["run", &log, "--withhold", "-10:1e6"]).failed(1, "all_withheld");
    assert!(
        message.contains("withheld") && remedy.contains("--withhold"),
        "{message}"
    );
}

#[test]
fn a_folder_in_place_of_a_file_is_said() {
    let folder = Folder::with_drive();
    std::fs::create_dir(folder.path("sub")).unwrap();
    let (log, sub, x) = (
        folder.text("drive.mcap"),
        folder.text("sub"),
        folder.text("x.mcap"),
    );
    for arguments in [
        vec!["info", &sub],
        vec!["compare", &sub, &log],
        vec!["run", &log, "-c", &sub],
        vec!["run", &log, "--resume", &sub],
        vec!["simulate", &sub, "-o", &x],
        vec!["run", &log, "-o", &x, "--save-state", &sub],
    ] {
        let done = insnav_json(&arguments);
        assert_eq!(done.code, 1, "{arguments:?}");
        let error = &done.json()["error"];
        let text = |key: &str| error[key].as_str().unwrap().to_lowercase();
        assert!(
            text("message").contains("is a directory"),
            "{arguments:?}: {error}"
        );
        assert!(text("remedy").contains("folder"), "{arguments:?}: {error}");
    }
    assert_eq!(folder.names(), ["drive.mcap", "sub"]);
}

#[test]
fn shells_and_manuals() {
    for (shell, part) in [
        ("bash", "complete -F _insnav"),
        ("zsh", "#compdef insnav"),
        ("fish", "complete -c insnav"),
        ("elvish", "edit:completion"),
        ("powershell", "Register-ArgumentCompleter"),
    ] {
        let done = insnav(["completions", shell]);
        assert_eq!(done.code, 0);
        assert!(
            done.stdout.contains(part) && done.stdout.contains("withhold"),
            "{shell}"
        );
    }
    let page = insnav(["man", "run"]).stdout;
    assert!(
        page.contains(".TH insnav-run") && page.contains("save\\-state"),
        "{page}"
    );
    assert!(
        insnav(["man"]).stdout.contains("simulate") || insnav(["man"]).stdout.contains("compare")
    );
    insnav_json(["man", "fly"]).failed(2, "usage");
}

#[test]
fn the_settings_of_a_run_can_be_had_alone() {
    let folder = Folder::with_drive();
    let done = insnav(["run", &folder.text("drive.mcap"), "--print-config"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let config = insnav_log::parse_config(&done.stdout, "printed", &[]).unwrap();
    assert!(config.imu.grade.is_some() && config.gnss.lever_arm_b_m == Some([0.3, -0.4, -1.2]));
    assert_eq!(folder.names(), ["drive.mcap"], "nothing was run");
}

/// On a terminal one sees how far it is, without colour; in a pipe nothing of it is left.
#[test]
fn progress_is_for_terminals() {
    let folder = Folder::with_drive();
    let (log, to) = (folder.text("drive.mcap"), folder.text("out.mcap"));
    let piped = insnav(["run", &log, "-o", &to]);
    assert_eq!(piped.code, 0);
    assert!(!piped.stderr.contains("(pass 1)"), "{}", piped.stderr);
    let command = format!("{} run {log} -o {to} --force", env!("CARGO_BIN_EXE_insnav"));
    let script = Command::new("script")
        .args(["-qec", &command, "/dev/null"])
        .env("NO_COLOR", "1")
        .env("TERM", "xterm")
        .stdin(Stdio::null())
        .output();
    let Ok(done) = script else {
        println!("SKIPPED: there is no `script` to make a terminal with");
        return;
    };
    let text = String::from_utf8_lossy(&done.stdout);
    assert!(done.status.success() && text.contains("(pass 1)"), "{text}");
    assert!(
        !text.contains("\x1b[3") && !text.contains("\x1b[1"),
        "{text:?}"
    );
}
