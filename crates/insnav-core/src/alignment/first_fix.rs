//! The position at the first sample, by several fixes: any single one may be an outlier.

use crate::sample::{GnssPosition, GnssVelocity};
use crate::time::Time;
use nalgebra::{Matrix3, Vector3};
use std::vec::Vec;

/// Fixes that have a say: the burst of outliers that seven of them do not outvote is longer than the gate's own patience allows
/// later on.
const FIXES: usize = 15;
/// Fixes that come so long after the first have none, s: the way between them is not known well enough.
const WITHIN: f64 = 20.0;
/// A median absolute deviation as a standard deviation of the normal distribution.
const MAD_TO_SIGMA: f64 = 1.482_6;
/// The first fix stands unless it is off by so many sigmas of a single one.
const OUTLIER: f64 = 5.0;

/// A first fix to begin with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FirstFix {
    /// The fix; its position is that of the others when the first is an outlier among them.
    pub(super) fix: GnssPosition,
    /// How far single fixes scatter, NED, m; zero when there are too few to tell.
    pub(super) scatter: Vector3<f64>,
}

/// What the fixes from `positions[first]` on say about the position at the first of them: each is moved back by the way since,
/// and the median counts. The way comes from the velocities, or without any from the straight line that most fixes follow.
pub(super) fn first_fix(
    positions: &[GnssPosition],
    first: usize,
    velocities: &[GnssVelocity],
) -> Option<FirstFix> {
    let fix = *positions.get(first)?;
    let alone = FirstFix {
        fix,
        scatter: Vector3::zeros(),
    };
    // A fast receiver's fixes are thinned out, so that those who vote do not all stem from the same second.
    let near: Vec<&GnssPosition> = positions[first..]
        .iter()
        .take_while(|p| p.time.since(fix.time) <= WITHIN)
        .collect();
    let step = near.len().div_ceil(FIXES).max(1);
    let voters: Vec<(f64, Vector3<f64>)> = near
        .iter()
        .step_by(step)
        .map(|p| {
            let t = p.time.since(fix.time);
            let way = way(velocities, fix.time, t);
            (t, fix.position.offset_to(&p.position) - way)
        })
        .collect();
    if voters.len() < 4 {
        return Some(alone);
    }
    let slope = if velocities.is_empty() {
        median_slope(&voters)
    } else {
        Vector3::zeros()
    };
    let at_first: Vec<Vector3<f64>> = voters.iter().map(|(t, r)| r - slope * *t).collect();
    let middle = median(&at_first);
    let deviations: Vec<Vector3<f64>> = at_first.iter().map(|r| (r - middle).abs()).collect();
    let scatter = median(&deviations) * MAD_TO_SIGMA;
    let stated = fix.covariance_n.unwrap_or_else(Matrix3::zeros).diagonal();
    let off = (0..3).any(|i| {
        let sigma = stated[i].max(0.0).sqrt().max(scatter[i]).max(1.0);
        middle[i].abs() > OUTLIER * sigma
    });
    let position = if off {
        fix.position.offset(&middle)
    } else {
        fix.position
    };
    Some(FirstFix {
        fix: GnssPosition { position, ..fix },
        scatter,
    })
}

/// Way from `begin` over `duration` seconds by the velocities, trapezoids between them; the ends go on as they are.
fn way(velocities: &[GnssVelocity], begin: Time, duration: f64) -> Vector3<f64> {
    let known = |v: &GnssVelocity| v.velocity_n.map(|x| if x.is_nan() { 0.0 } else { x });
    let at = |t: f64| -> Vector3<f64> {
        let i = velocities.partition_point(|v| v.time.since(begin) < t);
        match (
            i.checked_sub(1).and_then(|i| velocities.get(i)),
            velocities.get(i),
        ) {
            (Some(a), Some(b)) => {
                let (ta, tb) = (a.time.since(begin), b.time.since(begin));
                let share = ((t - ta) / (tb - ta).max(1e-9)).clamp(0.0, 1.0);
                known(a) * (1.0 - share) + known(b) * share
            }
            (Some(v), None) | (None, Some(v)) => known(v),
            (None, None) => Vector3::zeros(),
        }
    };
    let mut sum = Vector3::zeros();
    let (mut t, mut v) = (0.0, at(0.0));
    for next in velocities
        .iter()
        .map(|v| v.time.since(begin))
        .filter(|t| (0.0..duration).contains(t))
        .chain([duration])
    {
        let then = at(next);
        sum += (v + then) * (0.5 * (next - t));
        (t, v) = (next, then);
    }
    sum
}

/// The median of the slopes of all pairs (\[Sen68\]): up to 29 % of wrong points do not move it.
fn median_slope(points: &[(f64, Vector3<f64>)]) -> Vector3<f64> {
    let mut slopes = Vec::new();
    for (i, (ta, a)) in points.iter().enumerate() {
        for (tb, b) in &points[i + 1..] {
            if tb > ta {
                slopes.push((b - a) / (tb - ta));
            }
        }
    }
    median(&slopes)
}

/// Component by component; zero of nothing.
fn median(all: &[Vector3<f64>]) -> Vector3<f64> {
    Vector3::from_fn(|i, _| {
        let mut values: Vec<f64> = all.iter().map(|v| v[i]).collect();
        values.sort_by(f64::total_cmp);
        let n = values.len();
        match n {
            0 => 0.0,
            n => 0.5 * (values[(n - 1) / 2] + values[n / 2]),
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::Geodetic;

    const SPEED: Vector3<f64> = Vector3::new(9.0, -4.0, 0.5);

    fn at(t: f64) -> Time {
        Time::from_seconds(1000.0 + t)
    }

    /// Fixes once a second of a body at constant speed, the k-th off by what `error` says.
    fn drive(error: impl Fn(usize) -> f64) -> Vec<GnssPosition> {
        let origin = Geodetic::from_degrees(50.0, 14.0, 300.0);
        let fix = |k: usize| GnssPosition {
            time: at(k as f64),
            position: origin.offset(&(SPEED * k as f64 + Vector3::x() * error(k))),
            covariance_n: Some(Matrix3::identity() * 0.01),
        };
        (0..12).map(fix).collect()
    }

    fn velocities() -> Vec<GnssVelocity> {
        let fix = |k| GnssVelocity {
            time: at(f64::from(k) * 0.5),
            velocity_n: SPEED,
            covariance_n: None,
        };
        (0..24).map(fix).collect()
    }

    fn error_of(positions: &[GnssPosition], velocities: &[GnssVelocity]) -> f64 {
        let found = first_fix(positions, 0, velocities).expect("fixes");
        let truth = drive(|_| 0.0)[0].position;
        truth.offset_to(&found.fix.position).norm()
    }

    #[test]
    fn a_good_first_fix_is_taken_to_the_last_digit() {
        for v in [velocities(), Vec::new()] {
            assert_eq!(error_of(&drive(|_| 0.0), &v), 0.0);
            // An outlier among the others changes nothing.
            assert_eq!(
                error_of(&drive(|k| if k == 3 { 80.0 } else { 0.0 }), &v),
                0.0
            );
        }
    }

    #[test]
    fn an_outlier_first_is_outvoted() {
        for v in [velocities(), Vec::new()] {
            // Curvature of the Earth over a hundred metres: a millimetre.
            let off = error_of(&drive(|k| if k == 0 { 80.0 } else { 0.0 }), &v);
            assert!(off < 0.01, "{off}");
        }
        // A burst of five of twelve; by velocities alone, since slopes bear three of ten only.
        let off = error_of(&drive(|k| if k < 5 { 80.0 } else { 0.0 }), &velocities());
        assert!(off < 0.01, "{off}");
    }

    #[test]
    fn three_fixes_cannot_outvote_one() {
        let few = &drive(|k| if k == 0 { 80.0 } else { 0.0 })[..3];
        assert!((error_of(few, &velocities()) - 80.0).abs() < 1e-6);
    }
}
