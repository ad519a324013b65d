//! Heading from the course over ground, carried back to the first sample by the gyros.

use super::HeadingSource;
use super::track::Track;
use crate::attitude::wrap_angle;
use crate::measurement::{UNSTATED_POSITION_SIGMA, UNSTATED_VELOCITY_SIGMA};
use crate::sample::{GnssPosition, GnssVelocity};
use crate::time::Time;
use std::f64::consts::PI;
use std::vec::Vec;

/// A course is good enough when its standard deviation is below this, rad (about 4°).
const COURSE_SIGMA: f64 = 0.07;
/// Least speed for a course by velocity, m/s: below it side-slip and walking-pace manoeuvres dominate.
const LEAST_SPEED: f64 = 2.0;
/// Largest turn rate for a course by velocity, rad/s: in a turn, a point off the rear axle slips sideways.
const LARGEST_RATE: f64 = 0.1;
/// Largest change of heading along a chord of positions, rad.
const LARGEST_TURN: f64 = 0.5;
/// How a unit is bolted in by eye: standard deviation of its axes against the vehicle's, rad (5°).
const MOUNTING_SIGMA: f64 = 0.087;

/// Nothing on wheels reverses faster than this, m/s; and reversing is believed only after so much motion, s.
const LARGEST_REVERSE_SPEED: f64 = 6.0;
const REVERSE_EVIDENCE: f64 = 2.0;

/// A heading at the first sample, and where it came from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Course {
    pub(super) heading: f64,
    pub(super) sigma: f64,
    pub(super) at: Time,
    pub(super) source: HeadingSource,
    pub(super) reversing: bool,
}

/// Horizontal standard deviation of a velocity, m/s.
fn velocity_sigma(v: &GnssVelocity) -> f64 {
    v.covariance_n
        .map_or(UNSTATED_VELOCITY_SIGMA, |c| c[(0, 0)].max(c[(1, 1)]).sqrt())
}

/// Horizontal standard deviation of a position, m.
fn position_sigma(p: &GnssPosition) -> f64 {
    p.covariance_n
        .map_or(UNSTATED_POSITION_SIGMA, |c| c[(0, 0)].max(c[(1, 1)]).sqrt())
}

/// Whether a velocity alone is fast enough for a course.
pub(super) fn fast_enough(v: &GnssVelocity) -> bool {
    let speed = v.velocity_n.xy().norm();
    speed >= LEAST_SPEED && velocity_sigma(v) / speed <= COURSE_SIGMA
}

/// The heading by the newest velocity, if it is fast and straight enough.
pub(super) fn by_velocity(velocities: &[GnssVelocity], track: &Track) -> Option<Course> {
    let v = velocities.last().filter(|v| fast_enough(v))?;
    let here = track.at(v.time)?;
    let before = track.at(v.time.plus(-0.5))?;
    if (here.turn - before.turn).abs() / 0.5 > LARGEST_RATE {
        return None;
    }
    let reversing = drives_backwards(velocities, track);
    let course = v.velocity_n.y.atan2(v.velocity_n.x) + if reversing { PI } else { 0.0 };
    Some(Course {
        heading: wrap_angle(course - here.turn),
        sigma: (velocity_sigma(v) / v.velocity_n.xy().norm()).hypot(MOUNTING_SIGMA),
        at: v.time,
        source: HeadingSource::CourseVelocity,
        reversing,
    })
}

/// Does the speed over ground grow while the accelerometer feels a push from the front?
///
/// Regresses the change of speed between fixes on the gain of velocity along the nose (both less their means: a tilt adds a
/// constant to the gain). The slope is +1 driving forward and −1 backward. Only clear evidence says "backward": the wrong
/// answer costs half a turn, and most vehicles drive forward most of the time.
fn drives_backwards(velocities: &[GnssVelocity], track: &Track) -> bool {
    let speed = |v: &GnssVelocity| v.velocity_n.xy().norm();
    let Some(newest) = velocities.last() else {
        return false;
    };
    if speed(newest) > LARGEST_REVERSE_SPEED {
        return false;
    }
    let begin = velocities.iter().rposition(|v| speed(v) < 0.1).unwrap_or(0);
    let mut rows = Vec::new();
    for pair in velocities[begin..].windows(2) {
        let dt = pair[1].time.since(pair[0].time);
        if let (Some(a), Some(b)) = (track.at(pair[0].time), track.at(pair[1].time))
            && dt > 0.0
            && dt <= 2.0
        {
            rows.push((
                (b.forward_gain - a.forward_gain) / dt,
                (speed(&pair[1]) - speed(&pair[0])) / dt,
            ));
        }
    }
    let count = rows.len() as f64;
    if rows.len() < 5 || newest.time.since(velocities[begin].time) < REVERSE_EVIDENCE {
        return false;
    }
    let mean = rows
        .iter()
        .fold((0.0, 0.0), |m, r| (m.0 + r.0 / count, m.1 + r.1 / count));
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (x, y) in rows.iter().map(|r| (r.0 - mean.0, r.1 - mean.1)) {
        (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
    }
    // Correlation of −1 within its sampling error of about 1/√n, slope of −1 within a factor of two.
    xy < 0.0 && xy * xy > 0.5 * xx * yy && (0.5..2.0).contains(&(-xy / xx))
}

/// Whether the newest position is far enough from an earlier one for a course.
pub(super) fn far_enough(positions: &[GnssPosition]) -> Option<usize> {
    let last = positions.last()?;
    positions.iter().rposition(|p| {
        let distance = p.position.offset_to(&last.position).xy().norm();
        distance > 0.0 && position_sigma(p).hypot(position_sigma(last)) / distance <= COURSE_SIGMA
    })
}

/// The heading by the chord from an earlier position to the newest, if the way between was not too crooked.
pub(super) fn by_position(positions: &[GnssPosition], track: &Track) -> Option<Course> {
    let (first, last) = (&positions[far_enough(positions)?], positions.last()?);
    let (a, b) = (track.at(first.time)?, track.at(last.time)?);
    let (low, high) = track.turn_range(first.time, last.time);
    if high - low > LARGEST_TURN {
        return None;
    }
    let chord = first.position.offset_to(&last.position);
    // A body of steady speed that turned as the gyros say would have gone this way.
    let way = (b.path[1] - a.path[1]).atan2(b.path[0] - a.path[0]);
    let noise = position_sigma(first).hypot(position_sigma(last)) / chord.xy().norm();
    Some(Course {
        heading: wrap_angle(chord.y.atan2(chord.x) - way),
        // Unsteady speed shifts the mean direction by a share of the turn.
        sigma: noise.hypot(MOUNTING_SIGMA).hypot(0.25 * (high - low)),
        at: last.time,
        source: HeadingSource::CoursePosition,
        reversing: false,
    })
}
