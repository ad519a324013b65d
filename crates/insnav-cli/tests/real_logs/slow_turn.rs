//! A true turn that is too slow to be felt, where speed alone would call it a stop.

use crate::recording::{
    Pose, Recording, at_most, csv_of, longest_stop, number, solution_of, velocities_of, wrapped,
};
use serde_json::Value;

/// 3° in 15 s.
const TURN_DEG: f64 = 3.0;
const LASTS_S: f64 = 15.0;

/// Heading (degrees) with its sigma at an instant.
fn heading_at(poses: &[Pose], t: f64) -> (f64, f64) {
    let i = poses.partition_point(|p| p.t < t).min(poses.len() - 1);
    (poses[i].heading, poses[i].sigma)
}

#[test]
fn a_slow_turn_in_a_stop_is_followed_and_not_held() {
    let Some(drive) = Recording::open("hipnuc_20220504", 773.0, &[]) else {
        return;
    };
    let (begin, end) = longest_stop(&velocities_of(&drive, 0.0));
    // In the middle of its longest stop, where the receiver says 0 for half a minute before and after.
    let from = 0.5 * (begin + end) - 0.5 * LASTS_S;
    let to = from + LASTS_S;
    // Down is where the force at rest does not point.
    let at_rest: Vec<Vec<f64>> = csv_of(&drive, "imu.csv.gz")
        .into_iter()
        .filter(|r| r[0] > from && r[0] < to)
        .collect();
    let mean = [4, 5, 6].map(|c| at_rest.iter().map(|r| r[c]).sum::<f64>() / at_rest.len() as f64);
    let length = mean.iter().map(|f| f * f).sum::<f64>().sqrt();
    assert!((length - 9.8).abs() < 0.2, "{mean:?}");
    let rate = (TURN_DEG / LASTS_S).to_radians();
    let turned = drive.with_rate_added(|t| match t >= from && t < to {
        true => mean.map(|f| -f / length * rate),
        false => [0.0; 3],
    });
    for mode in ["static", "heading_hold"] {
        let of = |recording: &Recording| {
            let (report, out) = recording.run(&["--stationary", mode]);
            (report, solution_of(recording, &out))
        };
        let ((plain_report, plain), (report, poses)) = (of(&drive), of(&turned));
        let covers = |report: &Value| {
            let stops = report["stops"].as_array().expect("a list");
            stops
                .iter()
                .any(|s| number(&s["begin_s"]) <= from && number(&s["end_s"]) >= to)
        };
        assert!(
            covers(&plain_report),
            "negative control: without the turn it stands"
        );
        assert!(!covers(&report), "{:#}", report["stops"]);
        let during: Vec<&Pose> = poses.iter().filter(|p| p.t > from && p.t < to).collect();
        let held = during.iter().filter(|p| p.standing).count();
        println!(
            "{mode}: {held} of {} epochs of the turn called standing",
            during.len()
        );
        // Some time later, in the stop that goes on; what is there without the turn is no part of it.
        let after = to + 20.0;
        let gained = |poses: &[Pose]| heading_at(poses, after).0 - heading_at(poses, from).0;
        let followed = wrapped(gained(&poses) - gained(&plain));
        let sigma = heading_at(&poses, after).1;
        println!("{mode}: {followed:.3}° of {TURN_DEG}° followed, heading ± {sigma:.3}°");
        at_most(
            "turn that was not followed, sigmas",
            (followed - TURN_DEG).abs() / sigma,
            3.0,
        );
        // Negative control: a heading that was held would be off by more than that.
        assert!(TURN_DEG > 3.0 * sigma, "{sigma}");
    }
}
