//! Alignment: attitude before there is one.

use crate::mechanization::NavState;
use crate::time::Time;
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Where the heading of a start came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeadingSource {
    /// Course of GNSS velocities.
    CourseVelocity,
    /// Course of GNSS positions.
    CoursePosition,
    /// Given by the user or by a heading sensor.
    Given,
    /// None: heading is unknown, its sigma that of a uniform distribution.
    Unknown,
}

/// A start: attitude, its sigmas, and where they came from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Alignment {
    /// State at the first sample.
    pub nav: NavState,
    /// Standard deviations of roll, pitch, heading as small rotations in NED, rad.
    pub attitude_sigma: Vector3<f64>,
    /// True when levelling used standing data, false when it averaged over motion.
    pub levelled_at_rest: bool,
    /// Where the heading came from.
    pub heading_source: HeadingSource,
    /// When the heading became known (the run itself begins at the first sample).
    pub heading_at: Time,
    /// Rotation from body to NED at the first sample.
    pub q_nb: UnitQuaternion<f64>,
}
