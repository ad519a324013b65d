//! `geometry_msgs/msg/PoseStamped`.

use super::{Decode, Encode, Header};
use crate::cdr::{CdrError, CdrReader, CdrWriter};
use nalgebra::Vector3;

/// Position and orientation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Position, m.
    pub position: Vector3<f64>,
    /// Orientation x, y, z, w.
    pub orientation: [f64; 4],
}

impl Decode<'_> for Pose {
    fn read(from: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        Ok(Pose {
            position: from.f64_array()?.into(),
            orientation: from.f64_array()?,
        })
    }
}

impl Pose {
    pub(crate) fn write(&self, to: &mut CdrWriter) {
        to.f64_array(self.position.as_slice());
        to.f64_array(&self.orientation);
    }
}

/// A pose at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PoseStamped<'a> {
    /// Stamp, and the frame that the pose is given in.
    pub header: Header<'a>,
    /// The pose.
    pub pose: Pose,
}

impl<'a> Decode<'a> for PoseStamped<'a> {
    fn read(from: &mut CdrReader<'a>) -> Result<Self, CdrError> {
        Ok(PoseStamped {
            header: Header::read(from)?,
            pose: Pose::read(from)?,
        })
    }
}

impl Encode for PoseStamped<'_> {
    const SCHEMA: &'static str = "geometry_msgs/msg/PoseStamped";

    fn write(&self, to: &mut CdrWriter) {
        self.header.write(to);
        self.pose.write(to);
    }
}
