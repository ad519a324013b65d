//! Stops of real recordings: in time, where they begin, nothing that moves.

use crate::recording::{Recording, at_most, number, seen_stops, table, velocities_of};
use serde_json::Value;

/// Stops of a run's report as (begin, end), s.
pub(crate) fn told_stops(report: &Value) -> Vec<(f64, f64)> {
    let stops = report["stops"].as_array().expect("a list");
    stops
        .iter()
        .map(|s| (number(&s["begin_s"]), number(&s["end_s"])))
        .collect()
}

/// Every stop that the receiver's speed shows (below 0.1 m/s for two seconds and more) is declared in time, begins when it
/// says and is one entry; nothing that moves is called standing. The filter is half a second behind its detector, and a
/// solution says "standing" where the filter makes use of it.
///
/// The begin is judged where the stop is seen for `judged_from_s` and more: `judged` are how many those are.
fn stops_are_found(drive: &Recording, expected: usize, judged_from_s: f64, judged: usize) {
    let (report, out) = drive.run(&[]);
    let comparison = drive.compare(&out, "gnss.csv.gz", &[]);
    let told = told_stops(&report);
    let lag = number(&report["gnss_velocity_lag_s"]["value"]);
    let seen = seen_stops(&velocities_of(drive, lag));
    let references = comparison["stops"].as_array().expect("a list");
    assert_eq!(references.len(), expected, "{references:?}");
    assert_eq!(seen.len(), expected, "counted here: {seen:?}");
    for reference in references {
        at_most("stop declared after s", number(&reference["delay_s"]), 3.5);
    }
    let mut counted = 0;
    for (begin, end) in &seen {
        let inside: Vec<&(f64, f64)> = told.iter().filter(|s| s.0 < *end && s.1 > *begin).collect();
        let [one] = inside[..] else {
            panic!("one entry for the stop at {begin:.2} s: {inside:.2?}");
        };
        println!(
            "{}: stop from {begin:.2} to {end:.2} s: told {one:.2?}",
            drive.name
        );
        if end - begin >= judged_from_s {
            counted += 1;
            // One that began before the log has no begin in it.
            let off = (one.0 - begin.max(0.0)).abs();
            at_most(
                "begin of the stop against the receiver's speed, s",
                off,
                1.0,
            );
        }
    }
    assert_eq!(counted, judged, "begins that were judged");
    // A fix of the slower receiver: above 0.1 m/s, let alone above 0.3.
    at_most(
        "s above 0.1 m/s called standing",
        number(&comparison["false_standing_s"]),
        0.25,
    );
}

#[test]
fn rtkexp_stops_are_found() {
    let lever_arm = ["gnss.lever_arm_b_m=[0.0, -0.05, 0.0]"];
    if let Some(drive) = Recording::open("rtkexp_drive_0708", 548.0, &lever_arm) {
        stops_are_found(&drive, 4, 0.0, 4);
    }
}

/// The receiver sets its speed to exactly 0 when it is below half a metre per second: it says too early that the car stands.
/// The bar on the begin is that of the two long stops, of 45 s and 100 s; engines are switched off and people move in them.
#[test]
fn hipnuc_stops_are_found() {
    if let Some(drive) = Recording::open("hipnuc_20220504", 773.0, &[]) {
        stops_are_found(&drive, 9, 40.0, 2);
    }
}

/// Fastest mean of a second, m/s, in a stretch; the last part counts from half a second on. Each must have a speed in it.
fn fastest_second(speeds: &[Vec<f64>], begin: f64, end: f64) -> f64 {
    let mut fastest: f64 = 0.0;
    let mut from = begin;
    while end - from >= 0.5 {
        let to = (from + 1.0).min(end);
        let within = |row: &&Vec<f64>| row[0] >= from && row[0] < to;
        let seen: Vec<f64> = speeds.iter().filter(within).map(|r| r[1].abs()).collect();
        assert!(
            !seen.is_empty(),
            "nobody says how fast it was at {from:.2} s"
        );
        fastest = fastest.max(seen.iter().sum::<f64>() / seen.len() as f64);
        from = to;
    }
    fastest
}

/// Without a GNSS velocity the filter's own speed decides. No second above 0.3 m/s by the car's speedometer or the robot's
/// wheels, which the run does not see, is called standing.
///
/// What is missed: the car's first 20 s, since a start among positions of 5 m leaves a velocity sigma of 0.3 m/s, and the
/// robot's only stop, of 11 s, where that sigma is 0.27 m/s. Neither excludes a walk of 1 m/s with three sigmas, and the robot
/// does not drive faster.
#[test]
fn nothing_that_moves_is_called_standing() {
    for (name, length_s, reference, least) in [
        ("kth_skog_car", 299.0, "speedometer.csv", 1),
        ("husky_rl_test1", 395.0, "wheel_odom.csv", 0),
    ] {
        let Some(drive) = Recording::open(name, length_s, &[]) else {
            continue;
        };
        let (report, _) = drive.run(&[]);
        let speeds = table(&drive.folder.join(reference));
        let told = told_stops(&report);
        println!("{name}: {told:.1?}");
        assert!(told.len() >= least, "{name}: {told:?}");
        for (begin, end) in told {
            at_most(
                "fastest second of a stop, m/s",
                fastest_second(&speeds, begin, end),
                0.3,
            );
        }
        // Negative control: both drive at 100 s.
        assert!(fastest_second(&speeds, 100.0, 110.0) > 0.3);
    }
}
