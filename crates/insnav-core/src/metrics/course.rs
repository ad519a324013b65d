//! Heading against the course over ground: the check of heading that needs no reference attitude.

use super::reference::ReferencePoint;
use super::track::Track;
use crate::attitude::{Euler, wrap_angle};
use crate::time::Time;
use serde::Serialize;

/// Heading minus course on straight stretches. A car's heading differs from its course by a constant (the unit's yaw in the
/// car), so the spread is the error of heading, and the mean is that mounting.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Course {
    /// Standard deviation of the medians about their mean, degrees (n − 1); `None` for fewer than two.
    pub heading_minus_course_std_deg: Option<f64>,
    /// Mean of the medians, degrees.
    pub mean_deg: Option<f64>,
    /// Number of medians.
    pub count: usize,
}

const LEAST_SPEED: f64 = 5.0;
const LARGEST_RATE: f64 = core::f64::consts::PI / 180.0;
const WINDOW: f64 = 20.0;
/// The course rate is taken over this span: at 5 m/s a receiver's 0.05 m/s is 0.6° of course, over which a shorter span
/// would show nothing but noise.
const RATE_SPAN: f64 = 1.0;
/// A window with less straight driving than this is left out: its median would be one moment, not the stretch.
const LEAST_STRAIGHT: f64 = 2.0;

/// Heading minus course: median over each 20 s of the drive, of the instants above 5 m/s whose course turns slower than
/// 1 °/s. `velocity_lag` (s) is how far a velocity's stamp is behind its instant.
pub fn heading_minus_course(
    track: &Track,
    reference: &[ReferencePoint],
    velocity_lag: f64,
) -> Course {
    let fast: Vec<(Time, f64)> = reference
        .iter()
        .filter(|r| r.horizontal_speed().is_some_and(|s| s > LEAST_SPEED))
        .filter_map(|r| r.velocity_n.map(|v| (r.time, v.y.atan2(v.x))))
        .collect();
    let Some(&(first, _)) = fast.first() else {
        return Course::default();
    };

    let mut medians = Vec::new();
    let mut window = (0, Vec::new());
    let mut close = |(_, differences): &mut (i64, Vec<(f64, f64)>)| {
        let span: f64 = differences.iter().map(|&(dt, _)| dt).sum();
        if span >= LEAST_STRAIGHT {
            medians.push(circular_median(differences.iter().map(|&(_, d)| d)));
        }
        differences.clear();
    };
    for (i, &(time, course)) in fast.iter().enumerate() {
        let Some(rate) = course_rate(&fast, i) else {
            continue;
        };
        let Some(q) = track.at(time.plus(-velocity_lag)).and_then(|p| p.q_nb) else {
            continue;
        };
        if rate.abs() > LARGEST_RATE {
            continue;
        }
        let number = (time.since(first) / WINDOW) as i64;
        if number != window.0 {
            close(&mut window);
            window.0 = number;
        }
        let dt = time.since(fast[i.saturating_sub(1)].0).min(RATE_SPAN);
        window
            .1
            .push((dt, wrap_angle(Euler::from_quaternion(&q).heading - course)));
    }
    close(&mut window);
    spread(&medians)
}

/// Course rate around an instant, rad/s; `None` unless there was speed on both sides of it all along.
fn course_rate(fast: &[(Time, f64)], i: usize) -> Option<f64> {
    let half = 0.5 * RATE_SPAN;
    let time = fast[i].0;
    let before = fast[..i]
        .iter()
        .rev()
        .find(|(t, _)| time.since(*t) >= half - 1e-6)?;
    let after = fast[i + 1..]
        .iter()
        .find(|(t, _)| t.since(time) >= half - 1e-6)?;
    let span = after.0.since(before.0);
    // Twice the span allows for receivers of 1 Hz.
    (span <= 2.0 * RATE_SPAN + 0.1).then(|| wrap_angle(after.1 - before.1) / span)
}

/// Median of angles that lie within half a turn of each other.
fn circular_median(angles: impl Iterator<Item = f64>) -> f64 {
    let angles: Vec<f64> = angles.collect();
    let around = angles
        .iter()
        .map(|a| a.sin())
        .sum::<f64>()
        .atan2(angles.iter().map(|a| a.cos()).sum());
    let mut from: Vec<f64> = angles.iter().map(|a| wrap_angle(a - around)).collect();
    from.sort_by(f64::total_cmp);
    let n = from.len();
    wrap_angle(around + 0.5 * (from[(n - 1) / 2] + from[n / 2]))
}

fn spread(medians: &[f64]) -> Course {
    let count = medians.len();
    if count == 0 {
        return Course::default();
    }
    let around = medians[0];
    let from: Vec<f64> = medians.iter().map(|m| wrap_angle(m - around)).collect();
    let mean = from.iter().sum::<f64>() / count as f64;
    let squares: f64 = from.iter().map(|d| (d - mean) * (d - mean)).sum();
    Course {
        heading_minus_course_std_deg: (count > 1)
            .then(|| (squares / (count - 1) as f64).sqrt().to_degrees()),
        mean_deg: Some(wrap_angle(around + mean).to_degrees()),
        count,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::SolutionPoint;
    use nalgebra::Vector3;

    /// 100 s at 10 Hz and 10 m/s: course 30° for 80 s, then a turn of 5 °/s; the heading is off by `error_deg(t)`.
    fn drive(speed: f64, lag: f64, error_deg: impl Fn(f64) -> f64) -> Course {
        let course = |t: f64| 30.0 + 5.0 * (t - 80.0).max(0.0);
        let track = Track::new(
            (-20..=1020)
                .map(|i| {
                    let t = 0.1 * f64::from(i);
                    SolutionPoint {
                        time: Time::from_seconds(t),
                        q_nb: Some(
                            Euler::from_degrees(0.0, 0.0, course(t) + error_deg(t)).to_quaternion(),
                        ),
                        ..SolutionPoint::default()
                    }
                })
                .collect(),
        );
        let reference: Vec<ReferencePoint> = (0..1000)
            .map(|i| {
                let t = 0.1 * f64::from(i);
                let c = course(t - lag).to_radians();
                ReferencePoint {
                    time: Time::from_seconds(t),
                    velocity_n: Some(Vector3::new(c.cos(), c.sin(), 0.0) * speed),
                    ..ReferencePoint::default()
                }
            })
            .collect();
        heading_minus_course(&track, &reference, lag)
    }

    #[test]
    fn a_constant_is_the_mean_and_no_spread() {
        let c = drive(10.0, 0.0, |_| 5.35);
        assert_eq!(c.count, 4, "the turn is left out");
        assert!((c.mean_deg.unwrap() - 5.35).abs() < 1e-9);
        assert!(c.heading_minus_course_std_deg.unwrap() < 1e-9);
    }

    #[test]
    fn the_spread_is_that_of_the_window_medians() {
        // Medians 0, 1, 2, 3 about 1.5: variance 5/3.
        let c = drive(10.0, 0.2, |t| (t / 20.0).floor().min(3.0) + 179.0);
        assert!(
            (c.heading_minus_course_std_deg.unwrap() - (5.0_f64 / 3.0).sqrt()).abs() < 0.01,
            "{c:?}"
        );
        assert!(
            (wrap_angle(c.mean_deg.unwrap().to_radians() - 180.5_f64.to_radians())).abs() < 1e-3,
            "{c:?}"
        );
    }

    #[test]
    fn a_glitch_does_not_move_a_median() {
        let c = drive(10.0, 0.0, |t| {
            if (30.0..33.0).contains(&t) { 90.0 } else { 0.0 }
        });
        assert!(c.heading_minus_course_std_deg.unwrap() < 1e-9, "{c:?}");
    }

    #[test]
    fn slow_driving_says_nothing() {
        assert_eq!(drive(4.9, 0.0, |_| 0.0), Course::default());
    }
}
