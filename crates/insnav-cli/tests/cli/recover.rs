//! Damaged logs: refused with the place and the remedy, or recovered with an account of what was lost.

use crate::fixture::{Folder, insnav, insnav_json};

/// The drive, cut off after some of its bytes.
fn cut(share: f64) -> Folder {
    let folder = Folder::with_drive();
    let bytes = std::fs::read(folder.path("drive.mcap")).unwrap();
    let kept = (bytes.len() as f64 * share) as usize;
    std::fs::write(folder.path("cut.mcap"), &bytes[..kept]).unwrap();
    folder
}

#[test]
fn a_truncated_log_is_refused_with_its_place_and_the_flag() {
    let folder = cut(0.7);
    for verb in ["run", "info"] {
        let done = insnav_json([verb, &folder.text("cut.mcap")]);
        let (message, remedy) = done.failed(1, "truncated");
        assert!(
            message.contains("chunk at byte") && message.contains("cut.mcap"),
            "{message}"
        );
        assert!(remedy.contains("--recover"), "{remedy}");
    }
    assert_eq!(folder.names(), ["cut.mcap", "drive.mcap"]);
}

#[test]
fn a_truncated_log_is_recovered_on_demand() {
    let folder = cut(0.7);
    let (cut, whole) = (folder.text("cut.mcap"), folder.text("drive.mcap"));
    let done = insnav_json(["run", &cut, "--recover", "--time-offset", "0"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    let recovered = json["warnings"]
        .as_array()
        .unwrap()
        .iter()
        .find(|w| w["code"] == "recovered")
        .unwrap_or_else(|| panic!("{json:#}"));
    let message = recovered["message"].as_str().unwrap();
    assert!(
        message.contains("cut off by the end of the file") && message.contains("messages kept"),
        "{message}"
    );
    assert!(done.stderr.contains(message), "{}", done.stderr);
    let samples = |file: &str| {
        let done = insnav_json(["info", file, "--recover"]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        done.json()["run"]["imu_samples"].as_u64().unwrap()
    };
    let (some, all) = (samples(&cut), samples(&whole));
    assert_eq!(json["imu_samples"], some);
    assert!(some > all / 2 && some < all, "{some} of {all}");

    // Warnings are for --strict to turn into an exit code; a whole file has none of this kind.
    let strict = insnav(["info", &cut, "--recover", "--strict"]);
    assert_eq!(strict.code, 3);
    let whole = insnav_json(["info", &whole, "--recover"]).json();
    assert!(!whole.to_string().contains("recovered"), "{whole:#}");
    assert_eq!(whole["checksums"], "all");

    let done = insnav_json(["convert", &cut, "-o", &folder.text("tables"), "--recover"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert_eq!(done.json()["imu_samples"], some);
    assert_eq!(done.json()["warnings"][0]["code"], "recovered");
}
