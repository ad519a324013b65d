//! `nav_msgs/msg/Odometry`.

use super::{Decode, Encode, Header, Pose, Twist};
use crate::cdr::{CdrError, CdrReader, CdrWriter};

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
    fn read(from: &mut CdrReader<'a>) -> Result<Self, CdrError> {
        Ok(Odometry {
            header: Header::read(from)?,
            child_frame_id: from.string()?,
            pose: Pose::read(from)?,
            pose_covariance: from.f64_array()?,
            twist: Twist::read(from)?,
            twist_covariance: from.f64_array()?,
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
