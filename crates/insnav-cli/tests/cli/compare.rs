//! A solution against a reference.

use crate::fixture::{Folder, insnav, insnav_json, truth_table};
use serde_json::Value;

/// The drive, run with every second fix withheld, and its truth with `north_m` added.
fn prepared(north_m: f64) -> Folder {
    let folder = Folder::with_drive();
    assert_eq!(
        insnav(["run", &folder.text("drive.mcap"), "--withhold", "every:2"]).code,
        0
    );
    std::fs::write(folder.path("drive.truth.csv"), truth_table(north_m)).unwrap();
    folder
}

fn compare(folder: &Folder, reference: &str, more: &[&str]) -> crate::fixture::Done {
    let (solution, reference) = (folder.text("drive.insnav.mcap"), folder.text(reference));
    let mut arguments = vec!["compare", solution.as_str(), reference.as_str()];
    arguments.extend(more);
    insnav_json(arguments)
}

const KEYS: [&str; 10] = [
    "count",
    "horizontal_rms_m",
    "horizontal_p95_m",
    "horizontal_max_m",
    "height_rms_m",
    "velocity_rms_m_per_s",
    "roll_rms_deg",
    "pitch_rms_deg",
    "heading_rms_deg",
    "mounting_deg",
];

#[test]
fn the_result_has_the_keys_of_the_contract() {
    let folder = prepared(0.0);
    let done = compare(&folder, "drive.truth.csv", &["--course"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    for class in ["all", "standing", "moving", "withheld"] {
        for key in KEYS {
            assert!(json[class].get(key).is_some(), "{class}.{key}");
        }
        for key in ["position", "velocity", "attitude"] {
            assert!(json[class]["nees"].get(key).is_some(), "{class}.nees.{key}");
        }
        for key in ["one_sigma", "two_sigma", "three_sigma"] {
            assert!(
                json[class]["coverage"].get(key).is_some(),
                "{class}.coverage.{key}"
            );
        }
        assert!(json[class]["count"].as_u64().unwrap() > 0, "{class}");
    }
    for key in ["heading_minus_course_std_deg", "mean_deg", "count"] {
        assert!(json["course"].get(key).is_some(), "course.{key}");
    }
    assert!(
        json["stops"][0]["reference_begin_s"].is_number() && json["false_standing_s"].is_number()
    );
    let count = |class: &str| json[class]["count"].as_u64().unwrap();
    assert_eq!(count("all"), count("standing") + count("moving"));
    // 5 Hz for two minutes, every second one.
    assert!(count("withheld").abs_diff(300) < 5, "{}", count("withheld"));
}

#[test]
fn a_displaced_reference_shows_by_its_displacement() {
    let rms = |north_m| {
        let json = compare(&prepared(north_m), "drive.truth.csv", &[]).json();
        (
            json["all"]["horizontal_rms_m"].as_f64().unwrap(),
            json["withheld"]["horizontal_rms_m"].as_f64().unwrap(),
        )
    };
    let (here, away) = (rms(0.0), rms(100.0));
    // The root of the sum of squares of the displacement and of an error of half a metre, whatever its mean.
    assert!((away.0 - 100.0).abs() < here.0, "{here:?} {away:?}");
    assert_eq!(here.1, away.1, "withheld fixes are judged by themselves");
}

#[test]
fn limits_decide_the_exit_code() {
    let folder = prepared(0.0);
    let done = compare(
        &folder,
        "drive.truth.csv",
        &[
            "--max",
            "horizontal_rms_m=50",
            "--max",
            "withheld.height_rms_m=50",
        ],
    );
    assert_eq!(done.code, 0, "{}", done.stderr);
    assert_eq!(done.json()["max"][1]["passed"], true);
    let done = compare(
        &folder,
        "drive.truth.csv",
        &["--max", "horizontal_rms_m=0.0001"],
    );
    assert_eq!(done.code, 1);
    assert_eq!(done.json()["max"][0]["passed"], false);
    assert!(done.stderr.contains("horizontal_rms_m"), "{}", done.stderr);
    let (_, remedy) =
        compare(&folder, "drive.truth.csv", &["--max", "horizontal=1"]).failed(2, "usage");
    assert!(remedy.contains("horizontal_rms_m"), "{remedy}");
}

#[test]
fn from_and_to_cut_the_reference() {
    let folder = prepared(0.0);
    let json = compare(&folder, "drive.truth.csv", &["--from", "10", "--to", "20"]).json();
    assert_eq!(json["all"]["count"], 51);
    assert_eq!(json["moving"]["count"], 0);
    compare(&folder, "drive.truth.csv", &["--from", "5000"]).failed(1, "no_overlap");
}

#[test]
fn a_solution_agrees_with_its_own_copies() {
    let folder = prepared(0.0);
    let solution = folder.text("drive.insnav.mcap");
    // A CSV has ten digits of the position and angles to a microdegree; TUM has micrometres.
    for (copy, metres, degrees) in [
        ("copy.csv.gz", 1e-3, 1e-5),
        ("copy.tum", 1e-4, 1e-5),
        ("drive.insnav.mcap", 1e-9, 1e-9),
    ] {
        if copy != "drive.insnav.mcap" {
            let done = insnav(["convert", &solution, "-o", &folder.text(copy)]);
            assert_eq!(done.code, 0, "{}", done.stderr);
        }
        let done = compare(&folder, copy, &[]);
        assert_eq!(done.code, 0, "{copy}: {}", done.stderr);
        let all = &done.json()["all"];
        assert!(
            all["horizontal_max_m"].as_f64().unwrap() < metres,
            "{copy}: {all}"
        );
        assert!(
            all["heading_rms_deg"].as_f64().unwrap() < degrees,
            "{copy}: {all}"
        );
        assert!(all["count"].as_u64().unwrap() > 5000, "{copy}: {all}");
    }
}

#[test]
fn a_receiver_may_stand_for_the_solution() {
    let folder = prepared(0.0);
    assert_eq!(
        insnav([
            "convert",
            &folder.text("drive.mcap"),
            "-o",
            &folder.text("tables")
        ])
        .code,
        0
    );
    // Seconds of the table count from the log's origin, those of a CSV solution from zero: both from the same instant here.
    let done = insnav_json([
        "compare",
        &folder.text("tables/gnss.csv.gz"),
        &folder.text("drive.truth.csv"),
    ]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let all = &done.json()["all"];
    // White errors of 0.5 m north and east and the lever arm of 0.5 m; one in 200 is off by 50 m.
    let p95 = all["horizontal_p95_m"].as_f64().unwrap();
    assert!(p95 > 0.8 && p95 < 3.0, "{all}");
    assert_eq!(all["heading_rms_deg"], Value::Null);
}

#[test]
fn two_folders_give_one_table() {
    let folder = prepared(0.0);
    for name in ["solutions", "references/drive"] {
        std::fs::create_dir_all(folder.path(name)).unwrap();
    }
    std::fs::copy(
        folder.path("drive.insnav.mcap"),
        folder.path("solutions/drive.insnav.mcap"),
    )
    .unwrap();
    std::fs::copy(
        folder.path("drive.insnav.mcap"),
        folder.path("solutions/other.insnav.mcap"),
    )
    .unwrap();
    std::fs::copy(
        folder.path("drive.truth.csv"),
        folder.path("references/drive/truth.csv"),
    )
    .unwrap();
    std::fs::copy(
        folder.path("drive.truth.csv"),
        folder.path("references/other.csv"),
    )
    .unwrap();
    let (a, b) = (folder.text("solutions"), folder.text("references"));
    let json = insnav_json(["compare", &a, &b]).json();
    let names: Vec<&str> = json["rows"]
        .as_array()
        .unwrap()
        .iter()
        .map(|r| r["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["drive", "other"]);
    let text = insnav(["compare", &a, &b]).stdout;
    assert_eq!(text.lines().count(), 3, "{text}");
    insnav_json(["compare", &a, &folder.text("references/drive")]).failed(1, "no_pairs");
}

#[test]
fn a_table_without_anything_to_compare_names_what_would_do() {
    let folder = prepared(0.0);
    std::fs::write(folder.path("weather.csv"), "t_s,temperature\n1,20\n").unwrap();
    let (message, _) = compare(&folder, "weather.csv", &[]).failed(1, "missing_column");
    assert!(
        message.contains("lat_deg") && message.contains("weather.csv"),
        "{message}"
    );
}

/// Alone it is an error; among others it costs itself only.
#[test]
fn a_reference_of_nothing_is_told_among_others() {
    let folder = prepared(0.0);
    for name in ["solutions", "references"] {
        std::fs::create_dir_all(folder.path(name)).unwrap();
    }
    for name in ["drive", "other"] {
        let target = folder.path(&format!("solutions/{name}.insnav.mcap"));
        std::fs::copy(folder.path("drive.insnav.mcap"), target).unwrap();
    }
    std::fs::copy(
        folder.path("drive.truth.csv"),
        folder.path("references/drive.csv"),
    )
    .unwrap();
    let mut nothing = String::from("t_s,qw,qx,qy,qz\n");
    for second in 10..20 {
        nothing += &format!("{second},nan,nan,nan,nan\n");
    }
    std::fs::write(folder.path("references/other.csv"), nothing).unwrap();

    let (a, b) = (folder.text("solutions"), folder.text("references"));
    let done = insnav_json(["compare", &a, &b]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let rows = done.json()["rows"].clone();
    assert!(rows[0]["all"]["horizontal_rms_m"].is_number(), "{rows}");
    assert_eq!(rows[0]["warnings"], serde_json::json!([]), "{rows}");
    assert_eq!(rows[1]["warnings"][0]["code"], "nothing_to_compare");
    compare(&folder, "references/other.csv", &[]).failed(1, "nothing_to_compare");
}
