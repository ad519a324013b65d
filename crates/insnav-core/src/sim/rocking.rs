//! A body that stays in one place: it rocks about a point, and is turned between its stops.

use super::noise::{Source, Stream};
use super::quadrature::gauss_legendre;
use crate::attitude::{Euler, exp, left_jacobian};
use crate::earth::{Geodetic, earth_rate_n, gravity};
use crate::imu::ImuErrors;
use crate::mechanization::{Increment, IncrementBuilder};
use crate::sample::ImuIncrement;
use crate::time::Time;
use nalgebra::{UnitQuaternion, Vector3};
use std::vec::Vec;

/// Step of the central differences that give angular accelerations, s. Rounding leaves 1e-14 rad/s², and what the fourth order
/// leaves out of a tone of 1 s and 0.1 rad is 1e-9 rad/s².
const DIFFERENCE: f64 = 2e-3;

/// One tone of rocking about one body axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RockingTone {
    /// 0: roll, 1: pitch, 2: yaw.
    pub axis: usize,
    /// Amplitude, rad.
    pub amplitude: f64,
    /// Period, s.
    pub period_s: f64,
    /// Phase at the begin, rad.
    pub phase: f64,
}

/// A turn of the body, quintic in time, so that rates and accelerations begin and end at zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyTurn {
    /// Begin, s.
    pub begin_s: f64,
    /// Length, s.
    pub duration_s: f64,
    /// Rotation vector, body axes, rad.
    pub rotation_b: Vector3<f64>,
}

/// Where a body stands, how it rocks, and how it is turned.
#[derive(Clone, Debug, PartialEq)]
pub struct Rocking {
    /// Where.
    pub position: Geodetic,
    /// Attitude before the first turn and without rocking.
    pub attitude: Euler,
    /// Rocking: all tones add up to one rotation vector from the turned attitude, so that no axis comes first.
    pub tones: Vec<RockingTone>,
    /// Turns in the order of time, none overlapping.
    pub turns: Vec<BodyTurn>,
    /// From the point about which it rocks and turns to the IMU, body axes, m.
    pub lever_b: Vector3<f64>,
}

/// What a unit makes of a motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RockingErrors {
    /// Constant biases; scales likewise.
    pub constant: ImuErrors,
    /// White noise: angle, rad/√s, and velocity, m/s/√s.
    pub white: [f64; 2],
    /// Least step of the outputs: rad and m/s; 0: none. What is rounded away is carried to the next sample.
    pub quantum: [f64; 2],
}

impl Rocking {
    /// At rest, level unless the attitude says otherwise.
    pub fn standing(position: Geodetic, attitude: Euler) -> Self {
        Rocking {
            position,
            attitude,
            tones: Vec::new(),
            turns: Vec::new(),
            lever_b: Vector3::zeros(),
        }
    }

    /// Attitude at an instant, s.
    pub fn attitude_at(&self, t: f64) -> UnitQuaternion<f64> {
        let mut q = self.attitude.to_quaternion();
        for turn in &self.turns {
            let (share, _) = turn.share(t);
            q *= exp(&(turn.rotation_b * share));
        }
        q * exp(&self.rocking(t).0)
    }

    /// Rotation vector of the rocking, and its rate.
    fn rocking(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (mut angles, mut rates) = (Vector3::zeros(), Vector3::zeros());
        for tone in &self.tones {
            let w = core::f64::consts::TAU / tone.period_s;
            let (s, c) = (w * t + tone.phase).sin_cos();
            angles[tone.axis] += tone.amplitude * s;
            rates[tone.axis] += tone.amplitude * w * c;
        }
        (angles, rates)
    }

    /// Rate against the Earth, body axes.
    fn rate_at(&self, t: f64) -> Vector3<f64> {
        let (angles, rates) = self.rocking(t);
        // The right Jacobian takes the rate of a rotation vector to the body's rate; the turn is seen through the rocking.
        let mut rate = left_jacobian(&-angles) * rates;
        let turning: Vector3<f64> = self
            .turns
            .iter()
            .map(|turn| turn.rotation_b * turn.share(t).1)
            .sum();
        if turning != Vector3::zeros() {
            rate += exp(&-angles) * turning;
        }
        rate
    }

    /// Velocity of the IMU as it swings, n, m/s.
    pub fn swing_at(&self, t: f64) -> Vector3<f64> {
        self.attitude_at(t) * self.rate_at(t).cross(&self.lever_b)
    }

    /// Inertial rate and specific force at the IMU, body axes.
    fn sensed(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let q = self.attitude_at(t);
        let to_b = q.inverse();
        let rate = self.rate_at(t);
        let earth_b = to_b * earth_rate_n(self.position.latitude);
        let gravity_b = to_b * Vector3::new(0.0, 0.0, gravity(&self.position));
        let mut force = -gravity_b;
        if self.lever_b != Vector3::zeros() {
            let at = |i: f64| self.rate_at(t + i * DIFFERENCE);
            let acceleration =
                ((at(1.0) - at(-1.0)) * 8.0 - (at(2.0) - at(-2.0))) / (12.0 * DIFFERENCE);
            let velocity = rate.cross(&self.lever_b);
            force += acceleration.cross(&self.lever_b)
                + rate.cross(&velocity)
                + earth_b.cross(&velocity) * 2.0;
        }
        (rate + earth_b, force)
    }

    /// Exact increments at `rate_hz` over `duration_s`, stamped from `Time(0)` on.
    ///
    /// Angles and velocities are integrals of what the body axes sense, by three-point Gauss–Legendre over each interval.
    pub fn increments(&self, duration_s: f64, rate_hz: f64) -> Vec<ImuIncrement> {
        let rule = gauss_legendre::<3>();
        let dt = 1.0 / rate_hz;
        let count = (duration_s * rate_hz).round() as i64;
        let still = self.tones.is_empty();
        let mut resting: Option<(Vector3<f64>, Vector3<f64>)> = None;
        let mut out = Vec::with_capacity(count as usize + 1);
        for i in 0..=count {
            let end = i as f64 * dt;
            let turning = |t: &BodyTurn| end > t.begin_s && end - dt < t.begin_s + t.duration_s;
            if self.turns.iter().any(turning) {
                resting = None;
            }
            let (angle_b, velocity_b) = match resting {
                Some(same) => same,
                None => {
                    let mut sums = (Vector3::zeros(), Vector3::zeros());
                    for (x, weight) in rule {
                        let (rate, force) = self.sensed(end + 0.5 * dt * (x - 1.0));
                        sums.0 += rate * (0.5 * dt * weight);
                        sums.1 += force * (0.5 * dt * weight);
                    }
                    if still && !self.turns.iter().any(turning) {
                        resting = Some(sums);
                    }
                    sums
                }
            };
            out.push(ImuIncrement {
                time: Time::from_seconds(end),
                angle_b,
                velocity_b,
            });
        }
        out
    }
}

impl BodyTurn {
    /// Part of the turn that is done, and its rate, 1/s.
    fn share(&self, t: f64) -> (f64, f64) {
        let x = ((t - self.begin_s) / self.duration_s).clamp(0.0, 1.0);
        (
            x * x * x * (10.0 + x * (6.0 * x - 15.0)),
            30.0 * x * x * (1.0 - x) * (1.0 - x) / self.duration_s,
        )
    }
}

impl RockingErrors {
    /// What a unit with these errors puts out, noise by a seed.
    pub fn apply(&self, exact: &[ImuIncrement], seed: u64) -> Vec<ImuIncrement> {
        let mut gyro = Source::new(seed, Stream::GyroWhite);
        let mut accel = Source::new(seed, Stream::AccelWhite);
        let mut carried = [Vector3::zeros(); 2];
        let mut last: Option<Time> = None;
        exact
            .iter()
            .map(|sample| {
                let dt = last.map_or(0.0, |l| sample.time.since(l));
                last = Some(sample.time);
                let scaled = |x: &Vector3<f64>, scale: &Vector3<f64>| x + x.component_mul(scale);
                let mut angle = scaled(&sample.angle_b, &self.constant.gyro_scale)
                    + self.constant.gyro_bias * dt;
                let mut velocity = scaled(&sample.velocity_b, &self.constant.accel_scale)
                    + self.constant.accel_bias * dt;
                if self.white[0] > 0.0 {
                    angle += gyro.normal3() * (self.white[0] * dt.sqrt());
                }
                if self.white[1] > 0.0 {
                    velocity += accel.normal3() * (self.white[1] * dt.sqrt());
                }
                let rounded = |x: Vector3<f64>, carried: &mut Vector3<f64>, step: f64| {
                    if step <= 0.0 {
                        return x;
                    }
                    let whole = ((x + *carried) / step).map(f64::floor) * step;
                    *carried += x - whole;
                    whole
                };
                ImuIncrement {
                    time: sample.time,
                    angle_b: rounded(angle, &mut carried[0], self.quantum[0]),
                    velocity_b: rounded(velocity, &mut carried[1], self.quantum[1]),
                }
            })
            .collect()
    }
}

/// What a mechanization takes, from samples of increments.
pub fn to_increments(samples: &[ImuIncrement]) -> Vec<Increment> {
    let mut builder = IncrementBuilder::default();
    samples
        .iter()
        .filter_map(|s| builder.push_increment(s))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::log;
    use crate::mechanization::NavState;

    fn rocking() -> Rocking {
        let tone = |axis, amplitude, period_s, phase| RockingTone {
            axis,
            amplitude,
            period_s,
            phase,
        };
        Rocking {
            tones: std::vec![
                tone(0, 0.04, 7.0, 0.3),
                tone(1, 0.04, 11.0, 1.0),
                tone(2, 0.02, 13.0, 2.0),
            ],
            turns: std::vec![BodyTurn {
                begin_s: 10.0,
                duration_s: 20.0,
                rotation_b: Vector3::new(0.2, -0.1, 3.0),
            }],
            lever_b: Vector3::new(0.5, 0.5, -1.0),
            ..Rocking::standing(
                Geodetic::from_degrees(60.0, 30.0, 100.0),
                Euler::from_degrees(2.0, -1.0, 45.0),
            )
        }
    }

    /// The mechanization, fed with what the unit senses, comes to where the body is: attitude, and the swing of the IMU.
    #[test]
    fn increments_move_a_mechanization_as_the_body_moves() {
        let body = rocking();
        let samples = body.increments(60.0, 200.0);
        let swing = |t: f64| body.swing_at(t);
        let mut nav = NavState {
            time: Time(0),
            position: body.position,
            velocity_n: swing(0.0),
            q_nb: body.attitude_at(0.0),
        };
        for increment in to_increments(&samples) {
            nav.advance(&increment);
        }
        let attitude = log(&(nav.q_nb * body.attitude_at(60.0).inverse())).norm();
        // The IMU comes 1.41 m away from where it began, while the truth keeps the vertical there: 2.2e-7 rad of tilt, and
        // tan L = 1.73 times as much of heading, together 4.4e-7; coning at 200 Hz leaves less than a tenth.
        assert!(attitude < 5e-7, "{attitude:e}");
        let velocity = (nav.velocity_n - swing(60.0)).norm();
        // Tilts of 2e-7 rad act for half a minute, and gravity changes by 3e-6 m/s² with a metre of height.
        assert!(velocity < 5e-4, "{velocity:e}");
        // Negative control: without the lever's force the velocity would be off by the swing's change.
        assert!((swing(60.0) - swing(0.0)).norm() > 5e-3);
    }

    #[test]
    fn errors_are_what_they_say() {
        let exact = rocking().increments(20.0, 100.0);
        let errors = RockingErrors {
            constant: ImuErrors {
                gyro_bias: Vector3::new(1e-5, 0.0, -2e-5),
                ..ImuErrors::default()
            },
            white: [0.0; 2],
            quantum: [5e-7, 1e-3],
        };
        let said = errors.apply(&exact, 1);
        let sum = |all: &[ImuIncrement]| all.iter().map(|s| s.angle_b).sum::<Vector3<f64>>();
        let difference = sum(&said) - sum(&exact) - errors.constant.gyro_bias * 20.0;
        // Rounding is carried on: the sum is off by one step at most.
        assert!(difference.amax() <= 5e-7 + 1e-15, "{difference}");
        let steps = said[7].velocity_b / 1e-3;
        assert!((steps - steps.map(f64::round)).amax() < 1e-9);
    }
}
