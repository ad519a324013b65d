//! Heading from the course over ground, carried back to the first sample by the gyros.

use super::HeadingSource;
use super::track::Track;
use crate::attitude::wrap_angle;
use crate::measurement::{UNSTATED_POSITION_SIGMA, UNSTATED_VELOCITY_SIGMA};
use crate::sample::{GnssPosition, GnssVelocity};
use crate::time::Time;
use std::f64::consts::PI;

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

/// A vehicle stands below this speed, m/s; and the memory of a standstill, s, after which tilt has spoilt the gain of speed.
const STANDSTILL_SPEED: f64 = 0.2;
const REVERSE_MEMORY: f64 = 10.0;

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

/// Did the accelerometer feel a push from the front while the vehicle drove off?
///
/// Compares the speed with the gain of velocity along the nose since the last standstill: they are equal driving forward and
/// opposite driving backward, within what a tilt of a degree or two adds in so short a time. Without a recent standstill the
/// answer is no: most vehicles drive forward most of the time, and the wrong answer costs half a turn.
fn drives_backwards(velocities: &[GnssVelocity], track: &Track) -> bool {
    let speed = |v: &GnssVelocity| v.velocity_n.xy().norm();
    let (Some(newest), Some(standstill)) = (
        velocities.last(),
        velocities.iter().rfind(|v| speed(v) < STANDSTILL_SPEED),
    ) else {
        return false;
    };
    let (Some(now), Some(then)) = (track.at(newest.time), track.at(standstill.time)) else {
        return false;
    };
    newest.time.since(standstill.time) < REVERSE_MEMORY
        && now.forward_gain - then.forward_gain < -0.5 * speed(newest)
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
