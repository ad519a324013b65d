//! Published experiments, made again.

use crate::fixture::{Folder, insnav, insnav_json, recordings};
use std::collections::BTreeSet;

const VARIANTS: [&str; 10] = [
    "basic",
    "zupt",
    "zupt_zihr_bias_only",
    "zupt_zihr_naive",
    "zupt_zihr_correlated",
    "paper_exact",
    "paper_variance_only",
    "attitude_clone",
    "static",
    "static_coloured_gnss",
];
const QUANTITIES: [&str; 10] = [
    "horizontal_rms_m",
    "height_rms_m",
    "velocity_rms_m_per_s",
    "roll_pitch_rms_deg",
    "heading_end_rms_deg",
    "heading_end_sigma_deg",
    "heading_end_nees",
    "heading_growth_rms_deg",
    "attitude_nees",
    "position_nees",
];

#[test]
fn names_are_those_of_the_contract_whatever_the_number_of_threads_and_the_figure_is_whole() {
    let folder = Folder::new();
    let plot = folder.text("heading.svg");
    let base = ["reproduce", "kozadaev2017", "--runs", "2", "--seed", "7"];
    let done = insnav_json(base.iter().copied().chain(["--jobs", "1", "--plot", &plot]));
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    assert_eq!(
        (
            json["paper"].as_str(),
            json["runs"].as_u64(),
            json["seed"].as_u64()
        ),
        (Some("kozadaev2017"), Some(2), Some(7))
    );
    let rows = json["rows"].as_array().unwrap();
    let row = |variant: &str, quantity: &str| {
        let mut found = rows
            .iter()
            .filter(|r| r["variant"] == variant && r["quantity"] == quantity);
        let row = found
            .next()
            .unwrap_or_else(|| panic!("{variant} {quantity}"));
        assert!(found.next().is_none(), "twice: {variant} {quantity}");
        row
    };
    for variant in VARIANTS {
        for quantity in QUANTITIES {
            let row = row(variant, quantity);
            assert_eq!(row["case"], "stop_300s");
            assert!(row["ours"].as_f64().unwrap() >= 0.0, "{row}");
            let keys: BTreeSet<&str> = row.as_object().unwrap().keys().map(|k| &**k).collect();
            for key in ["published", "standard_error", "limit", "note"] {
                assert!(keys.contains(key), "{key} in {row}");
            }
        }
    }
    let basic = row("basic", "heading_end_rms_deg");
    assert_eq!(basic["published"], 7.2);
    let note = basic["note"].as_str().unwrap();
    assert!(note.contains("cannot come out"), "{note}");
    assert_eq!(row("paper_exact", "heading_end_rms_deg")["published"], 0.51);
    let limit = row("static", "heading_end_rms_deg")["limit"].as_f64();
    assert!((limit.unwrap() - 0.5).abs() < 1e-3, "the start's 0.5°");
    // Errors that are scaled to what a run shows have another limit than those that are not, and a stated sigma has none.
    for (variant, quantity, known) in [
        ("static", "horizontal_rms_m", false),
        ("static_coloured_gnss", "horizontal_rms_m", true),
        ("static", "heading_end_sigma_deg", false),
    ] {
        assert_eq!(
            row(variant, quantity)["limit"].is_f64(),
            known,
            "{variant} {quantity}"
        );
    }
    let naive = row("zupt_zihr_naive", "heading_end_rms_deg")["note"].as_str();
    assert!(
        naive.is_some_and(|note| note.contains("measured force")),
        "{naive:?}"
    );
    let page = insnav(base.iter().copied().chain(["--jobs", "2"]));
    let widest = page.stdout.lines().map(|line| line.chars().count()).max();
    assert!(widest <= Some(120), "{widest:?}:\n{}", page.stdout);

    let svg = std::fs::read_to_string(folder.path("heading.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
    for name in ["basic", "paper_exact", "static"] {
        assert!(svg.contains(&format!(">{name}<")), "{name}");
    }
    assert!(
        svg.contains(">Heading error over a stop of 300 s ("),
        "its title"
    );
    // Two lines in one panel, four in the other, each with its band.
    assert_eq!(svg.matches("fill-opacity").count(), 6);

    let again = insnav_json(base.iter().copied().chain(["--jobs", "3"]));
    assert_eq!(again.stdout, done.stdout);
    // Refused before any work.
    let error = insnav_json(base.iter().copied().chain(["--plot", &plot]));
    error.failed(1, "output_exists");
}

#[test]
fn what_cannot_be_done_is_said() {
    let folder = Folder::new();
    let both = [
        "reproduce",
        "kozadaev2017",
        "--multi-stop",
        "--imu",
        "x.mcap",
    ];
    insnav_json(both).failed(2, "usage");
    insnav_json(["reproduce", "kozadaev2017", "--runs", "1"]).failed(2, "usage");
    insnav_json(["reproduce", "kozadaev2018"]).failed(2, "usage");
    let png = folder.text("heading.png");
    let (message, remedy) =
        insnav_json(["reproduce", "kozadaev2017", "--plot", &png]).failed(2, "usage");
    assert!(
        message.contains("heading.png: the drawing is SVG"),
        "{message}"
    );
    assert!(remedy.contains("heading.svg"), "{remedy}");
    assert_eq!(folder.names(), [""; 0], "nothing was begun");
    let help = insnav(["reproduce", "kozadaev2017", "--help"]);
    assert!(help.stdout.contains("--imu") && help.stdout.contains("--multi-stop"));

    let mut table = String::from("t_s,gx,gy,gz,ax,ay,az\n");
    for i in 0..1000 {
        table.push_str(&format!("{},0,0,0,0,0,-9.8\n", f64::from(i) * 0.01));
    }
    std::fs::write(folder.path("imu.csv"), table).unwrap();
    let short = insnav_json([
        "reproduce",
        "kozadaev2017",
        "--imu",
        &folder.text("imu.csv"),
    ]);
    let (message, _) = short.failed(1, "record_too_short");
    assert!(
        message.contains("imu.csv") && message.contains("300 s"),
        "{message}"
    );
}

/// One stamp years ahead.
#[test]
fn stamps_that_leap_are_no_record() {
    let folder = Folder::new();
    let mut table = String::from("t_s,gx,gy,gz,ax,ay,az\n");
    for i in 0..8000 {
        let t = f64::from(i) * 0.05 + if i == 4000 { 3e8 } else { 0.0 };
        table.push_str(&format!("{t},0,0,0,0,0,-9.8\n"));
    }
    std::fs::write(folder.path("imu.csv"), table).unwrap();
    let path = folder.text("imu.csv");
    let done = insnav_json(["reproduce", "kozadaev2017", "--imu", &path]);
    let (message, _) = done.failed(1, "not_one_record");
    assert!(
        message.contains("imu.csv") && message.contains("after 199.9"),
        "{message}"
    );
}

/// A car on a road shows one tilt over a drive, and is no unit at rest.
#[test]
fn a_drive_is_no_unit_at_rest() {
    let folder = Folder::new();
    let mut table = String::from("t_s,gx,gy,gz,ax,ay,az\n");
    for i in 0..8000 {
        let t = f64::from(i) * 0.05;
        let turn = if (200.0..230.0).contains(&t) {
            0.05
        } else {
            0.0
        };
        table.push_str(&format!("{t},0,0,{turn},0,0,-9.8\n"));
    }
    std::fs::write(folder.path("imu.csv"), table).unwrap();
    let drive = insnav_json([
        "reproduce",
        "kozadaev2017",
        "--imu",
        &folder.text("imu.csv"),
    ]);
    let (message, _) = drive.failed(1, "not_at_rest");
    assert!(
        message.contains("imu.csv") && message.contains("at 200 s"),
        "{message}"
    );
}

/// A real unit at rest: what it is told to be follows from its record, and a held heading stays where it began.
#[test]
fn a_real_unit_at_rest_takes_the_place_of_the_simulated_one() {
    let Some(table) = recordings("vn100_static_12min/imu.csv.gz") else {
        return;
    };
    let folder = table.parent().expect("a folder").display().to_string();
    let done = insnav_json(["reproduce", "kozadaev2017", "--runs", "2", "--imu", &folder]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    let value = |variant: &str, quantity: &str, key: &str| {
        let rows = json["rows"].as_array().unwrap();
        let row = rows
            .iter()
            .find(|r| r["variant"] == variant && r["quantity"] == quantity)
            .unwrap_or_else(|| panic!("{variant} {quantity}"));
        assert_eq!(row["case"], "real_imu");
        row[key].as_f64()
    };
    let basic = value("basic", "heading_end_rms_deg", "published");
    assert_eq!(basic, Some(8.31), "the column of real subsystems");
    for variant in ["paper_exact", "static"] {
        let growth = value(variant, "heading_growth_rms_deg", "ours").unwrap();
        // Five minutes of a unit of 0.011 °/√s let a free heading walk by 0.19°.
        assert!(growth < 0.02, "{variant}: {growth}");
    }
    let assumptions = json["assumptions"].to_string();
    assert!(assumptions.contains("noise floor"), "{assumptions}");
    // Twelve minutes are two stops of five; of a real unit no limit is known but that of what stands still.
    assert_eq!(json["independent_runs"], 2);
    assert_eq!(value("static", "heading_end_rms_deg", "limit"), None);
    assert_eq!(value("static", "velocity_rms_m_per_s", "limit"), Some(0.0));
}

/// The bars of the paper's scenario, from the table that users see; names are those of the contract.
#[test]
fn drifts_of_lobusov2014_come_out_and_its_figures_are_drawn() {
    let folder = Folder::new();
    let plot = folder.text("drifts.svg");
    let done = insnav_json([
        "reproduce",
        "lobusov2014",
        "--runs",
        "12",
        "--seed",
        "3",
        "--plot",
        &plot,
    ]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    let rows = json["rows"].as_array().unwrap();
    let ours = |case: &str, variant: &str, quantity: &str| {
        let row = rows
            .iter()
            .find(|r| r["case"] == case && r["variant"] == variant && r["quantity"] == quantity);
        row.unwrap_or_else(|| panic!("{case} {variant} {quantity}"))["ours"]
            .as_f64()
            .expect("a number")
    };
    for suffix in ["no_east", "east"] {
        for (case, drift, azimuth) in [
            ("static_noise_free", 0.01, 0.002),
            ("sway_noise_free", 0.1, 0.05),
            ("quantised", 0.2, 0.05),
            ("accel_bias", 0.01, 0.005),
            ("zupt2", 0.01, 0.001),
            ("four_positions", 0.01, 0.005),
        ] {
            let case = format!("{case}_{suffix}");
            let error = ours(&case, "joint", "drift_error_percent");
            assert!((0.0..=drift).contains(&error), "{case}: {error}");
            let error = ours(&case, "joint", "azimuth_error_arcmin");
            assert!(error.abs() <= azimuth, "{case}: {error}");
        }
        // The paper's equations are worse by orders of magnitude, and not by accident.
        let paper = ours(
            &format!("static_noise_free_{suffix}"),
            "paper",
            "drift_error_percent",
        );
        assert!((0.2..12.0).contains(&paper), "{paper}");
    }
    for (suffix, without) in [("no_east", 1.80), ("east", 3.54)] {
        let case = format!("free_run_{suffix}");
        let velocity = |variant| ours(&case, variant, "velocity_max_m_per_s");
        assert!(velocity("joint") <= 1e-6, "{}", velocity("joint"));
        let free = velocity("uncompensated");
        assert!((free / without - 1.0).abs() <= 0.01, "{free}");
    }
    // Standard errors of 12 runs are 0.15 of the value: three of them.
    for (variant, quantity, stated) in [
        ("kalman", "drift_rms_nrad_per_s", 18.1),
        ("joint", "drift_rms_nrad_per_s", 20.7),
        ("kalman", "azimuth_rms_arcmin", 1.73),
    ] {
        let value = ours("realistic_noise", variant, quantity);
        assert!((value / stated - 1.0).abs() < 0.45, "{variant} {value}");
    }
    let svg = std::fs::read_to_string(&plot).unwrap();
    assert!(svg.ends_with("</svg>\n") && svg.contains("Schuler") && !svg.contains("NaN"));
    assert!(svg.contains("5c: error of the drift"));
}

/// Every name of the contract, with a number wherever it has a meaning; the paper's table beside ours; two panels with three lines.
#[test]
fn names_of_belokurov2018_are_those_of_the_contract_and_its_figures_are_drawn() {
    let folder = Folder::new();
    let plot = folder.text("angles.svg");
    let base = ["reproduce", "belokurov2018", "--runs", "2", "--seed", "5"];
    let done = insnav_json(base.iter().copied().chain(["--jobs", "1", "--plot", &plot]));
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    assert_eq!(
        (json["paper"].as_str(), json["runs"].as_u64()),
        (Some("belokurov2018"), Some(2))
    );
    let rows = json["rows"].as_array().unwrap();
    let row = |case: &str, variant: &str, quantity: &str| {
        let mut found = rows
            .iter()
            .filter(|r| r["case"] == case && r["variant"] == variant && r["quantity"] == quantity);
        let row = found
            .next()
            .unwrap_or_else(|| panic!("{case} {variant} {quantity}"));
        assert!(found.next().is_none(), "twice: {case} {variant} {quantity}");
        row
    };
    let quantities = [
        "pitch_std_deg",
        "roll_std_deg",
        "pitch_rms_deg",
        "roll_rms_deg",
    ];
    for case in [
        "static",
        "static_quantised",
        "motion_6dps",
        "motion_40dps",
        "vibration",
        "bursts_0p3",
        "bursts_1p0",
        "magnetic_step",
    ] {
        for variant in [
            "raw",
            "datasheet",
            "q_x100",
            "mohamed_schwarz_fair",
            "mohamed_schwarz_r_over_10",
            "mohamed_schwarz_r",
            "mohamed_schwarz_q_and_r",
            "paper_recursion",
            "als_m40_as_printed",
            "als_m40_nnls",
            "als_long",
            "als_monitor",
            "oracle",
        ] {
            for quantity in quantities {
                assert!(row(case, variant, quantity)["ours"].as_f64().unwrap() > 0.0);
            }
        }
    }
    for (variant, published) in [
        ("paper_recursion", [0.11, 0.13]),
        ("als_m40_as_printed", [0.061, 0.034]),
    ] {
        for (quantity, value) in quantities.into_iter().zip(published) {
            assert_eq!(row("static", variant, quantity)["published"], value);
            assert!(row("vibration", variant, quantity)["published"].is_null());
        }
    }
    // With what tilt and heading have in common, less than the 0.0253° of a diagonal R.
    let limit = row("static", "oracle", "roll_rms_deg")["limit"].as_f64();
    assert!((0.0225..0.0240).contains(&limit.unwrap()), "{limit:?}");
    assert!(row("bursts_0p3", "oracle", "roll_rms_deg")["limit"].is_null());

    let svg = std::fs::read_to_string(&plot).unwrap();
    assert!(svg.ends_with("</svg>\n") && !svg.contains("NaN"));
    assert_eq!(svg.matches("fill-opacity").count(), 6);
    let page = insnav(base.iter().copied().chain(["--jobs", "3"]));
    let widest = page.stdout.lines().map(|line| line.chars().count()).max();
    assert!(widest <= Some(120), "{widest:?}:\n{}", page.stdout);
    let again = insnav_json(base.iter().copied().chain(["--jobs", "3"]));
    assert_eq!(again.stdout, done.stdout, "threads change nothing");
}

/// A real unit at rest: its angles are less than half as noisy by the monitors, and no truth is claimed.
#[test]
fn a_real_adis16405_is_a_case_of_belokurov2018() {
    let Some(table) = recordings("adis16405_static_imu1/imu.csv.gz") else {
        return;
    };
    let path = table.display().to_string();
    let done = insnav_json(["reproduce", "belokurov2018", "--runs", "2", "--imu", &path]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    let of = |variant: &str, quantity: &str| {
        let rows = json["rows"].as_array().unwrap();
        let row = rows.iter().find(|r| {
            r["case"] == "real_imu" && r["variant"] == variant && r["quantity"] == quantity
        });
        row.unwrap_or_else(|| panic!("{variant} {quantity}"))["ours"].as_f64()
    };
    for quantity in ["pitch_std_deg", "roll_std_deg"] {
        let value = |variant| of(variant, quantity).unwrap();
        assert!(value("raw") > 2.0 * value("als_monitor"), "{quantity}");
        assert!(
            value("mohamed_schwarz_r_over_10") > 0.8 * value("raw"),
            "{quantity}"
        );
    }
    assert_eq!(of("als_monitor", "pitch_rms_deg"), None);

    let folder = Folder::new();
    let mut short = String::from("t_s,gx,gy,gz,ax,ay,az\n");
    for i in 0..1000 {
        short.push_str(&format!("{},0,0,0,0,0,-9.8\n", f64::from(i) * 0.01));
    }
    std::fs::write(folder.path("imu.csv"), short).unwrap();
    let short = insnav_json([
        "reproduce",
        "belokurov2018",
        "--imu",
        &folder.text("imu.csv"),
    ]);
    let (message, _) = short.failed(1, "record_too_short");
    assert!(
        message.contains("imu.csv") && message.contains("180 s"),
        "{message}"
    );
}
