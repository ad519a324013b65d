//! `geometry_msgs/msg/TwistStamped` and `TwistWithCovarianceStamped`: how GNSS drivers publish velocity.

use super::{Decode, Encode, Header};
use crate::cdr::CdrWriter;
use crate::wire::{DecodeError, Wire};
use nalgebra::Vector3;

/// Linear and angular velocity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// m/s; east, north, up from GNSS drivers.
    pub linear: Vector3<f64>,
    /// rad/s.
    pub angular: Vector3<f64>,
}

impl<'a> Decode<'a> for Twist {
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        Ok(Twist {
            linear: from.components("linear", ["x", "y", "z"])?.into(),
            angular: from
                .or_absent([0.0; 3], |from| from.components("angular", ["x", "y", "z"]))?
                .into(),
        })
    }
}

impl Twist {
    pub(crate) fn write(&self, to: &mut CdrWriter) {
        to.f64_array(self.linear.as_slice());
        to.f64_array(self.angular.as_slice());
    }
}

/// A velocity at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TwistStamped<'a> {
    /// Stamp and frame.
    pub header: Header<'a>,
    /// The velocity.
    pub twist: Twist,
}

impl<'a> Decode<'a> for TwistStamped<'a> {
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        Ok(TwistStamped {
            header: Header::of(from)?,
            twist: from.nested("twist", Twist::read)?,
        })
    }
}

impl Encode for TwistStamped<'_> {
    const SCHEMA: &'static str = "geometry_msgs/msg/TwistStamped";

    fn write(&self, to: &mut CdrWriter) {
        self.header.write(to);
        self.twist.write(to);
    }
}

/// A velocity at an instant and its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwistWithCovarianceStamped<'a> {
    /// Stamp and frame.
    pub header: Header<'a>,
    /// The velocity.
    pub twist: Twist,
    /// Covariance of linear, then angular velocity, 6 × 6 row by row.
    pub covariance: [f64; 36],
}

impl<'a> Decode<'a> for TwistWithCovarianceStamped<'a> {
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        let header = Header::of(from)?;
        from.nested("twist", |from| {
            Ok(TwistWithCovarianceStamped {
                header,
                twist: from.nested("twist", Twist::read)?,
                covariance: from.or_absent([0.0; 36], |from| from.f64_array("covariance"))?,
            })
        })
    }
}

impl Encode for TwistWithCovarianceStamped<'_> {
    const SCHEMA: &'static str = "geometry_msgs/msg/TwistWithCovarianceStamped";

    fn write(&self, to: &mut CdrWriter) {
        self.header.write(to);
        self.twist.write(to);
        to.f64_array(&self.covariance);
    }
}
