//! No false alarm: what is found in logs that nothing is wrong with, and in recordings of which the faults are known.

mod recordings;

use insnav_core::config::Config;
use insnav_core::sim::{Leg, Scenario};
use insnav_log::{Finding, Log, ReadOptions, convert, find};
use recordings::recording;
use std::path::Path;

fn codes(found: &[Finding]) -> Vec<&str> {
    found.iter().map(|f| f.code).collect()
}

/// Simulated drives of all lengths and kinds: nothing but what the scenario says.
#[test]
fn simulated_drives_show_nothing() {
    let config = Config::default();
    for seed in 1..=6 {
        let demo = Scenario::demo();
        let mut minute = Scenario::demo();
        minute.duration_s = 60.0;
        let mut fast = Scenario::car_drive(400.0);
        fast.imu.rate_hz = 100.0;
        fast.gnss.position_sigma_m = [0.01, 0.01, 0.02];
        let mut slow = Scenario::standing(1.0, 30.0);
        // A robot at walking pace, in circles to both sides.
        for turn_deg in [360.0, -360.0, 360.0, -360.0] {
            slow.drive.legs.push(Leg {
                duration_s: 50.0,
                speed_m_per_s: 1.2,
                turn_deg,
                ..Leg::default()
            });
        }
        slow.duration_s = 200.0;
        for (name, scenario, allowed) in [
            ("demo", demo, &[] as &[&str]),
            ("a minute", minute, &[] as &[&str]),
            ("1 cm", fast, &[] as &[&str]),
            ("slow", slow, &[] as &[&str]),
            ("standing", Scenario::standing(120.0, 45.0), &[] as &[&str]),
        ] {
            let samples = scenario.simulate(seed).expect("valid").samples;
            let found = find(&samples, &config).expect("arrays can be read");
            assert_eq!(codes(&found), allowed, "{name}, seed {seed}: {found:#?}");
        }
    }
}

/// Of the recordings, what their notes say and nothing else; clocks apart, which are looked for by a run.
#[test]
fn recordings_show_what_their_notes_say() {
    for (name, expected) in [
        ("rtkexp_drive_0708", &[] as &[&str]),
        // "Its stated sigmas (2-3 m) are several times too large."
        ("hipnuc_20220504", &["position_sigma_too_large"]),
        // A hole of 0.53 s, and GPS positions only.
        ("kth_skog_car", &["imu_gaps", "no_gnss_velocity"]),
        // A receiver that states no sigmas.
        (
            "comma2k19_example1",
            &["position_sigma_missing", "velocity_sigma_missing"],
        ),
        ("husky_rl_test1", &["no_gnss_velocity"]),
    ] {
        let Some(folder) = recording(name) else {
            return;
        };
        let work = tempfile::TempDir::new().unwrap();
        let log = work.path().join("log.mcap");
        made(&folder, &log);
        let log = Log::open(&log, ReadOptions::default()).unwrap();
        let found = find(&log, &Config::default()).unwrap();
        assert_eq!(codes(&found), expected, "{name}: {found:#?}");
    }
}

fn made(folder: &Path, log: &Path) {
    let inputs = convert::CsvInputs::in_folder(folder).unwrap();
    convert::csv_to_mcap(&inputs, log, &convert::ConvertOptions::default()).unwrap();
}

/// The husky's bag holds the raw unit, mounted at roll 90°, yaw −90°.
#[test]
fn the_mounting_of_the_husky_is_found() {
    let Some(folder) = recording("mcap_real") else {
        return;
    };
    let path = folder.join("husky_ros1.mcap");
    let log = Log::open(&path, ReadOptions::default()).unwrap();
    let found = find(&log, &Config::default()).unwrap();
    assert_eq!(
        codes(&found),
        ["imu_mounting", "no_gnss_velocity"],
        "{found:#?}"
    );
    assert_eq!(
        found[0].flag.as_deref(),
        Some("--imu-mounting-deg roll=90,yaw=-90"),
        "{found:#?}"
    );
    let options = ReadOptions {
        imu_mounting_rpy_deg: Some([90.0, 0.0, -90.0]),
        ..ReadOptions::default()
    };
    let found = find(&Log::open(&path, options).unwrap(), &Config::default()).unwrap();
    assert_eq!(codes(&found), ["no_gnss_velocity"], "{found:#?}");
}
