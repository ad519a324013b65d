//! `insnav noise`: Allan deviation, least squares, and the block for the settings.

use crate::fixture::{Folder, insnav, insnav_json, recordings};
use serde_json::Value;
use std::fmt::Write as _;

/// A unit of class industrial, 0.15 °/√h and 0.1 m/s/√h, that stands for ten minutes.
fn standing() -> Folder {
    let folder = Folder::new();
    let scenario = "seed = 5\n\
         route = [{ duration_s = 600, speed_m_per_s = 0 }]\n\
         [start]\nlatitude_deg = 60\nlongitude_deg = 30\nheight_m = 100\nheading_deg = 45\n\
         [imu]\ngrade = \"industrial\"\nrate_hz = 50\n[gnss]\n";
    std::fs::write(folder.path("rest.toml"), scenario).unwrap();
    let made = insnav([
        "simulate",
        &folder.text("rest.toml"),
        "-o",
        &folder.text("rest.mcap"),
    ]);
    assert_eq!(made.code, 0, "{}", made.stderr);
    folder
}

fn number(value: &Value) -> f64 {
    value
        .as_f64()
        .unwrap_or_else(|| panic!("{value} is no number"))
}

#[test]
fn the_noise_of_a_simulated_unit_is_told_with_its_errors() {
    let folder = standing();
    let log = folder.text("rest.mcap");
    let done = insnav_json(["noise", &log]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    let truth = [0.15_f64.to_radians() / 60.0, 0.1 / 60.0];
    let fits = [
        ("gyro", "white_rad_per_sqrt_s", truth[0]),
        ("accel", "white_m_per_s_per_sqrt_s", truth[1]),
    ];
    for (sensor, key, truth) in fits {
        for axis in 0..3 {
            let term = &json["fit"][sensor][axis][key];
            let off = number(&term["value"]) - truth;
            assert!(
                off.abs() < 3.0 * number(&term["standard_error"]),
                "{sensor} {axis}: {term}"
            );
        }
    }
    // K of a bias of 30 °/h with 20000 s, and no flicker noise.
    let walk = 30.0_f64.to_radians() / 3600.0 * (2.0_f64 / 20_000.0).sqrt();
    for axis in 0..3 {
        let term = &json["fit"]["gyro"][axis]["random_walk_rad_per_s_per_sqrt_s"];
        let off = number(&term["value"]) - walk;
        assert!(off.abs() < 3.0 * number(&term["standard_error"]), "{term}");
    }
    let als = &json["als"];
    assert_eq!(als["accepted"], true, "{als:#}");
    for (key, truth) in [
        ("gyro_white_rad_per_sqrt_s", truth[0]),
        ("accel_white_m_per_s_per_sqrt_s", truth[1]),
    ] {
        let off = number(&als[key]["value"]) - truth;
        assert!(
            off.abs() < 3.0 * number(&als[key]["standard_error"]),
            "{key} {:#}",
            als[key]
        );
    }
    for key in ["q", "r", "chi2", "dof"] {
        assert!(number(&als[key]) > 0.0, "{key}");
    }
    assert!(number(&als["standard_error"]["q"]) > 0.0 && als["reason"].is_string());
    assert!(!als["accepted_intervals_s"].as_array().unwrap().is_empty());
    assert_eq!(
        als["gyro_bias_walk_rad_per_s_per_sqrt_s"]["accepted"],
        false
    );
    let point = &json["allan"]["gyro"][0];
    assert!(number(&point["tau_s"]) > 0.0);
    assert_eq!(
        point["deviation_rad_per_s"].as_array().map(Vec::len),
        Some(3)
    );

    // The block goes into a run as it is, and the run uses it.
    let block = json["config"].as_str().unwrap();
    assert!(block.starts_with("[noise]\n"), "{block}");
    std::fs::write(folder.path("noise.toml"), block).unwrap();
    let run = insnav_json([
        "run",
        &log,
        "-c",
        &folder.text("noise.toml"),
        "-o",
        &folder.text("out.mcap"),
    ]);
    assert_eq!(run.code, 0, "{}", run.stderr);
    let value: f64 = block
        .lines()
        .find_map(|l| l.strip_prefix("gyro_arw_deg_per_sqrt_hour = "))
        .and_then(|v| v.parse().ok())
        .unwrap();
    assert!((value / 0.15 - 1.0).abs() < 0.1, "{value}");
    // By way of radians and back.
    let used = number(&run.json()["gyro_arw_deg_per_sqrt_hour"]);
    assert!((used / value - 1.0).abs() < 1e-12, "{used} {value}");

    // The same for people, and the block is in it.
    let text = insnav(["noise", &log]);
    assert_eq!(text.code, 0, "{}", text.stderr);
    assert!(text.stdout.contains(block), "{}", text.stdout);
    assert!(text.stdout.contains("gyro N, °/√h"), "{}", text.stdout);

    // A part of it: what is missing is said.
    let part = insnav_json([
        "noise", &log, "--from", "100", "--to", "160", "--window", "15",
    ])
    .json();
    assert!(
        part["allan"]["missing"].as_str().unwrap().contains("100 s"),
        "{part:#}"
    );
    assert_eq!(part["als"]["windows"].as_array().map(Vec::len), Some(4));
    let (message, _) =
        insnav_json(["noise", &log, "--from", "700", "--to", "800"]).failed(1, "part_outside");
    assert!(message.contains("700"), "{message}");
    insnav_json(["noise", &log, "--from", "9", "--to", "8"]).failed(2, "usage");
    insnav_json(["noise", &log, "--from", "9"]).failed(2, "usage");
    insnav_json(["noise", &log, "--window", "0"]).failed(2, "usage");
}

/// A minute at 50 Hz, changed row by row.
fn table(change: impl Fn(usize, &mut [f64; 7])) -> Folder {
    let folder = Folder::new();
    let mut state = 7u64;
    let mut normal = || {
        let mut total = 0.0;
        for _ in 0..12 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            total += (state >> 11) as f64 / (1u64 << 53) as f64;
        }
        total - 6.0
    };
    let mut text = String::from("t_s,gx,gy,gz,ax,ay,az\n");
    for i in 0..3000 {
        let mut row = [0.02 * i as f64, 0.0, 0.0, 0.0, 0.1, -0.2, -9.8];
        for (k, value) in row.iter_mut().enumerate().skip(1) {
            *value += normal() * if k < 4 { 4e-3 } else { 2e-2 };
        }
        change(i, &mut row);
        let [t, gx, gy, gz, ax, ay, az] = row;
        writeln!(
            text,
            "{t:.4},{gx:.6},{gy:.6},{gz:.6},{ax:.5},{ay:.5},{az:.5}"
        )
        .unwrap();
    }
    std::fs::write(folder.path("imu.csv"), text).unwrap();
    let made = insnav([
        "convert",
        &folder.text("imu.csv"),
        "-o",
        &folder.text("log.mcap"),
    ]);
    assert_eq!(made.code, 0, "{}", made.stderr);
    folder
}

#[test]
fn what_cannot_be_identified_is_refused_with_the_place() {
    let refused = |code: &str, change: &dyn Fn(usize, &mut [f64; 7])| {
        let folder = table(change);
        insnav_json(["noise", &folder.text("log.mcap")]).failed(1, code)
    };
    let (message, _) = refused("flat_channel", &|_, row| row[2] = 0.01);
    // In the log the axes are forward-left-up; they are told as they are inside, forward-right-down.
    assert!(message.contains("gyro y"), "{message}");
    let (message, _) = refused("flat_channel", &|_, row| {
        row[5] = (row[5] / 0.2).round() * 0.2
    });
    assert!(message.contains("accelerometer y"), "{message}");
    let (message, _) = refused("saturated_channel", &|_, row| row[3] = row[3].min(5e-3));
    assert!(
        message.contains("gyro z") && message.contains('%'),
        "{message}"
    );
    let (message, remedy) = refused("uneven_steps", &|i, row| {
        row[0] += if i >= 1000 && i % 3 == 0 { 0.008 } else { 0.0 };
    });
    assert!(
        message.contains("20.0") && remedy.contains("--time log"),
        "{message} {remedy}"
    );
    let folder = table(|_, _| {});
    let log = folder.text("log.mcap");
    let (message, remedy) =
        insnav_json(["noise", &log, "--from", "1", "--to", "1.5"]).failed(1, "too_short");
    assert!(
        message.contains("samples") && remedy.contains("longer"),
        "{message} {remedy}"
    );
    assert_eq!(insnav_json(["noise", &log]).code, 0);
}

/// Known of this record: 147, 155, 140 °/h at 1 s and 24 to 30 °/h at 100 s, over twice the time that the table has.
#[test]
fn the_allan_deviation_of_a_recorded_unit() {
    let Some(data) = recordings("adis16405_static_imu1") else {
        return;
    };
    let folder = Folder::new();
    let log = folder.text("adis.mcap");
    let table = data.join("imu.csv.gz");
    assert_eq!(
        insnav(["convert", table.to_str().unwrap(), "-o", &log]).code,
        0
    );
    let json = insnav_json(["noise", &log]).json();
    let points = json["allan"]["gyro"].as_array().unwrap();
    let at = |tau: f64, key: &str, axis: usize| {
        let point = points
            .iter()
            .find(|p| (number(&p["tau_s"]) / tau - 1.0).abs() < 0.01)
            .unwrap_or_else(|| panic!("no {tau} s in {points:?}"));
        number(&point[key][axis]).to_degrees() * 3600.0
    };
    for (axis, known) in [147.0, 155.0, 140.0].into_iter().enumerate() {
        let second = at(1.0, "deviation_rad_per_s", axis);
        let (low, high) = (
            at(100.0, "lower_rad_per_s", axis),
            at(100.0, "upper_rad_per_s", axis),
        );
        println!("axis {axis}: {second:.1} °/h at 1 s, {low:.1} to {high:.1} at 100 s");
        // Two percent: of a few thousand independent differences.
        assert!((second / known - 1.0).abs() < 0.02, "{second}");
        assert!(low < 30.0 && high > 24.0, "{low} {high}");
    }
}

/// A car on the road: nothing is made of its accelerations, and what was known is kept.
#[test]
fn a_drive_tells_no_noise_of_the_unit() {
    let Some(data) = recordings("rtkexp_drive_0708") else {
        return;
    };
    let folder = Folder::new();
    let log = folder.text("car.mcap");
    assert_eq!(
        insnav(["convert", data.to_str().unwrap(), "-o", &log]).code,
        0
    );
    let json = insnav_json(["noise", &log]).json();
    let als = &json["als"];
    let windows = als["windows"].as_array().unwrap();
    // It stands until 34 s, and from 527 s on.
    let moving = windows
        .iter()
        .filter(|w| number(&w["begin_s"]) > 40.0 && number(&w["end_s"]) < 520.0);
    assert!(moving.clone().count() >= 20);
    assert!(
        moving.clone().all(|w| w["accepted"] == false),
        "{windows:#?}"
    );
    assert!(
        json["allan"]["missing"]
            .as_str()
            .unwrap()
            .contains("at rest"),
        "{json:#}"
    );
}
