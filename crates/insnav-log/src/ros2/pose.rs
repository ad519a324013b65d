//! `geometry_msgs/msg/PoseStamped`.

use super::{Decode, Encode, Header};
use crate::cdr::CdrWriter;
use crate::wire::{DecodeError, Wire};
use nalgebra::Vector3;

/// Position and orientation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Position, m.
    pub position: Vector3<f64>,
    /// Orientation x, y, z, w.
    pub orientation: [f64; 4],
}

impl<'a> Decode<'a> for Pose {
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        Ok(Pose {
            position: from.components("position", ["x", "y", "z"])?.into(),
            orientation: from.components("orientation", ["x", "y", "z", "w"])?,
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
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        Ok(PoseStamped {
            header: Header::of(from)?,
            pose: from.nested("pose", Pose::read)?,
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
