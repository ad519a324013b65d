//! Every finding of `info`: a log spoilt in just that way shows just that finding, with the flag that mends it; with the flag
//! the finding is gone and the run is as good as that of the log before; without it, `run` refuses or is much worse.

mod axes;
mod clocks;
mod receiver;
mod recording;
mod units;

use crate::fixture::{Folder, insnav, insnav_json, truth_of, write_log_with};
use insnav_core::sample::Sample;
use insnav_core::sim::{Scenario, Simulation};
use insnav_log::LogWriterOptions;
use nalgebra::Vector3;
use serde_json::Value;
use std::sync::OnceLock;

const G: f64 = 9.806_65;
/// Given with every run: what a log says of frames is not what is tested here.
const LEVER_ARM: &str = "gnss.lever_arm_b_m=[0.3,-0.4,-1.2]";

/// Four minutes in town, with corners: what shows axes, units and clocks.
fn drive() -> &'static Simulation {
    static DRIVE: OnceLock<Simulation> = OnceLock::new();
    DRIVE.get_or_init(|| {
        let mut scenario = Scenario::demo();
        scenario.duration_s = 240.0;
        scenario.gnss.position_colour_sigma_m = [0.0; 3];
        scenario.gnss.velocity_sigma_m_per_s = [0.03, 0.03, 0.06];
        scenario.simulate(7).expect("a valid scenario")
    })
}

fn write_log(path: &std::path::Path, samples: &[Sample]) {
    let options = LogWriterOptions {
        t0: Some(drive().trajectory.start()),
        ..LogWriterOptions::default()
    };
    write_log_with(path, samples, options);
}

fn truth_table(north_m: f64) -> String {
    truth_of(drive(), north_m, 1200)
}

fn folder_with_drive() -> Folder {
    let folder = Folder::new();
    write_log(&folder.path("drive.mcap"), &drive().samples);
    folder
}

/// Errors of a run against the truth.
#[derive(Clone, Copy, Debug)]
struct Errors {
    horizontal_m: f64,
    velocity_m_per_s: f64,
    level_deg: f64,
    heading_deg: f64,
}

/// Run a log with these arguments and compare with the truth.
fn errors(folder: &Folder, log: &str, flags: &[&str]) -> Result<Errors, String> {
    let out = folder.text("out.mcap");
    let log = folder.text(log);
    let mut arguments = vec!["run", &log, "-o", &out, "--force", "--set", LEVER_ARM];
    arguments.extend(flags);
    let done = insnav_json(&arguments);
    if done.code != 0 {
        let json = done.json();
        return Err(json["error"]["code"].as_str().unwrap_or("?").to_owned());
    }
    std::fs::write(folder.path("truth.csv"), truth_table(0.0)).unwrap();
    let done = insnav_json(["compare", &out, &folder.text("truth.csv")]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let json = done.json();
    let of = |class: &str, key: &str| json[class][key].as_f64().unwrap_or(f64::NAN);
    let all = |key: &str| of("all", key);
    Ok(Errors {
        horizontal_m: all("horizontal_rms_m"),
        velocity_m_per_s: all("velocity_rms_m_per_s"),
        level_deg: all("roll_rms_deg").hypot(all("pitch_rms_deg")),
        // In the stop at the start the heading is that of a course carried back, ± 5°, and held: that is chance.
        heading_deg: of("moving", "heading_rms_deg"),
    })
}

/// Those of the log as it was.
fn clean() -> Errors {
    static CLEAN: OnceLock<Errors> = OnceLock::new();
    *CLEAN.get_or_init(|| errors(&folder_with_drive(), "drive.mcap", &[]).expect("a good log"))
}

fn findings(folder: &Folder, log: &str, flags: &[&str]) -> Vec<Value> {
    let log = folder.text(log);
    let mut arguments = vec!["info", &log];
    arguments.extend(flags);
    let done = insnav_json(&arguments);
    assert_eq!(done.code, 0, "{}", done.stderr);
    done.json()["findings"].as_array().expect("a list").clone()
}

fn codes(found: &[Value]) -> Vec<&str> {
    found.iter().map(|f| f["code"].as_str().unwrap()).collect()
}

/// What happens without the flag.
enum Without {
    Refused,
    /// Worse than the clean run by this factor in its worst quantity.
    Worse(f64),
}

fn worst_ratio(e: &Errors) -> f64 {
    let c = clean();
    [
        e.horizontal_m / c.horizontal_m,
        e.velocity_m_per_s / c.velocity_m_per_s,
        e.level_deg / c.level_deg,
        e.heading_deg / c.heading_deg,
    ]
    .into_iter()
    .fold(0.0, f64::max)
}

/// A log of these samples must show these findings with this flag for the first, and be mended by it.
fn mended(samples: &[Sample], expected: &[&str], flag: &str, without: &Without) {
    let folder = Folder::new();
    write_log(&folder.path("spoilt.mcap"), samples);
    mended_log(&folder, expected, flag, without);
}

fn mended_log(folder: &Folder, expected: &[&str], flag: &str, without: &Without) {
    let found = findings(folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), expected, "{found:#?}");
    assert_eq!(found[0]["flag"], flag, "{found:#?}");
    for f in &found {
        for key in ["evidence", "consequence", "remedy"] {
            assert!(f[key].as_str().is_some_and(|t| t.len() > 8), "{key}: {f}");
        }
    }
    // People see it first.
    let text = insnav(["info", &folder.text("spoilt.mcap")]).stdout;
    assert!(
        text.find(expected[0]) < text.find("/imu/data") && text.contains(flag),
        "{text}"
    );
    let spoilt = errors(folder, "spoilt.mcap", &[]);
    match (without, &spoilt) {
        (Without::Refused, Err(code)) => assert_eq!(code, expected[0]),
        (Without::Worse(factor), Ok(e)) => {
            assert!(worst_ratio(e) > *factor, "{e:?} against {:?}", clean());
        }
        _ => panic!("{spoilt:?}"),
    }
    let flags: Vec<&str> = flag.split(' ').collect();
    // `--withhold` is one of `run` alone.
    if !flag.starts_with("--withhold") && !flag.starts_with("--time-offset") {
        let left = findings(folder, "spoilt.mcap", &flags);
        assert_eq!(codes(&left), [""; 0], "{left:#?}");
    }
    let e = errors(folder, "spoilt.mcap", &flags).expect("mended");
    // What is left is rounding and what was never recorded: a fifth of the clean error, and of a quantity near zero a bit.
    println!(
        "{expected:?} {flag}: {spoilt:?} → {e:?}, clean {:?}",
        clean()
    );
    let near = |mended: f64, clean: f64, floor: f64| mended < 1.2 * clean + floor;
    let c = clean();
    assert!(
        near(e.horizontal_m, c.horizontal_m, 0.05)
            && near(e.velocity_m_per_s, c.velocity_m_per_s, 0.01)
            && near(e.level_deg, c.level_deg, 0.03)
            && near(e.heading_deg, c.heading_deg, 0.1),
        "{e:?} against {c:?}"
    );
}

/// The drive with every inertial sample changed.
fn imu(mut change: impl FnMut(&mut Vector3<f64>, &mut Vector3<f64>)) -> Vec<Sample> {
    let mut samples = drive().samples.clone();
    for sample in &mut samples {
        if let Sample::Imu(s) = sample {
            change(&mut s.angular_rate_b, &mut s.specific_force_b);
        }
    }
    samples
}

/// The drive with every velocity changed.
fn velocity(mut change: impl FnMut(&mut Vector3<f64>)) -> Vec<Sample> {
    let mut samples = drive().samples.clone();
    for sample in &mut samples {
        if let Sample::GnssVelocity(v) = sample {
            change(&mut v.velocity_n);
        }
    }
    samples
}

/// Seconds since the begin.
fn at(sample: &Sample) -> f64 {
    sample.time().since(drive().trajectory.start())
}

#[test]
fn nothing_looks_wrong_with_the_drive() {
    let folder = folder_with_drive();
    let found = findings(&folder, "drive.mcap", &[]);
    assert_eq!(codes(&found), [""; 0], "{found:#?}");
    let text = insnav(["info", &folder.text("drive.mcap")]).stdout;
    assert!(text.contains("nothing looks wrong"), "{text}");
}

fn warning<'a>(json: &'a Value, code: &str) -> &'a str {
    let all = json["warnings"].as_array().unwrap();
    all.iter()
        .find(|w| w["code"] == code)
        .and_then(|w| w["message"].as_str())
        .unwrap_or_else(|| panic!("no {code} in {all:#?}"))
}
