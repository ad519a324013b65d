//! A stop as it was.

use super::Evidence;
use crate::config::StationaryMode;
use crate::time::Time;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Why a stop ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopEnd {
    /// The detector saw motion.
    Motion,
    /// Who had declared it took it back.
    Withdrawn,
    /// What the inertial unit measured no longer fits a body at rest: tilt, turn.
    Contradicted,
    /// The inertial data have a hole.
    Gap,
    /// The data end.
    End,
}

/// A stop: when, why it was believed, and what it did to heading and biases.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StopRecord {
    /// Since when the detector has agreed.
    pub begin: Time,
    /// From which instant the filter made use of it.
    pub held_from: Time,
    /// End.
    pub end: Time,
    /// Why it ended.
    pub ended_by: StopEnd,
    /// How it was held at its end, which is not always as set: see [`StationaryMode`].
    pub mode: StationaryMode,
    /// What spoke for it when it was believed.
    pub evidence: Evidence,
    /// Heading just before the filter made use of it, rad.
    pub heading_before: f64,
    /// Its standard deviation, rad.
    pub sigma_heading_before: f64,
    /// Correction of the heading when the stop was entered, rad. With growth and corrections it makes `heading_after` of
    /// `heading_before`: [`HeadingLedger`](super::HeadingLedger) says what is what.
    pub heading_at_entry: f64,
    /// By how much the heading left the one that was held, rad.
    pub heading_growth: f64,
    /// By how much the held heading was moved by what was learnt during the stop, rad.
    pub heading_corrections: f64,
    /// Heading at the end, rad.
    pub heading_after: f64,
    /// Its standard deviation, rad.
    pub sigma_heading_after: f64,
    /// Gyro bias at the end, body axes, rad/s.
    pub gyro_bias: Vector3<f64>,
    /// Its standard deviation, rad/s.
    pub sigma_gyro_bias: Vector3<f64>,
    /// Steps in which the gyros' values come, rad/s, where these are coarser than their noise; else 0.
    pub gyro_step: Vector3<f64>,
    /// Whether a gyro repeated one value: its mean is then no more known to be its bias than by the class of the unit.
    pub gyro_repeats: [bool; 3],
}
