//! Heading from the course over ground, carried back to the first sample by the gyros.

use super::HeadingSource;
use super::track::Track;
use crate::attitude::wrap_angle;
use crate::imu::STANDARD_GRAVITY;
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

/// How well the level axes are known while the gyros carry them on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Tilt {
    /// The first sample.
    pub(super) begin: Time,
    /// Standard deviation of the tilt there, rad.
    pub(super) sigma: f64,
    /// Standard deviation of the gyros' rates, rad/s.
    pub(super) rate_sigma: f64,
}

impl Tilt {
    fn sigma(&self, at: Time) -> f64 {
        self.sigma.hypot(self.rate_sigma * at.since(self.begin))
    }
}

impl Course {
    /// Itself, if the other one tells the same heading within what fixes good enough for a course can differ by. Both have
    /// the mounting in common, which therefore is no excuse.
    fn confirmed_by(self, other: &Course) -> Option<Course> {
        let difference = wrap_angle(self.heading - other.heading).abs();
        (difference < 3.0 * COURSE_SIGMA).then_some(self)
    }
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

/// The heading by the newest velocity, if the one before tells the same.
///
/// One fix alone may be an outlier, and a wrong heading that is believed is worse than a late one.
pub(super) fn by_velocity(
    velocities: &[GnssVelocity],
    track: &Track,
    tilt: &Tilt,
) -> Option<Course> {
    let newest = by_newest_velocity(velocities, track, tilt)?;
    let before = by_newest_velocity(velocities.split_last()?.1, track, tilt)?;
    newest.confirmed_by(&before)
}

fn by_newest_velocity(velocities: &[GnssVelocity], track: &Track, tilt: &Tilt) -> Option<Course> {
    let v = velocities.last().filter(|v| fast_enough(v))?;
    let here = track.at(v.time)?;
    let before = track.at(v.time.plus(-0.5))?;
    if (here.turn - before.turn).abs() / 0.5 > LARGEST_RATE {
        return None;
    }
    let reversing = drives_backwards(velocities, track, tilt)?;
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
/// opposite driving backward, within what an error of tilt adds in that time. `None`: it cannot be told yet, and a greater
/// speed will. Without a recent standstill the answer is no: most vehicles drive forward most of the time, and the wrong
/// answer costs half a turn.
fn drives_backwards(velocities: &[GnssVelocity], track: &Track, tilt: &Tilt) -> Option<bool> {
    let speed = |v: &GnssVelocity| v.velocity_n.xy().norm();
    let newest = velocities.last()?;
    let Some(standstill) = velocities.iter().rfind(|v| speed(v) < STANDSTILL_SPEED) else {
        return Some(false);
    };
    let dt = newest.time.since(standstill.time);
    let (Some(now), Some(then)) = (track.at(newest.time), track.at(standstill.time)) else {
        return Some(false);
    };
    if dt >= REVERSE_MEMORY {
        return Some(false);
    }
    let gain = now.forward_gain - then.forward_gain;
    let may_be =
        3.0 * (tilt.sigma(newest.time) * STANDARD_GRAVITY * dt).hypot(velocity_sigma(newest));
    let forward = (gain - speed(newest)).abs() < may_be;
    let backward = (gain + speed(newest)).abs() < may_be;
    match (forward, backward) {
        (true, true) => None,
        (_, backward) => Some(backward),
    }
}

/// Whether the newest position is far enough from an earlier one for a course.
pub(super) fn far_enough(positions: &[GnssPosition]) -> Option<usize> {
    let last = positions.last()?;
    positions.iter().rposition(|p| {
        let distance = p.position.offset_to(&last.position).xy().norm();
        distance > 0.0 && position_sigma(p).hypot(position_sigma(last)) / distance <= COURSE_SIGMA
    })
}

/// The heading by the chord from an earlier position to the newest, if one between two other positions tells the same.
pub(super) fn by_position(positions: &[GnssPosition], track: &Track) -> Option<Course> {
    let first = far_enough(positions)?;
    let last = positions.last()?;
    let before = positions.split_last()?.1;
    // A chord with an end in common would share its outlier.
    let other_first = far_enough(before).filter(|other| *other != first)?;
    let (a, b) = (&positions[first], &before[other_first]);
    let speed = |from: &GnssPosition, to: &GnssPosition| {
        from.position.offset_to(&to.position).xy().norm() / to.time.since(from.time)
    };
    // Nor does a leap beside a long rest agree with a drive.
    let (v, w) = (speed(a, last), speed(b, before.last()?));
    if v.max(w) > 2.0 * v.min(w) {
        return None;
    }
    by_chord(a, last, track)?.confirmed_by(&by_chord(b, before.last()?, track)?)
}

/// The heading by a chord, if the way between was not too crooked.
fn by_chord(first: &GnssPosition, last: &GnssPosition, track: &Track) -> Option<Course> {
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
