//! Real recordings, where they are at hand.

use crate::fixture::{Folder, insnav_json, recordings};

/// Both clocks of the RTK drive, as known from other programs: the IMU's against position −0.21 ± 0.03 s, and the receiver's
/// velocity 0.128 ± 0.02 s behind its own position.
#[test]
fn clocks_of_the_rtk_drive_are_found_and_used() {
    let Some(log) = recordings("mcap_real/rtkexp_drive_ros2_zstd.mcap") else {
        return;
    };
    let Some(gnss) = recordings("rtkexp_drive_0708/gnss.csv.gz") else {
        return;
    };
    let folder = Folder::new();
    let out = folder.text("rtk.insnav.mcap");
    let done = insnav_json([
        "run",
        &log.display().to_string(),
        "-o",
        &out,
        "--time-offset",
        "auto",
        "--withhold",
        "every:2",
    ]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    let estimate = |key: &str| {
        (
            json[key]["value"].as_f64().unwrap(),
            json[key]["sigma"].as_f64().unwrap(),
        )
    };
    let (offset, sigma) = estimate("time_offset_s");
    assert!(
        (offset + 0.21).abs() < 0.03 && sigma < 0.03,
        "{offset} ± {sigma}"
    );
    let (lag, sigma) = estimate("gnss_velocity_lag_s");
    assert!(
        (lag - 0.128).abs() < 0.02 && sigma < 0.02,
        "{lag} ± {sigma}"
    );
    assert_eq!(json["withheld"], 1098);
    // The other half, of positions and of velocities, is used: bars on withheld fixes mean little without them.
    for name in ["gnss_position", "gnss_velocity"] {
        let aiding = json["aiding"].as_array().unwrap();
        let aid = aiding.iter().find(|a| a["name"] == name).expect(name);
        let looked_at: u64 = ["used", "inflated", "rejected"]
            .iter()
            .map(|k| aid[k].as_u64().unwrap())
            .sum();
        // While it is told that the vehicle stands, the filter leaves out velocities: every second one of four a second is withheld.
        let stops = json["stops"].as_array().unwrap();
        let held = |s: &serde_json::Value| {
            s["end_s"].as_f64().unwrap() - s["held_from_s"].as_f64().unwrap()
        };
        let left_out = match name {
            "gnss_velocity" => stops.iter().map(held).sum::<f64>() * 2.0,
            _ => 0.0,
        };
        assert!(
            looked_at as f64 + left_out > 1080.0,
            "{name}: {looked_at} and {left_out} in stops"
        );
    }
    assert_eq!(json["alignment"]["heading_source"], "course_velocity");

    let done = insnav_json(["compare", &out, &gnss.display().to_string(), "--course"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    assert_eq!(json["reference_at_antenna"], true);
    println!("withheld: {:#}", json["withheld"]);
    assert!(
        json["withheld"]["count"].as_u64().unwrap() > 1080,
        "{}",
        json["withheld"]
    );
}

/// Without being asked to, a run tells of the clocks and does not touch them.
#[test]
fn clocks_are_told_but_not_used_unasked() {
    let Some(log) = recordings("mcap_real/rtkexp_drive_ros2_zstd.mcap") else {
        return;
    };
    let folder = Folder::new();
    let done = insnav_json([
        "run",
        &log.display().to_string(),
        "-o",
        &folder.text("out.mcap"),
        "--strict",
    ]);
    assert_eq!(done.code, 3, "{}", done.stderr);
    let json = done.json();
    assert_eq!(json["time_offset_s"]["value"], 0.0);
    let codes: Vec<&str> = json["warnings"]
        .as_array()
        .unwrap()
        .iter()
        .map(|w| w["code"].as_str().unwrap())
        .collect();
    assert!(
        codes.contains(&"time_offset") && codes.contains(&"velocity_lag"),
        "{codes:?}"
    );
}
