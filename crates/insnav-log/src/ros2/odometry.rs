//! `nav_msgs/msg/Odometry`.

use super::{Decode, Encode, Header, Pose, Twist};
use crate::cdr::CdrWriter;
use crate::wire::{DecodeError, Wire};

/// A pose in `header.frame_id` and a velocity in `child_frame_id`, each with its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Odometry<'a> {
    /// Stamp, and the frame that the pose is given in.
    pub header: Header<'a>,
    /// The moving frame, in whose axes the velocity is given.
    pub child_frame_id: &'a str,
    /// The pose.
    pub pose: Pose,
    /// Covariance of position, then of the rotation about the fixed axes, 6 × 6 row by row.
    pub pose_covariance: [f64; 36],
    /// The velocity.
    pub twist: Twist,
    /// Covariance of linear, then angular velocity, 6 × 6 row by row.
    pub twist_covariance: [f64; 36],
}

impl<'a> Decode<'a> for Odometry<'a> {
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        let header = Header::of(from)?;
        let child_frame_id = from.or_absent("", |from| from.string("child_frame_id"))?;
        let (pose, pose_covariance) = from.nested("pose", |from| {
            Ok((
                from.nested("pose", Pose::read)?,
                from.or_absent([0.0; 36], |from| from.f64_array("covariance"))?,
            ))
        })?;
        let (twist, twist_covariance) = from.nested("twist", |from| {
            Ok((
                from.nested("twist", Twist::read)?,
                from.or_absent([0.0; 36], |from| from.f64_array("covariance"))?,
            ))
        })?;
        Ok(Odometry {
            header,
            child_frame_id,
            pose,
            pose_covariance,
            twist,
            twist_covariance,
        })
    }
}

impl Encode for Odometry<'_> {
    const SCHEMA: &'static str = "nav_msgs/msg/Odometry";

    fn write(&self, to: &mut CdrWriter) {
        self.header.write(to);
        to.string(self.child_frame_id);
        self.pose.write(to);
        to.f64_array(&self.pose_covariance);
        self.twist.write(to);
        to.f64_array(&self.twist_covariance);
    }
}
