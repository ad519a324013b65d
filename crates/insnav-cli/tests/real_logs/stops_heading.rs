//! What stops of real recordings do to heading and gyro bias.

use crate::recording::{
    Pose, Recording, at_most, csv_of, number, solution_of, velocities_of, wrapped,
};
use serde_json::Value;

/// All recordings with a receiver in them, with what a user would set.
fn drives() -> Vec<Recording> {
    let lever_arm: &[&str] = &["gnss.lever_arm_b_m=[0.0, -0.05, 0.0]"];
    let all: [(&str, f64, &[&'static str]); 5] = [
        ("rtkexp_drive_0708", 548.0, lever_arm),
        ("hipnuc_20220504", 773.0, &[]),
        ("kth_skog_car", 299.0, &[]),
        ("husky_rl_test1", 395.0, &[]),
        ("comma2k19_example1", 60.0, &[]),
    ];
    let open = |(name, length_s, settings): (&str, f64, &[&'static str])| {
        Recording::open(name, length_s, settings)
    };
    all.into_iter().filter_map(open).collect()
}

fn stops(report: &Value) -> &Vec<Value> {
    report["stops"].as_array().expect("a list")
}

/// Heading after less heading before is what was corrected at entry, grew while held, was corrected later, and changed between
/// pieces, in every mode. Holding lets 0.1° through at most; where nothing holds the heading, the gyros carry it off by more.
#[test]
fn a_held_heading_does_not_grow_and_the_account_closes_in_every_mode() {
    let drives = drives();
    for (mode, holds) in [
        ("static", Some(true)),
        ("heading_hold", Some(true)),
        ("attitude_hold", Some(true)),
        // Its heading walks with the gyros' noise.
        ("zihr", None),
        ("zupt", Some(false)),
        ("off", Some(false)),
    ] {
        let (mut worst, mut corrected, mut count): (f64, f64, u32) = (0.0, 0.0, 0);
        for drive in &drives {
            let (report, _) = drive.run(&["--stationary", mode]);
            for stop in stops(&report) {
                let of = |key: &str| number(&stop[key]);
                let change = wrapped(of("heading_after_deg") - of("heading_before_deg"));
                let parts = [
                    "heading_at_entry_deg",
                    "heading_growth_deg",
                    "heading_corrections_deg",
                    "heading_between_deg",
                ];
                let sum: f64 = parts.into_iter().map(of).sum();
                // Rounding of some ten thousand bookings.
                assert!(
                    (sum - change).abs() < 1e-9,
                    "{mode}, {}: {stop:#}",
                    drive.name
                );
                worst = worst.max(of("heading_growth_deg").abs());
                corrected = corrected.max(of("heading_corrections_deg").abs());
                count += 1;
            }
        }
        println!(
            "{mode}: {count} stops, growth while held up to {worst:.4}°, corrections up to {corrected:.3}°"
        );
        if drives.len() < 5 {
            continue;
        }
        assert!(count >= 14, "{mode}: {count} stops");
        match holds {
            Some(true) => at_most(&format!("{mode}, growth while held, deg"), worst, 0.1),
            Some(false) => assert!(worst > 0.1, "{mode}: {worst}: met without a hold"),
            None => {}
        }
    }
}

/// Gyro biases about Down at the ends of two stops of one recording differ by three of their sigmas at most.
#[test]
fn the_gyro_bias_learnt_agrees_from_stop_to_stop() {
    for drive in drives() {
        let (report, _) = drive.run(&[]);
        let learnt: Vec<(f64, f64)> = stops(&report)
            .iter()
            .map(|s| {
                let of = |key: &str| number(&s[key][2]);
                (
                    of("gyro_bias_deg_per_hour"),
                    of("sigma_gyro_bias_deg_per_hour"),
                )
            })
            .collect();
        println!(
            "{}: gyro bias z at the ends of stops, deg/h: {learnt:.1?}",
            drive.name
        );
        for (i, a) in learnt.iter().enumerate() {
            for b in &learnt[..i] {
                let z = (a.0 - b.0).abs() / a.1.hypot(b.1);
                assert!(z <= 3.0, "{}: {a:?} and {b:?}: {z:.1} sigmas", drive.name);
            }
            // Sigmas that say nothing would agree with anything: 0.1 °/s is what such units are off by before anything is learnt.
            assert!(a.1 < 360.0, "{}: {a:?}", drive.name);
        }
    }
}

/// For so long before and after a stop the course is looked at, s.
const WINDOW: f64 = 30.0;
/// Below this speed a course is not judged, m/s.
const LEAST_SPEED: f64 = 3.0;
/// Nor in turns: antenna and wheels do not go where the body points, deg/s.
const MOST_TURN: f64 = 1.0;
/// Errors of velocities, and the vehicle's sideslip, are alike for so long, s.
const ALIKE: f64 = 2.0;
/// Gyros of such units are scaled to so much: against the course's turns that of the RTK drive is off by 0.006.
const SCALE: f64 = 0.006;
/// The Earth's rate, deg/s.
const EARTH_RATE: f64 = 15.041 / 3600.0;

/// What the gyros alone say of the heading: turn since the begin of the log, degrees, and its rate, deg/s.
struct Gyros {
    turns: Vec<[f64; 3]>,
}

impl Gyros {
    /// With the biases (deg/s) that were learnt, levelled by the solution's roll and pitch; `offset` as the run used it.
    fn of(drive: &Recording, poses: &[Pose], bias: [f64; 3], offset: f64) -> Gyros {
        let latitude = csv_of(drive, "gnss.csv.gz")[0][1].to_radians();
        let (mut turn, mut last) = (0.0, None);
        let mut turns = Vec::new();
        for row in csv_of(drive, "imu.csv.gz") {
            let t = row[0] + offset;
            let i = poses.partition_point(|p| p.t < t).min(poses.len() - 1);
            let (roll, pitch) = (poses[i].roll.to_radians(), poses[i].pitch.to_radians());
            let [y, z] = [2, 3].map(|c| row[c].to_degrees() - bias[c - 1]);
            let rate =
                (y * roll.sin() + z * roll.cos()) / pitch.cos() + EARTH_RATE * latitude.sin();
            turn += rate * last.map_or(0.0, |last| t - last);
            last = Some(t);
            turns.push([t, turn, rate]);
        }
        Gyros { turns }
    }

    /// Turn at an instant, and the mean rate of a second about it.
    fn at(&self, t: f64) -> (f64, f64) {
        let turn = |t: f64| {
            let i = self.turns.partition_point(|r| r[0] < t);
            self.turns[i.min(self.turns.len() - 1)][1]
        };
        (turn(t), turn(t + 0.5) - turn(t - 0.5))
    }
}

/// Heading at one end of a stop less the course before or after it, carried there by the gyros: median of a window, degrees.
struct HeadingMinusCourse {
    median: f64,
    /// From the scatter about it, and from how well the gyros carry it.
    sigma: f64,
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// From at least five seconds of straight way at speed within (from, to). `heading` is that at the instant `anchor`, both ends
/// included in degrees; `bias_sigma` in deg/s.
fn heading_minus_course(
    (anchor, heading): (f64, f64),
    velocities: &[[f64; 3]],
    gyros: &Gyros,
    bias_sigma: f64,
    (from, to): (f64, f64),
) -> Option<HeadingMinusCourse> {
    let (mut off, mut turned, mut away, mut time) = (Vec::new(), Vec::new(), Vec::new(), 0.0);
    for pair in velocities.windows(2) {
        let [t, north, east] = pair[0];
        let (turn, rate) = gyros.at(t);
        let outside = t < from || t > to;
        if outside || north.hypot(east) < LEAST_SPEED || rate.abs() > MOST_TURN {
            continue;
        }
        let since = turn - gyros.at(anchor).0;
        off.push(wrapped(heading + since - east.atan2(north).to_degrees()));
        turned.push(since.abs());
        away.push((t - anchor).abs());
        time += pair[1][0] - t;
    }
    if time < 5.0 {
        return None;
    }
    let middle = median(&mut off);
    let mut scatter: Vec<f64> = off.iter().map(|x| (x - middle).abs()).collect();
    // Of a normal distribution: from the median deviation to the standard one, from the mean's sigma to the median's.
    let of_one = 1.4826 * median(&mut scatter);
    let of_median = of_one * (std::f64::consts::PI / 2.0).sqrt() / (time / ALIKE).sqrt();
    let carried = (SCALE * median(&mut turned)).hypot(bias_sigma * median(&mut away));
    Some(HeadingMinusCourse {
        median: middle,
        sigma: of_median.hypot(carried),
    })
}

/// Changes of heading minus course over the stops of a recording, each with its sigma, degrees.
fn changes(drive: &Recording, mode: &str) -> Vec<(f64, f64)> {
    let (report, out) = drive.run(&["--stationary", mode]);
    let velocities = velocities_of(drive, number(&report["gnss_velocity_lag_s"]["value"]));
    let offset = number(&report["time_offset_s"]["value"]);
    let poses = solution_of(drive, &out);
    let fast = |v: &&[f64; 3]| v[1].hypot(v[2]) > LEAST_SPEED;
    let under_way = velocities.iter().find(fast).map_or(f64::INFINITY, |v| v[0]);
    let mut found = Vec::new();
    let all = stops(&report);
    for (i, stop) in all.iter().enumerate() {
        let of = |key: &str| number(&stop[key]);
        let (begin, end) = (of("begin_s"), of("end_s"));
        // A start takes its heading from the course that follows.
        if begin < under_way {
            continue;
        }
        let bias = [0, 1, 2].map(|c| number(&stop["gyro_bias_deg_per_hour"][c]) / 3600.0);
        let bias_sigma = number(&stop["sigma_gyro_bias_deg_per_hour"][2]) / 3600.0;
        let gyros = Gyros::of(drive, &poses, bias, offset);
        let previous = i
            .checked_sub(1)
            .map_or(f64::NEG_INFINITY, |i| number(&all[i]["end_s"]));
        let next = all
            .get(i + 1)
            .map_or(f64::INFINITY, |s| number(&s["begin_s"]));
        let before = heading_minus_course(
            (of("held_from_s"), of("heading_before_deg")),
            &velocities,
            &gyros,
            bias_sigma,
            ((begin - WINDOW).max(previous), begin),
        );
        let after = heading_minus_course(
            (end, of("heading_after_deg")),
            &velocities,
            &gyros,
            bias_sigma,
            (end, (end + WINDOW).min(next)),
        );
        let (Some(before), Some(after)) = (before, after) else {
            println!(
                "{}: no straight way about the stop at {begin:.1} s",
                drive.name
            );
            continue;
        };
        let (entered, left) = (of("sigma_heading_before_deg"), of("sigma_heading_deg"));
        let learnt = (entered * entered - left * left).abs().sqrt();
        let courses = before.sigma.hypot(after.sigma);
        let change = wrapped(after.median - before.median);
        println!(
            "{mode}, {}: {:.0} s from {begin:.1} s: heading minus course changes by {change:.3}° ± {:.3}° (courses ± {courses:.3}°, \
             learnt {learnt:.3}°)",
            drive.name,
            end - begin,
            courses.hypot(learnt),
        );
        found.push((change, courses.hypot(learnt)));
    }
    found
}

/// Over every stop that has way at speed before and after it, heading minus course changes by 0.4° at most, and nine in ten of
/// the changes of all recordings lie within two of their sigmas.
///
/// The courses are carried to the ends of the stop by the gyros, not by the solution: what the filter learns while braking or
/// moving off is none of the stop's. The variance of a change is that of the two courses and what the filter says that it has
/// learnt in the stop: an honest estimate changes by the variance that it loses.
#[test]
fn heading_minus_course_is_the_same_after_a_stop() {
    let drives = drives();
    for mode in ["static", "heading_hold"] {
        let found: Vec<(f64, f64)> = drives.iter().flat_map(|d| changes(d, mode)).collect();
        if drives.len() == 5 {
            assert!(found.len() >= 8, "{} stops were judged", found.len());
        }
        let within = found.iter().filter(|(c, s)| c.abs() <= 2.0 * s).count();
        println!("{mode}: {within} of {} within two sigmas", found.len());
        for (change, _) in &found {
            at_most("change of heading minus course, deg", change.abs(), 0.4);
        }
        assert!(
            within as f64 >= 0.9 * found.len() as f64,
            "{mode}: {found:.3?}"
        );
    }
}
