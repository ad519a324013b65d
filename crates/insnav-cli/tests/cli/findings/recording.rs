//! What was recorded: holes, ends, hardly anything, no lever arm.

use super::{
    LEVER_ARM, at, codes, drive, findings, folder_with_drive, truth_table, warning, write_log,
};
use crate::fixture::{Folder, insnav, insnav_json, rewrite};
use insnav_core::sample::Sample;

#[test]
fn a_hole_in_all_topics() {
    let samples: Vec<Sample> = drive()
        .samples
        .iter()
        .copied()
        .filter(|s| !(70.0..87.0).contains(&at(s)))
        .collect();
    let folder = Folder::new();
    write_log(&folder.path("spoilt.mcap"), &samples);
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["recording_gap"], "{found:#?}");
    let evidence = found[0]["evidence"].as_str().unwrap();
    assert!(evidence.contains("70.0–87.0 s (17.0"), "{evidence}");
    assert!(found[0]["consequence"].as_str().unwrap().contains("anew"));
    let out = folder.text("out.mcap");
    let log = folder.text("spoilt.mcap");
    let done = insnav_json(["run", &log, "-o", &out, "--set", LEVER_ARM]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    assert!(warning(&json, "recording_gap").contains("17.0"));
    assert!(warning(&json, "imu_gaps").contains("started anew"));
    std::fs::write(folder.path("truth.csv"), truth_table(0.0)).unwrap();
    let done = insnav_json([
        "compare",
        &out,
        &folder.text("truth.csv"),
        "--from",
        "87",
        "--to",
        "239",
    ]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    // Honest on the other side: three numbers' mean of squares over their sigmas, of one run.
    let nees = json["all"]["nees"]["position"].as_f64().unwrap();
    assert!((0.1..10.0).contains(&nees), "{nees}");
    assert!(
        json["all"]["horizontal_rms_m"].as_f64().unwrap() < 3.0,
        "{}",
        json["all"]
    );
}

#[test]
fn topics_that_end_early() {
    let folder = Folder::new();
    for (ends, topic, inertial) in [(90.0, "/gps/fix", false), (100.0, "/imu/data", true)] {
        let samples: Vec<Sample> = drive()
            .samples
            .iter()
            .copied()
            .filter(|s| s.is_inertial() != inertial || at(s) < ends)
            .collect();
        let name = format!("{inertial}.mcap");
        write_log(&folder.path(&name), &samples);
        let found = findings(&folder, &name, &[]);
        assert!(
            codes(&found).iter().all(|c| *c == "ends_early"),
            "{found:#?}"
        );
        let first = found.iter().map(|f| f["evidence"].as_str().unwrap());
        assert!(first.clone().any(|e| e.starts_with(topic)), "{found:#?}");
        let done = insnav_json([
            "run",
            &folder.text(&name),
            "-o",
            &folder.text("o.mcap"),
            "--force",
        ]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        let json = done.json();
        assert!(warning(&json, "ends_early").contains("before the others"));
        // Without fixes for half a minute the sigma says so.
        let sigma = json["final"]["sigma_horizontal_m"].as_f64().unwrap();
        assert!(inertial || sigma > 2.0, "{sigma}");
    }
}

#[test]
fn logs_of_nothing_and_of_ten_samples() {
    let folder = Folder::new();
    rewrite_empty(&folder);
    let (message, _) = insnav_json(["run", &folder.text("empty.mcap")]).failed(1, "no_imu_topic");
    assert!(message.contains("no topics"), "{message}");
    let done = insnav_json(["info", &folder.text("empty.mcap")]);
    assert_eq!(done.code, 0);
    assert_eq!(done.json()["problem"]["code"], "no_imu_topic");
    let mut imu = 0;
    let ten: Vec<Sample> = drive()
        .samples
        .iter()
        .copied()
        .filter(|s| {
            imu += usize::from(s.is_inertial());
            imu <= 10
        })
        .collect();
    write_log(&folder.path("ten.mcap"), &ten);
    let done = insnav_json(["run", &folder.text("ten.mcap")]);
    let json = done.json();
    // Ten samples are a tenth of a second: either a clear error, or a solution that says that it knows no heading.
    if done.code == 0 {
        assert!(
            warning(&json, "heading_unknown").contains("no heading"),
            "{json:#}"
        );
    } else {
        assert!(
            json["error"]["message"]
                .as_str()
                .is_some_and(|m| m.len() > 20),
            "{json:#}"
        );
    }
    assert_eq!(insnav(["info", &folder.text("ten.mcap")]).code, 0);
}

fn rewrite_empty(folder: &Folder) {
    write_log(&folder.path("drive.mcap"), &drive().samples[..10]);
    rewrite(
        &folder.path("drive.mcap"),
        &folder.path("empty.mcap"),
        |_| Vec::new(),
    );
}

#[test]
fn a_folder_for_a_log() {
    let folder = folder_with_drive();
    let (_, remedy) = insnav_json(["info", &folder.text(".")]).failed(1, "not_readable");
    assert!(
        remedy.contains("folder") && remedy.contains("drive.mcap"),
        "{remedy}"
    );
}

/// An unknown lever arm is not pasted as a measured zero.
#[test]
fn an_unknown_lever_arm_stays_unknown() {
    let folder = folder_with_drive();
    rewrite(&folder.path("drive.mcap"), &folder.path("bare.mcap"), |m| {
        if m.topic == "/tf_static" {
            Vec::new()
        } else {
            vec![m]
        }
    });
    let json = insnav_json(["info", &folder.text("bare.mcap")]).json();
    assert_eq!(json["run"]["lever_arm_known"], false);
    let config = json["run"]["config"].as_str().unwrap();
    let gnss = config
        .split("[gnss]")
        .nth(1)
        .and_then(|t| t.split("[vehicle]").next());
    assert!(
        gnss.is_some_and(|t| t.contains("sigma_scale") && !t.contains("lever_arm")),
        "{config}"
    );
    std::fs::write(folder.path("pasted.toml"), config).unwrap();
    let done = insnav_json([
        "run",
        &folder.text("bare.mcap"),
        "-c",
        &folder.text("pasted.toml"),
    ]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert!(warning(&done.json(), "lever_arm_unknown").contains("not known"));
}
