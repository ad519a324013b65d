//! What is summed up between two corrections, in axes that do not turn.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Integrals over the samples of an interval, and sums over its fields.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Block {
    /// Length, s.
    pub(super) time: f64,
    /// ∫C dt.
    pub(super) turned: Matrix3<f64>,
    /// ∫C (f − b_a) dt, m/s.
    pub(super) pushed: Vector3<f64>,
    /// ∫ω_measured dt, body.
    pub(super) measured_rate: Vector3<f64>,
    /// ∫|ω|² dt.
    pub(super) rate_squared: f64,
    /// ∫|a|² dt of the acceleration without gravity.
    pub(super) force_squared: f64,
    /// Attitude variance of turns that saturated gyros did not see.
    pub(super) unseen_turn: Matrix3<f64>,
    /// Fields in the block.
    pub(super) fields: u32,
    /// Sum of fields in level axes.
    pub(super) field: Vector3<f64>,
    /// Sum of the attitudes they were turned by.
    pub(super) attitudes: Matrix3<f64>,
    /// Sum of what a second of delay more would turn the field by.
    pub(super) per_delay: Vector3<f64>,
    /// Sum of |ω × m|² / 3.
    pub(super) per_stamp_squared: f64,
}

impl Block {
    /// The same in level axes that are turned; before there are fields.
    pub(super) fn turn(&mut self, axes: &Matrix3<f64>) {
        self.turned = axes * self.turned;
        self.pushed = axes * self.pushed;
        self.unseen_turn = axes * self.unseen_turn * axes.transpose();
    }
}
