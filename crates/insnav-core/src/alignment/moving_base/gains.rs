//! Sums of specific force between velocities, with their derivatives by the biases, and what the velocities say they must be.

use super::{Fix, Known};
use crate::alignment::track::Inertial;
use crate::attitude::{exp, skew};
use crate::earth::{Geodetic, LocalEarth};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use std::vec::Vec;

/// Over a longer gap between inertial samples nothing is summed up, s.
const LARGEST_GAP: f64 = 1.0;

/// Everything up to one velocity, and the stretch since the one before. "b" here are the body axes of the first sample, "n" the
/// navigation axes of that instant; both stand still against inertial space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Node {
    /// Length of the stretch, s.
    pub(super) dt: f64,
    /// ∫ R f over the stretch, m/s; R turns the body into b.
    pub(super) gain: Vector3<f64>,
    /// ∫ R over the stretch, s.
    pub(super) turn: Matrix3<f64>,
    /// ∫ (R f)× ∫ R over the stretch.
    pub(super) lean: Matrix3<f64>,
    /// ∫ R f since the first sample.
    pub(super) total: Vector3<f64>,
    /// R (ω × l): velocity of the antenna against the unit.
    pub(super) lever: Vector3<f64>,
    /// Navigation axes of now into n.
    pub(super) frame: UnitQuaternion<f64>,
    /// ∫ (ω_ie × v − g) in n since the first sample.
    pub(super) pull: Vector3<f64>,
    pub(super) fix: Fix,
}

impl Node {
    /// Sum of force in b, seen at the antenna.
    pub(super) fn sum_b(&self) -> Vector3<f64> {
        self.total + self.lever
    }

    /// The same in n, by the velocity, up to the velocity at the first sample.
    pub(super) fn sum_n(&self) -> Vector3<f64> {
        self.frame * self.fix.velocity_n + self.pull
    }
}

/// All nodes, for one value of the biases.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Gains {
    pub(super) nodes: Vec<Node>,
    pub(super) gyro_bias: Vector3<f64>,
    pub(super) accel_bias: Vector3<f64>,
}

/// Integration in b.
struct Sum {
    r: UnitQuaternion<f64>,
    node: Node,
}

impl Sum {
    fn step(&mut self, rate: &Vector3<f64>, force: &Vector3<f64>, dt: f64) {
        let middle = self.r * exp(&(rate * (0.5 * dt)));
        let gain = middle * force * dt;
        let r = middle.to_rotation_matrix().into_inner();
        let node = &mut self.node;
        node.lean += skew(&gain) * (node.turn + r * (0.5 * dt));
        node.turn += r * dt;
        node.gain += gain;
        node.dt += dt;
        self.r = middle * exp(&(rate * (0.5 * dt)));
    }
}

impl Gains {
    /// At the gyro bias that is known beforehand plus `more`.
    pub(super) fn new(
        imu: &[Inertial],
        fixes: &[Fix],
        place: &Geodetic,
        known: &Known,
        more: &Vector3<f64>,
    ) -> Option<Self> {
        Self::at(
            imu,
            fixes,
            place,
            known,
            known.gyro_bias + more,
            Vector3::zeros(),
        )
    }

    /// At these biases; `None` over a gap.
    pub(super) fn at(
        imu: &[Inertial],
        fixes: &[Fix],
        place: &Geodetic,
        known: &Known,
        gyro_bias: Vector3<f64>,
        accel_bias: Vector3<f64>,
    ) -> Option<Self> {
        let begin = imu.first()?.time;
        let empty = Node {
            dt: 0.0,
            gain: Vector3::zeros(),
            turn: Matrix3::zeros(),
            lean: Matrix3::zeros(),
            total: Vector3::zeros(),
            lever: Vector3::zeros(),
            frame: UnitQuaternion::identity(),
            pull: Vector3::zeros(),
            fix: *fixes.first()?,
        };
        let mut sum = Sum {
            r: UnitQuaternion::identity(),
            node: empty,
        };
        let mut nodes: Vec<Node> = Vec::with_capacity(fixes.len());
        let mut waiting = fixes.iter().peekable();
        for pair in imu.windows(2) {
            let (from, to) = (pair[0].time, pair[1].time);
            let dt = to.since(from);
            if dt > LARGEST_GAP {
                return None;
            }
            let rate = (pair[0].rate_b + pair[1].rate_b) * 0.5 - gyro_bias;
            let force = (pair[0].force_b + pair[1].force_b) * 0.5 - accel_bias;
            let mut done = 0.0;
            while let Some(fix) = waiting.next_if(|fix| fix.time <= to) {
                let until = fix.time.since(from).clamp(0.0, dt);
                sum.step(&rate, &force, until - done);
                done = until;
                let last = nodes.last().map_or(Vector3::zeros(), |l| l.total);
                nodes.push(Node {
                    total: last + sum.node.gain,
                    lever: sum.r * rate.cross(&known.lever_arm_b),
                    fix: *fix,
                    ..sum.node
                });
                sum.node = empty;
            }
            if waiting.peek().is_none() {
                break;
            }
            sum.step(&rate, &force, dt - done);
        }
        // The navigation axes turn with the Earth and with the way over it.
        let (mut frame, mut pull, mut at) = (UnitQuaternion::identity(), Vector3::zeros(), *place);
        let (mut time, mut velocity) = (begin, fixes[0].velocity_n);
        for node in &mut nodes {
            let dt = node.fix.time.since(time);
            let mean = (velocity + node.fix.velocity_n) * 0.5;
            let earth = LocalEarth::at(&at);
            let earth_rate = earth.earth_rate_n();
            let half = exp(&((earth_rate + earth.transport_rate_n(&mean)) * (0.5 * dt)));
            let gravity = Vector3::z() * earth.gravity();
            pull += (frame * half) * (earth_rate.cross(&mean) - gravity) * dt;
            frame = frame * half * half;
            at = at.offset(&(mean * dt));
            (time, velocity) = (node.fix.time, node.fix.velocity_n);
            node.frame = frame;
            node.pull = pull;
        }
        Some(Gains {
            nodes,
            gyro_bias,
            accel_bias,
        })
    }

    /// From the first sample to the last velocity, s.
    pub(super) fn length(&self) -> f64 {
        self.nodes.iter().map(|n| n.dt).sum()
    }
}
