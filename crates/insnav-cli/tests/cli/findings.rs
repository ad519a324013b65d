//! Every finding of `info`: a log spoilt in just that way shows just that finding, with the flag that mends it; with the flag
//! the finding is gone and the run is as good as that of the log before; without it, `run` refuses or is much worse.

use crate::fixture::{
    Folder, Raw, insnav, insnav_json, rewrite, shift_stamp, truth_of, write_log_with,
};
use insnav_core::earth::Geodetic;
use insnav_core::sample::Sample;
use insnav_core::sim::{Scenario, Simulation};
use insnav_log::LogWriterOptions;
use nalgebra::{Matrix3, Rotation3, Vector3};
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

#[test]
fn accelerations_in_g() {
    mended(
        &imu(|_, f| *f /= G),
        &["imu_in_g"],
        "--imu-units=g,rad/s",
        &Without::Refused,
    );
}

#[test]
fn rates_in_degrees() {
    let log = imu(|w, _| *w *= 1f64.to_degrees());
    mended(
        &log,
        &["imu_in_deg_per_s"],
        "--imu-units=m/s2,deg/s",
        &Without::Refused,
    );
}

/// One argument mends both: each finding names it.
#[test]
fn both_units() {
    let log = imu(|w, f| {
        *f /= G;
        *w *= 1f64.to_degrees();
    });
    let both = ["imu_in_g", "imu_in_deg_per_s"];
    mended(&log, &both, "--imu-units=g,deg/s", &Without::Refused);
}

#[test]
fn counts_for_accelerations() {
    // 2048 counts per g, as ±16 g in 16 bits.
    let log = imu(|_, f| *f *= 2048.0 / G);
    let folder = Folder::new();
    write_log(&folder.path("spoilt.mcap"), &log);
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["imu_force_scale"]);
    let flag = found[0]["flag"].as_str().unwrap();
    let factor: f64 = flag
        .strip_prefix("--imu-units=")
        .and_then(|t| t.strip_suffix("m/s2,rad/s"))
        .unwrap_or_else(|| panic!("{flag}"))
        .parse()
        .unwrap();
    // The bias of a consumer unit is some per cent of gravity.
    assert!((factor / (G / 2048.0) - 1.0).abs() < 0.03, "{factor}");
    assert_eq!(
        errors(&folder, "spoilt.mcap", &[]).unwrap_err(),
        "imu_force_scale"
    );
    // A scale from gravity in motion is good to a per cent: the run is one, if not as good as with the data sheet's.
    assert!(errors(&folder, "spoilt.mcap", &[flag]).is_ok());
    assert_eq!(codes(&findings(&folder, "spoilt.mcap", &[flag])), [""; 0]);
}

#[test]
fn increments_for_rates() {
    let log = imu(|w, f| {
        *f *= 0.01;
        *w *= 0.01;
    });
    mended(
        &log,
        &["imu_increments"],
        "--imu-units=m/s,rad",
        &Without::Refused,
    );
}

#[test]
fn gravity_taken_out() {
    let truth = drive();
    let mut samples = truth.samples.clone();
    for sample in &mut samples {
        if let Sample::Imu(s) = sample {
            let q_nb = truth.truth_at(s.time).nav.q_nb;
            s.specific_force_b += q_nb.inverse_transform_vector(&Vector3::new(0.0, 0.0, 9.81));
        }
    }
    let folder = Folder::new();
    write_log(&folder.path("spoilt.mcap"), &samples);
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["gravity_removed"], "{found:#?}");
    assert_eq!(found[0]["flag"], Value::Null);
    assert!(
        found[0]["remedy"]
            .as_str()
            .unwrap()
            .contains("raw acceleration")
    );
    assert_eq!(
        errors(&folder, "spoilt.mcap", &[]).unwrap_err(),
        "gravity_removed"
    );
    // Where the raw topic is recorded too, it is named.
    write_log(&folder.path("raw.mcap"), &truth.samples);
    let mut raw = Vec::new();
    rewrite(&folder.path("raw.mcap"), &folder.path("copy.mcap"), |m| {
        raw.push((m.topic.clone(), m.log_time, m.data.clone()));
        vec![m]
    });
    let mut raw = raw.into_iter().filter(|m| m.0 == "/imu/data");
    rewrite(
        &folder.path("spoilt.mcap"),
        &folder.path("both.mcap"),
        |m| {
            if m.topic != "/imu/data" {
                return vec![m];
            }
            let (_, log_time, data) = raw.next().expect("as many");
            let topic = "/imu/raw".into();
            vec![
                m,
                Raw {
                    topic,
                    log_time,
                    data,
                },
            ]
        },
    );
    let found = findings(&folder, "both.mcap", &["--topic", "imu=/imu/data"]);
    assert_eq!(codes(&found), ["gravity_removed"]);
    assert_eq!(found[0]["flag"], "--topic imu=/imu/raw");
    let e = errors(&folder, "both.mcap", &["--topic", "imu=/imu/raw"]).unwrap();
    assert!(worst_ratio(&e) < 1.2, "{e:?}");
}

#[test]
fn accelerometers_that_give_gravity() {
    let log = imu(|_, f| *f = -*f);
    mended(
        &log,
        &["imu_force_sign"],
        "--imu-units=-1m/s2,rad/s",
        &Without::Refused,
    );
}

#[test]
fn gyros_of_the_wrong_sign() {
    let log = imu(|w, _| *w = -*w);
    mended(
        &log,
        &["imu_rate_sign"],
        "--imu-units=m/s2,-1rad/s",
        &Without::Refused,
    );
}

#[test]
fn forward_right_down_declared_as_forward_left_up() {
    let turned = Vector3::new(1.0, -1.0, -1.0);
    let log = imu(|w, f| {
        w.component_mul_assign(&turned);
        f.component_mul_assign(&turned);
    });
    // Only where roll is counted from, but lever arm and attitude are wrong by half a turn.
    mended(&log, &["imu_axes"], "--imu-axes frd", &Without::Worse(50.0));
    // And the reverse.
    let folder = folder_with_drive();
    let found = findings(&folder, "drive.mcap", &["--imu-axes", "frd"]);
    assert_eq!(codes(&found), ["imu_axes"]);
    assert_eq!(found[0]["flag"], "--imu-axes flu");
}

/// `v_imu = Rᵀ v_body` for a mounting of these angles in forward-left-up.
fn mounted(roll: f64, pitch: f64, yaw: f64) -> Vec<Sample> {
    let flu = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    let r = Rotation3::from_euler_angles(roll.to_radians(), pitch.to_radians(), yaw.to_radians());
    let m = flu * r.matrix().transpose() * flu;
    imu(|w, f| {
        *w = m * *w;
        *f = m * *f;
    })
}

#[test]
fn mountings_of_right_angles() {
    // As on the husky.
    let flag = "--imu-mounting-deg roll=90,yaw=-90";
    mended(
        &mounted(90.0, 0.0, -90.0),
        &["imu_mounting"],
        flag,
        &Without::Worse(20.0),
    );
    let flag = "--imu-mounting-deg yaw=180";
    mended(
        &mounted(0.0, 0.0, 180.0),
        &["imu_mounting"],
        flag,
        &Without::Worse(20.0),
    );
}

#[test]
fn a_mounting_of_any_angles() {
    let folder = Folder::new();
    write_log(&folder.path("spoilt.mcap"), &mounted(0.0, 0.0, 40.0));
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["imu_mounting"], "{found:#?}");
    let flag = found[0]["flag"].as_str().unwrap();
    let yaw: f64 = flag.rsplit("yaw=").next().unwrap().parse().unwrap();
    assert!((yaw - 40.0).abs() < 6.0, "{flag}");
    let flags: Vec<&str> = flag.split(' ').collect();
    assert_eq!(codes(&findings(&folder, "spoilt.mcap", &flags)), [""; 0]);
}

#[test]
fn velocity_in_other_axes() {
    // Written as east, north, up: these come out as north, east, down; as north, west, up; as east, north, down.
    let ned = velocity(|v| *v = Vector3::new(v.y, v.x, -v.z));
    mended(
        &ned,
        &["velocity_axes"],
        "--gnss-velocity-axes ned",
        &Without::Worse(1.5),
    );
    let nwu = velocity(|v| *v = Vector3::new(-v.y, v.x, v.z));
    mended(
        &nwu,
        &["velocity_axes"],
        "--gnss-velocity-axes nwu",
        &Without::Worse(1.5),
    );
}

#[test]
fn velocity_that_is_no_use() {
    let along = velocity(|v| *v = Vector3::new(0.0, v.xy().norm(), 0.0));
    let folder = Folder::new();
    write_log(&folder.path("spoilt.mcap"), &along);
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert!(
        codes(&found).contains(&"velocity_in_body_axes"),
        "{found:#?}"
    );
    let knots = velocity(|v| *v *= 1.943_844);
    write_log(&folder.path("knots.mcap"), &knots);
    let found = findings(&folder, "knots.mcap", &[]);
    assert_eq!(codes(&found), ["velocity_scale"], "{found:#?}");
    assert!(found[0]["evidence"].as_str().unwrap().contains("knots"));
    let left = findings(&folder, "knots.mcap", &["--topic", "gnss-velocity=none"]);
    assert_eq!(codes(&left), ["no_gnss_velocity"]);
}

/// The drive with every stated position sigma changed.
fn stated(change: impl Fn(f64) -> f64) -> Vec<Sample> {
    let mut samples = drive().samples.clone();
    for sample in &mut samples {
        if let Sample::GnssPosition(p) = sample {
            p.covariance_n = p.covariance_n.map(|c| c.map(&change));
        }
    }
    samples
}

#[test]
fn sigmas_that_do_not_match_the_scatter() {
    let folder = Folder::new();
    for (log, code, range) in [
        (
            stated(|v| v * 1e-4),
            "position_sigma_too_small",
            40.0..160.0,
        ),
        (stated(|v| v * 1e2), "position_sigma_too_large", 0.05..0.4),
    ] {
        let name = format!("{code}.mcap");
        write_log(&folder.path(&name), &log);
        let found = findings(&folder, &name, &[]);
        assert_eq!(codes(&found), [code], "{found:#?}");
        let flag = found[0]["flag"].as_str().unwrap();
        let scale: f64 = flag
            .strip_prefix("--set gnss.sigma_scale=")
            .unwrap()
            .parse()
            .unwrap();
        assert!(range.contains(&scale), "{flag}");
        let flags: Vec<&str> = flag.split(' ').collect();
        assert_eq!(codes(&findings(&folder, &name, &flags)), [""; 0]);
        let (spoilt, e) = (
            errors(&folder, &name, &[]).unwrap(),
            errors(&folder, &name, &flags).unwrap(),
        );
        println!("{code}: {spoilt:?} → {e:?}, clean {:?}", clean());
        assert!(e.horizontal_m < 1.5 * clean().horizontal_m + 0.05, "{e:?}");
    }
}

#[test]
fn a_receiver_that_repeats_its_position() {
    let mut samples = drive().samples.clone();
    // The first ten seconds in which it never goes slower than 5 m/s.
    let speed = |t: u32| {
        let start = drive().trajectory.start();
        drive()
            .truth_at(start.plus(f64::from(t)))
            .nav
            .velocity_n
            .norm()
    };
    let begin = (60..220)
        .find(|t| (*t..=t + 10).all(|t| speed(t) > 5.0))
        .expect("a stretch of road");
    let begin = f64::from(begin);
    let mut frozen: Option<Geodetic> = None;
    for sample in &mut samples {
        let t = at(sample);
        if let Sample::GnssPosition(p) = sample
            && (begin..begin + 10.0).contains(&t)
        {
            p.position = *frozen.get_or_insert(p.position);
        }
    }
    let folder = Folder::new();
    write_log(&folder.path("spoilt.mcap"), &samples);
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["gnss_frozen"], "{found:#?}");
    let flag = found[0]["flag"].as_str().unwrap();
    let flags: Vec<&str> = flag.split(' ').collect();
    let (spoilt, mended) = (
        errors(&folder, "spoilt.mcap", &[]).unwrap(),
        errors(&folder, "spoilt.mcap", &flags).unwrap(),
    );
    // Ten seconds without fixes cost what they cost: the same as withholding them from the good log.
    let outage = errors(&folder_with_drive(), "drive.mcap", &flags).unwrap();
    println!("frozen {spoilt:?}, withheld {mended:?}, outage {outage:?}");
    assert!(
        mended.horizontal_m < 1.05 * outage.horizontal_m + 0.01,
        "{mended:?} {outage:?}"
    );
    // And the run with the flag says nothing more of it.
    let log = folder.text("spoilt.mcap");
    let mut arguments = vec!["run", &log, "-o", "-"];
    arguments.truncate(2);
    let out = folder.text("out.mcap");
    arguments.extend(["-o", &out, "--force"]);
    arguments.extend(&flags);
    let json = insnav_json(&arguments).json();
    let warned = json["warnings"].as_array().unwrap();
    assert!(
        warned.iter().all(|w| w["code"] != "gnss_frozen"),
        "{warned:#?}"
    );
}

#[test]
fn a_clock_that_is_late() {
    let mut samples = drive().samples.clone();
    for sample in &mut samples {
        if sample.is_inertial() {
            *sample = sample.delayed(0.2);
        }
    }
    mended(
        &samples,
        &["time_offset"],
        "--time-offset auto",
        &Without::Worse(1.5),
    );
}

/// Half of the inertial stamps a second ahead of the recorder's clock.
#[test]
fn a_clock_that_steps() {
    let folder = folder_with_drive();
    for (step, worse) in [(1, Without::Worse(1.5)), (-1, Without::Worse(1.5))] {
        let mut count = 0;
        rewrite(
            &folder.path("drive.mcap"),
            &folder.path("spoilt.mcap"),
            |mut m| {
                count += usize::from(m.topic == "/imu/data");
                if m.topic == "/imu/data" && count > 12_000 {
                    shift_stamp(&mut m.data, step);
                }
                vec![m]
            },
        );
        let found = findings(&folder, "spoilt.mcap", &[]);
        let first = found.iter().find(|f| f["code"] == "clock_step");
        let first = first.unwrap_or_else(|| panic!("{found:#?}"));
        assert_eq!(first["flag"], "--time log");
        let evidence = first["evidence"].as_str().unwrap();
        assert!(
            evidence.contains(&format!("{step:+}.00 s")) && evidence.contains("120.0 s"),
            "{evidence}"
        );
        match (errors(&folder, "spoilt.mcap", &[]), &worse) {
            // Back by a second: within the window at its edge, or refused by name.
            (Err(code), _) => assert_eq!(code, "backward_stamps"),
            (Ok(e), Without::Worse(factor)) => assert!(worst_ratio(&e) > *factor, "{e:?}"),
            (Ok(e), Without::Refused) => panic!("{e:?}"),
        }
        assert_eq!(
            codes(&findings(&folder, "spoilt.mcap", &["--time", "log"])),
            [""; 0]
        );
        let e = errors(&folder, "spoilt.mcap", &["--time", "log"]).unwrap();
        assert!(worst_ratio(&e) < 1.2, "{e:?} {:?}", clean());
    }
}

#[test]
fn a_receiver_on_gps_time() {
    let folder = folder_with_drive();
    rewrite(
        &folder.path("drive.mcap"),
        &folder.path("spoilt.mcap"),
        |mut m| {
            if m.topic.starts_with("/gps") {
                shift_stamp(&mut m.data, 18);
            }
            vec![m]
        },
    );
    let found = findings(&folder, "spoilt.mcap", &[]);
    let first = found.iter().find(|f| f["code"] == "different_clocks");
    let first = first.unwrap_or_else(|| panic!("{found:#?}"));
    assert!(
        first["evidence"].as_str().unwrap().contains("GPS time"),
        "{first}"
    );
    assert_eq!(first["flag"], "--time log");
    let e = errors(&folder, "spoilt.mcap", &[]);
    assert!(e.as_ref().map_or(true, |e| worst_ratio(e) > 3.0), "{e:?}");
    let e = errors(&folder, "spoilt.mcap", &["--time", "log"]).unwrap();
    assert!(worst_ratio(&e) < 1.2, "{e:?}");
}

fn warning<'a>(json: &'a Value, code: &str) -> &'a str {
    let all = json["warnings"].as_array().unwrap();
    all.iter()
        .find(|w| w["code"] == code)
        .and_then(|w| w["message"].as_str())
        .unwrap_or_else(|| panic!("no {code} in {all:#?}"))
}

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
fn stamps_of_zero() {
    let folder = folder_with_drive();
    let zero = |data: &mut [u8]| data[4..12].fill(0);
    rewrite(
        &folder.path("drive.mcap"),
        &folder.path("spoilt.mcap"),
        |mut m| {
            if m.topic == "/imu/data" {
                zero(&mut m.data);
            }
            vec![m]
        },
    );
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["unstamped"], "{found:#?}");
    assert!(
        found[0]["evidence"]
            .as_str()
            .unwrap()
            .contains("24001 of 24001")
    );
    assert_eq!(found[0]["flag"], "--time log");
    // The recorder's time is that of the sensor here: nothing is lost by it.
    let e = errors(&folder, "spoilt.mcap", &[]).unwrap();
    assert!(worst_ratio(&e) < 1.2, "{e:?}");
}

#[test]
fn duplicates() {
    let folder = folder_with_drive();
    let mut count = 0;
    rewrite(
        &folder.path("drive.mcap"),
        &folder.path("spoilt.mcap"),
        |m| {
            count += 1;
            let again = Raw {
                topic: m.topic.clone(),
                log_time: m.log_time,
                data: m.data.clone(),
            };
            if m.topic == "/imu/data" && count % 50 == 0 {
                vec![m, again]
            } else {
                vec![m]
            }
        },
    );
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["duplicate_stamps"], "{found:#?}");
    let e = errors(&folder, "spoilt.mcap", &[]).unwrap();
    assert!(worst_ratio(&e) < 1.05, "{e:?}");
}

#[test]
fn fixes_at_zero_and_no_fixes() {
    let folder = Folder::new();
    let mut samples = drive().samples.clone();
    let mut count = 0;
    for sample in &mut samples {
        if let Sample::GnssPosition(p) = sample {
            count += 1;
            if count % 20 == 0 {
                p.position = Geodetic::from_degrees(0.0, 0.0, 0.0);
            }
        }
    }
    write_log(&folder.path("zero.mcap"), &samples);
    let mut count = 0;
    rewrite(
        &folder.path("zero.mcap"),
        &folder.path("spoilt.mcap"),
        |mut m| {
            if m.topic == "/gps/fix" {
                count += 1;
                if count % 20 == 10 {
                    // Encapsulation, stamp, and the frame's name with its length and end: then the status.
                    let name = u32::from_le_bytes(m.data[12..16].try_into().unwrap()) as usize;
                    m.data[16 + name] = -1_i8 as u8;
                }
            }
            vec![m]
        },
    );
    let found = findings(&folder, "spoilt.mcap", &[]);
    assert_eq!(codes(&found), ["no_fix", "zero_position"], "{found:#?}");
    let e = errors(&folder, "spoilt.mcap", &[]).unwrap();
    assert!(worst_ratio(&e) < 1.3, "{e:?} {:?}", clean());
    let out = folder.text("o.mcap");
    let json = insnav_json(["run", &folder.text("spoilt.mcap"), "-o", &out]).json();
    assert!(warning(&json, "zero_position").contains("latitude and longitude zero"));
    assert!(warning(&json, "no_fix").contains("no fix"));
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
