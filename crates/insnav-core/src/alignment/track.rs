//! What the inertial data alone say since the first sample: turns, and gain of speed along the nose.

use super::levelling::Level;
use crate::attitude::{Euler, exp, wrap_angle};
use crate::earth::EARTH_RATE;
use crate::sample::Sample;
use crate::time::Time;
use nalgebra::{UnitQuaternion, Vector3};
use std::vec::Vec;

/// Rate and force of one inertial sample, whichever way it was given.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Inertial {
    pub(super) time: Time,
    pub(super) rate_b: Vector3<f64>,
    pub(super) force_b: Vector3<f64>,
}

/// The inertial samples of a buffer sorted by time, increments as mean rates.
pub(super) fn inertial(samples: &[Sample]) -> Vec<Inertial> {
    let mut last: Option<Time> = None;
    let mut out = Vec::with_capacity(samples.len());
    for sample in samples {
        match sample {
            Sample::Imu(s) => {
                out.push(Inertial {
                    time: s.time,
                    rate_b: s.angular_rate_b,
                    force_b: s.specific_force_b,
                });
            }
            Sample::ImuIncrement(s) => {
                if let Some(dt) = last.map(|l| s.time.since(l)).filter(|dt| *dt > 0.0) {
                    out.push(Inertial {
                        time: s.time,
                        rate_b: s.angle_b / dt,
                        force_b: s.velocity_b / dt,
                    });
                }
                last = Some(s.time);
            }
            _ => {}
        }
    }
    out
}

/// One instant of a [`Track`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Point {
    pub(super) time: Time,
    /// Heading minus the heading at the first sample, unwrapped, rad.
    pub(super) turn: f64,
    /// ∫ specific force along the level forward axis, m/s.
    pub(super) forward_gain: f64,
    /// ∫ (cos, sin) of `turn`, s: where a body of unit speed would be.
    pub(super) path: [f64; 2],
}

/// Turns and forward gain since the first sample.
#[derive(Clone, Debug)]
pub(super) struct Track(Vec<Point>);

impl Track {
    /// Integrate rates (less a bias) from a level start.
    pub(super) fn new(
        imu: &[Inertial],
        level: &Level,
        gyro_bias: &Vector3<f64>,
        latitude: f64,
    ) -> Self {
        let mut points: Vec<Point> = Vec::with_capacity(imu.len());
        let Some(first) = imu.first() else {
            return Track(points);
        };
        let mut q = level.q_level;
        let mut point = Point {
            time: first.time,
            turn: 0.0,
            forward_gain: 0.0,
            path: [0.0; 2],
        };
        points.push(point);
        for pair in imu.windows(2) {
            let dt = pair[1].time.since(pair[0].time);
            let rate = (pair[0].rate_b + pair[1].rate_b) * 0.5 - gyro_bias;
            // North and east of the level axes are not known yet: only the Earth rate about Down can be taken out.
            let frame = Vector3::new(0.0, 0.0, EARTH_RATE * latitude.sin() * dt);
            q = UnitQuaternion::new_normalize((exp(&frame) * q * exp(&(rate * dt))).into_inner());
            let heading = Euler::from_quaternion(&q).heading;
            let before = point.turn;
            point.turn += wrap_angle(heading - point.turn);
            let mean = 0.5 * (before + point.turn);
            let force = q * pair[1].force_b;
            point.forward_gain += (force.x * point.turn.cos() + force.y * point.turn.sin()) * dt;
            point.path[0] += mean.cos() * dt;
            point.path[1] += mean.sin() * dt;
            point.time = pair[1].time;
            points.push(point);
        }
        Track(points)
    }

    /// The track at an instant, linear between samples; `None` outside.
    pub(super) fn at(&self, time: Time) -> Option<Point> {
        let i = self.0.partition_point(|p| p.time < time);
        let after = self.0.get(i)?;
        if after.time == time {
            return Some(*after);
        }
        let before = self.0.get(i.checked_sub(1)?)?;
        let share = time.since(before.time) / after.time.since(before.time);
        let mix = |a: f64, b: f64| a + (b - a) * share;
        Some(Point {
            time,
            turn: mix(before.turn, after.turn),
            forward_gain: mix(before.forward_gain, after.forward_gain),
            path: [
                mix(before.path[0], after.path[0]),
                mix(before.path[1], after.path[1]),
            ],
        })
    }

    /// Smallest and largest turn between two instants.
    pub(super) fn turn_range(&self, from: Time, to: Time) -> (f64, f64) {
        let i = self.0.partition_point(|p| p.time < from);
        self.0[i..]
            .iter()
            .take_while(|p| p.time <= to)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), p| {
                (lo.min(p.turn), hi.max(p.turn))
            })
    }
}
