//! Stops without a receiver.

use crate::recording::{Recording, at_most, longest_stop, number, seen_stops, velocities_of};
use crate::stops_found::told_stops;

/// Silences of the receiver begin so long after the car came to rest, s.
const BEGINS: [f64; 2] = [-1.0, 5.0];

/// Horizontal errors (root mean square over the half second before) at the end of the stop and 20 s after it.
fn errors(drive: &Recording, flags: &[&str], withheld: (f64, f64), end: f64) -> [f64; 2] {
    let span = format!("{:.2}:{:.2}", withheld.0, withheld.1);
    let (_, out) = drive.run(&[&["--withhold", span.as_str()], flags].concat());
    [end, withheld.1].map(|at| {
        let (from, to) = (format!("{:.2}", at - 0.5), format!("{at:.2}"));
        let comparison = drive.compare(&out, "gnss.csv.gz", &["--from", &from, "--to", &to]);
        number(&comparison["withheld"]["horizontal_rms_m"])
    })
}

/// The receiver is silent through the longest stop and 20 s after it: where is the car then?
///
/// Modes that hold are off by a fifth at most of what they are off by without: at the end of the stop, and 20 s after it where
/// the wheels' constraint is not used. Where it is, it takes most of a drift back as soon as the car moves: a half there.
#[test]
fn position_after_the_longest_stop_without_gnss() {
    let Some(drive) = Recording::open("hipnuc_20220504", 773.0, &[]) else {
        return;
    };
    let (begin, end) = longest_stop(&velocities_of(&drive, 0.0));
    assert!(end - begin > 90.0, "{begin} to {end} s");
    println!(
        "horizontal error, m: at the end of the stop at {end:.1} s | 20 s after; GNSS withheld from {BEGINS:?} s after its begin on"
    );
    for (constraint, bars) in [("auto", [0.2, 0.5]), ("off", [0.2, 0.2])] {
        let constrained = format!("vehicle.nonholonomic='{constraint}'");
        let mut rows: Vec<(&str, [f64; 2])> = Vec::new();
        for mode in ["off", "zupt", "heading_hold", "static"] {
            let flags = ["--stationary", mode, "--set", constrained.as_str()];
            let [a, b] =
                BEGINS.map(|after| errors(&drive, &flags, (begin + after, end + 20.0), end));
            println!(
                "  constraint {constraint:4} {mode:12} {:7.2} {:7.2} | {:7.2} {:7.2}",
                a[0], b[0], a[1], b[1]
            );
            let rms = |i: usize| (0.5 * (a[i] * a[i] + b[i] * b[i])).sqrt();
            rows.push((mode, [rms(0), rms(1)]));
        }
        let off = rows[0].1;
        for (mode, held) in &rows[1..] {
            for i in 0..2 {
                let what = ["at the end of the stop", "20 s after"][i];
                at_most(
                    &format!("constraint {constraint}, {mode} over off {what}"),
                    held[i] / off[i],
                    bars[i],
                );
            }
        }
    }
}

/// The receiver falls silent as the car comes to rest: the filter's own velocity excludes a walk then, but no longer once the
/// window of the detector is full.
#[test]
fn a_stop_is_found_whose_begin_the_receiver_does_not_see() {
    let lever_arm = ["gnss.lever_arm_b_m=[0.0, -0.05, 0.0]"];
    let Some(drive) = Recording::open("rtkexp_drive_0708", 548.0, &lever_arm) else {
        return;
    };
    let (report, _) = drive.run(&[]);
    let lag = number(&report["gnss_velocity_lag_s"]["value"]);
    let seen = seen_stops(&velocities_of(&drive, lag));
    // The first after some way.
    let (begin, end) = *seen
        .iter()
        .find(|s| s.0 > 100.0)
        .expect("a stop on the way");
    let withheld = format!("{:.2}:{:.2}", begin - 1.0, end + 20.0);
    let (report, _) = drive.run(&["--withhold", &withheld]);
    let inside = |s: &&(f64, f64)| s.0 < end && s.1 > begin;
    let told = told_stops(&report);
    let told: Vec<&(f64, f64)> = told.iter().filter(inside).collect();
    println!("stop seen from {begin:.2} to {end:.2} s, told without the receiver {told:.2?}");
    let [one] = told[..] else {
        panic!("one stop: {told:?}");
    };
    at_most("begin without the receiver, s", (one.0 - begin).abs(), 3.5);
    // As with it: a fix of the receiver.
    at_most("end beyond the receiver's, s", one.1 - end, 0.25);
}
