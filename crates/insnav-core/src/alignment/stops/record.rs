//! A record as the batch methods read it: increments summed up over nodes of a tenth of a second.

use super::Refusal;
use crate::attitude::{exp, left_jacobian, log, skew};
use crate::error::Result;
use crate::mechanization::Increment;
use crate::time::Time;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::vec::Vec;

/// Length of a node, s. Gyro drift acts evenly over it (1e-5 rad/s turn by 1e-6 rad), and rocking of 5 s is still smooth.
const NODE: f64 = 0.1;
/// A hole in the data that no batch method may step over, s.
const GAP: f64 = 0.5;

/// What a tenth of a second of inertial data does, in the body axes of its begin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Node {
    /// Length, s.
    pub(super) dt: f64,
    /// Body axes of the end, seen from those of the begin.
    pub(super) rotation: UnitQuaternion<f64>,
    /// Velocity gained by specific force, m/s.
    pub(super) gain: Vector3<f64>,
    /// ∫C dτ, s: by it a gyro bias turns the body, and an accelerometer bias adds velocity.
    pub(super) axes: Matrix3<f64>,
    /// Derivative of the gain by the gyro bias, m.
    pub(super) gain_by_gyro_bias: Matrix3<f64>,
}

impl Node {
    const EMPTY: Node = Node {
        dt: 0.0,
        rotation: UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(1.0, 0.0, 0.0, 0.0)),
        gain: Vector3::new(0.0, 0.0, 0.0),
        axes: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        gain_by_gyro_bias: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    };

    fn add(&mut self, increment: &Increment) {
        let (dt, turn) = (increment.dt, &increment.rotation_b);
        let c = self.rotation.to_rotation_matrix().into_inner();
        let gain = c * (left_jacobian(turn) * increment.velocity_b);
        // ∫C over the increment to second order in its turn.
        let axes = c * (Matrix3::identity() + skew(turn) * 0.5) * dt;
        self.gain_by_gyro_bias += skew(&gain) * (self.axes + axes * 0.5);
        self.axes += axes;
        self.gain += gain;
        self.rotation *= exp(turn);
        self.dt += dt;
    }

    /// Rotation and gain once constant biases are taken out.
    pub(super) fn corrected(
        &self,
        gyro_bias: &Vector3<f64>,
        accel_bias: &Vector3<f64>,
    ) -> (UnitQuaternion<f64>, Vector3<f64>) {
        (
            exp(&-(self.axes * gyro_bias)) * self.rotation,
            self.gain - self.axes * accel_bias + self.gain_by_gyro_bias * gyro_bias,
        )
    }
}

/// Inertial data of a whole record for [`super::align`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    pub(super) nodes: Vec<Node>,
    /// Begin of each node, and the end of the last.
    pub(super) times: Vec<Time>,
    /// Where data are missing: begin, and length in seconds.
    gaps: Vec<(Time, f64)>,
    /// The node that is not complete yet.
    open: Node,
}

impl Default for Record {
    fn default() -> Self {
        Record {
            nodes: Vec::new(),
            times: Vec::new(),
            gaps: Vec::new(),
            open: Node::EMPTY,
        }
    }
}

/// A stretch of a record by the numbers of its nodes' begins, the end included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Span {
    pub(super) begin: usize,
    pub(super) end: usize,
}

impl Record {
    /// From increments in the order of time (coning and sculling inside, as [`crate::mechanization::IncrementBuilder`] gives
    /// them), raw: with the unit's biases in them.
    pub fn new(increments: impl IntoIterator<Item = Increment>) -> Self {
        let mut record = Record::default();
        for increment in increments {
            record.push(&increment);
        }
        record
    }

    /// Take one more raw increment; one without length says nothing.
    pub(crate) fn push(&mut self, increment: &Increment) {
        if increment.dt <= 0.0 {
            return;
        }
        let begin = increment.time.plus(-increment.dt);
        if self.times.is_empty() {
            self.times.push(begin);
        }
        if increment.dt > GAP {
            self.gaps.push((begin, increment.dt));
        }
        self.open.add(increment);
        if self.open.dt > NODE - 1e-6 {
            let mut node = core::mem::replace(&mut self.open, Node::EMPTY);
            node.rotation.renormalize();
            self.nodes.push(node);
            self.times.push(increment.time);
        }
    }

    /// What has come after the last complete node, as one increment.
    pub(crate) fn rest(&self) -> Option<Increment> {
        let begin = self.times.last()?;
        let Node {
            dt, rotation, gain, ..
        } = self.open;
        let rotation_b = log(&rotation);
        (dt > 0.0).then(|| Increment {
            time: begin.plus(dt),
            dt,
            rotation_b,
            // Less than a tenth of a second turns by too little for more terms.
            velocity_b: gain - rotation_b.cross(&gain) * 0.5,
        })
    }

    /// Begin and end of the data.
    pub fn range(&self) -> Option<(Time, Time)> {
        Some((*self.times.first()?, *self.times.last()?))
    }

    /// The nodes wholly inside a window.
    pub(super) fn span(&self, begin: Time, end: Time) -> Result<Span> {
        let (first, last) = self.range().ok_or(Refusal::NoData)?;
        let tolerance = 1e-6;
        if begin.since(first) < -NODE || end.since(last) > NODE || end <= begin {
            return Err(Refusal::OutsideData {
                begin_s: begin.seconds(),
                end_s: end.seconds(),
                data_begin_s: first.seconds(),
                data_end_s: last.seconds(),
            }
            .into());
        }
        let a = self.times.partition_point(|t| t.since(begin) < -tolerance);
        let b = self.times.partition_point(|t| t.since(end) <= tolerance);
        let span = Span {
            begin: a,
            end: b.max(1) - 1,
        };
        if span.end < span.begin + 2 {
            return Err(Refusal::NoData.into());
        }
        Ok(span)
    }

    /// Refuses holes in a stretch.
    pub(super) fn require_whole(&self, span: Span) -> Result<()> {
        let (begin, end) = (self.times[span.begin], self.times[span.end]);
        let hole = self
            .gaps
            .iter()
            .find(|(at, length)| *at < end && at.plus(*length) > begin);
        match hole {
            Some((at, length)) => Err(Refusal::GapInData {
                at_s: at.seconds(),
                length_s: *length,
            }
            .into()),
            None => Ok(()),
        }
    }

    /// Seconds from one node's begin to another's.
    pub(super) fn seconds(&self, from: usize, to: usize) -> f64 {
        self.times[to].since(self.times[from])
    }
}
