//! Levelling: roll and pitch from the direction of gravity, at rest or in motion.

use super::track::Inertial;
use crate::attitude::{Euler, exp};
use crate::imu::{ImuNoise, STANDARD_GRAVITY};
use crate::sample::{GnssPosition, GnssVelocity};
use crate::time::Time;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use std::vec::Vec;

/// Standing is judged, and gravity averaged, in pieces of this length, s.
const PIECE: f64 = 1.0;
/// At most this much standing data is used, s: by then vibration has averaged out and gyro drift has not come in.
const STANDING_ENOUGH: f64 = 30.0;
/// Length of data that is averaged when the start is in motion, s.
const MOVING_WINDOW: f64 = 10.0;
/// Limits of a standing piece: mean rate, rad/s; standard deviation and wander of the force, m/s²; GNSS speed, m/s; and how
/// far positions may scatter, m plus their own sigmas (for receivers that give no velocity).
const STANDING_RATE: f64 = 0.05;
const STANDING_FORCE_DEVIATION: f64 = 1.0;
const STANDING_FORCE_WANDER: f64 = 0.3;
const STANDING_SPEED: f64 = 0.3;
const STANDING_SCATTER: (f64, f64) = (1.0, 5.0);
/// Acceleration that the mean over [`MOVING_WINDOW`] may hide when GNSS does not tell it, m/s²; over less, one that lasts is more of the mean.
const UNKNOWN_ACCELERATION: f64 = 0.6;

/// The direction of gravity in body axes at the first sample, and what standing tells besides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Level {
    /// Body to level axes whose x is along the heading of the body (heading 0).
    pub(super) q_level: UnitQuaternion<f64>,
    /// Standard deviation of roll and pitch, rad.
    pub(super) tilt_sigma: f64,
    /// That part of it in which the accelerometers' biases have none.
    pub(super) own_sigma: f64,
    /// The mean rotation from the body, while forces were averaged, to the body of the first sample: it takes the accelerometers'
    /// biases into the level. Zero where the level has nothing to do with them.
    pub(super) turned: Matrix3<f64>,
    /// Mean angular rate while standing (bias plus Earth rate), rad/s, and the standard deviation of that mean.
    pub(super) standing_rate: Option<(Vector3<f64>, f64)>,
    /// Seconds of standing data.
    pub(super) standing_s: f64,
}

impl Level {
    /// Body to local axes at the first sample, with this heading.
    pub(super) fn facing(&self, heading: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_scaled_axis(Vector3::z() * heading) * self.q_level
    }
}

/// Level from standing data if the log begins with some, else from the mean of the first seconds in motion.
pub(super) fn level(
    imu: &[Inertial],
    positions: &[GnssPosition],
    velocities: &[GnssVelocity],
    noise: &ImuNoise,
) -> Option<Level> {
    let first = imu.first()?;
    let standing = standing_pieces(imu, positions, velocities);
    if let Some(end) = standing {
        let part: Vec<&Inertial> = imu.iter().take_while(|s| s.time < end).collect();
        let count = part.len() as f64;
        let force = part.iter().map(|s| s.force_b).sum::<Vector3<f64>>() / count;
        let rate = part.iter().map(|s| s.rate_b).sum::<Vector3<f64>>() / count;
        let span = end.since(first.time);
        let bias_tilt = noise.accel_bias_sigma / STANDARD_GRAVITY;
        let noise_tilt = noise.accel_white / span.sqrt() / STANDARD_GRAVITY;
        return Some(Level {
            q_level: from_force(&force),
            tilt_sigma: bias_tilt.hypot(noise_tilt),
            own_sigma: noise_tilt,
            turned: Matrix3::identity(),
            standing_rate: Some((rate, noise.gyro_white / span.sqrt())),
            standing_s: span,
        });
    }
    let (force, turned) = mean_force_b0(imu, MOVING_WINDOW)?;
    let span = imu.last()?.time.since(first.time).min(MOVING_WINDOW);
    let own_sigma = UNKNOWN_ACCELERATION * (MOVING_WINDOW / span).sqrt() / STANDARD_GRAVITY;
    Some(Level {
        q_level: from_force(&force),
        tilt_sigma: own_sigma.hypot(noise.accel_bias_sigma / STANDARD_GRAVITY),
        own_sigma,
        turned,
        standing_rate: None,
        standing_s: 0.0,
    })
}

/// Level in motion once more, now that a heading is known: the mean acceleration by GNSS velocity is taken out.
pub(super) fn level_with_velocity(
    imu: &[Inertial],
    velocities: &[GnssVelocity],
    (heading, heading_sigma): (f64, f64),
    level: &Level,
    noise: &ImuNoise,
) -> Option<Level> {
    let first = imu.first()?.time;
    let ends: Vec<&GnssVelocity> = velocities
        .iter()
        .filter(|v| (0.0..=MOVING_WINDOW).contains(&v.time.since(first)))
        .collect();
    let (from, to) = (ends.first()?, ends.last()?);
    let span = to.time.since(from.time);
    let acceleration_n = (to.velocity_n - from.velocity_n) / span;
    let q_nb = level.facing(heading);
    let horizontal = Vector3::new(acceleration_n.x, acceleration_n.y, 0.0);
    let inside: Vec<Inertial> = imu
        .iter()
        .filter(|s| s.time >= from.time)
        .copied()
        .collect();
    // Forces are averaged in the axes of the first sample of the stretch: turn them back to those of the first of all.
    let before = rotation_over(imu, from.time);
    let (mean, turned) = mean_force_b0(&inside, span)?;
    let force = before * mean - q_nb.inverse_transform_vector(&horizontal);
    // Velocity noise over the span, and the chord by which the heading's error turns the acceleration.
    let residual = 0.2 / span + 2.0 * (0.5 * heading_sigma).sin() * horizontal.norm();
    if residual > UNKNOWN_ACCELERATION {
        return None;
    }
    let own_sigma = residual / STANDARD_GRAVITY;
    Some(Level {
        q_level: from_force(&force),
        tilt_sigma: own_sigma.hypot(noise.accel_bias_sigma / STANDARD_GRAVITY),
        own_sigma,
        turned: before.to_rotation_matrix().into_inner() * turned,
        ..*level
    })
}

/// Body to level axes with heading 0, from a specific force of pure reaction to gravity (\[Groves13\] eq. 5.101).
pub(super) fn from_force(f: &Vector3<f64>) -> UnitQuaternion<f64> {
    Euler {
        roll: (-f.y).atan2(-f.z),
        pitch: f.x.atan2(f.y.hypot(f.z)),
        heading: 0.0,
    }
    .to_quaternion()
}

/// Mean specific force over the first `span` seconds, resolved in the body axes of the first sample, and the mean rotation into
/// them.
fn mean_force_b0(imu: &[Inertial], span: f64) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    let first = imu.first()?.time;
    let (mut q, mut sum, mut time) = (UnitQuaternion::identity(), Vector3::zeros(), 0.0);
    let mut turned = Matrix3::zeros();
    for pair in imu.windows(2) {
        let dt = pair[1].time.since(pair[0].time);
        q *= exp(&((pair[0].rate_b + pair[1].rate_b) * (0.5 * dt)));
        sum += q * pair[1].force_b * dt;
        turned += q.to_rotation_matrix().into_inner() * dt;
        time += dt;
        if pair[1].time.since(first) >= span {
            break;
        }
    }
    (time > 0.0).then(|| (sum / time, turned / time))
}

/// Rotation from the body at `until` to the body at the first sample.
fn rotation_over(imu: &[Inertial], until: Time) -> UnitQuaternion<f64> {
    imu.windows(2)
        .take_while(|p| p[1].time <= until)
        .fold(UnitQuaternion::identity(), |q, p| {
            q * exp(&((p[0].rate_b + p[1].rate_b) * (0.5 * p[1].time.since(p[0].time))))
        })
}

/// The end of the standing pieces at the begin of the data; `None` when the very first piece does not stand.
fn standing_pieces(
    imu: &[Inertial],
    positions: &[GnssPosition],
    velocities: &[GnssVelocity],
) -> Option<Time> {
    let first = imu.first()?.time;
    let mut reference: Option<Vector3<f64>> = None;
    let (mut end, mut before) = (None, None);
    let mut rest = imu;
    while let Some(begin) = rest.first() {
        let count = rest
            .iter()
            .take_while(|s| s.time.since(begin.time) < PIECE)
            .count();
        if count == rest.len() || begin.time.since(first) >= STANDING_ENOUGH {
            break;
        }
        let (piece, after) = rest.split_at(count);
        let until = after[0].time;
        let mean = |of: fn(&Inertial) -> Vector3<f64>| {
            piece.iter().map(of).sum::<Vector3<f64>>() / count as f64
        };
        let (rate, force) = (mean(|s| s.rate_b), mean(|s| s.force_b));
        let variance = piece
            .iter()
            .map(|s| (s.force_b - force).norm_squared())
            .sum::<f64>()
            / count as f64;
        let wander = (force - *reference.get_or_insert(force)).norm();
        let told_to_move = velocities
            .iter()
            .filter(|v| v.time >= begin.time && v.time < until)
            .any(|v| v.velocity_n.xy().norm() > STANDING_SPEED);
        let still = rate.norm() < STANDING_RATE
            && variance.sqrt() < STANDING_FORCE_DEVIATION
            && wander < STANDING_FORCE_WANDER
            && !told_to_move
            && !(velocities.is_empty() && scattered(positions, until));
        if !still {
            // Motion begins before it is seen: a vehicle that leans into its acceleration turns while it does not move yet.
            return before.or(end);
        }
        before = end;
        end = Some(until);
        rest = after;
    }
    end
}

/// Whether positions up to an instant have moved further than their noise.
fn scattered(positions: &[GnssPosition], until: Time) -> bool {
    let mut seen = positions.iter().take_while(|p| p.time < until);
    let Some(first) = seen.next() else {
        return false;
    };
    seen.any(|p| {
        let sigma = p
            .covariance_n
            .map_or(0.0, |c| c[(0, 0)].max(c[(1, 1)]).sqrt());
        first.position.offset_to(&p.position).xy().norm()
            > STANDING_SCATTER.0 + STANDING_SCATTER.1 * sigma
    })
}
