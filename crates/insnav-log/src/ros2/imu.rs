//! `sensor_msgs/msg/Imu`.

use super::{Decode, Encode, Header};
use crate::cdr::CdrWriter;
use crate::wire::{DecodeError, Wire};
use nalgebra::Vector3;

/// Angular rate, specific force and perhaps an orientation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Imu<'a> {
    /// Stamp and frame.
    pub header: Header<'a>,
    /// Orientation x, y, z, w.
    pub orientation: [f64; 4],
    /// Its covariance, rad², row by row; first element −1: there is no orientation.
    pub orientation_covariance: [f64; 9],
    /// Angular rate, rad/s.
    pub angular_velocity: Vector3<f64>,
    /// Its covariance, row by row.
    pub angular_velocity_covariance: [f64; 9],
    /// Specific force (the name notwithstanding), m/s².
    pub linear_acceleration: Vector3<f64>,
    /// Its covariance, row by row.
    pub linear_acceleration_covariance: [f64; 9],
}

/// The covariance of an orientation that a message does not have.
const NOT_THERE: [f64; 9] = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];

impl<'a> Decode<'a> for Imu<'a> {
    #[inline]
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        Ok(Imu {
            header: Header::of(from)?,
            orientation: from.or_absent([0.0; 4], |from| {
                from.components("orientation", ["x", "y", "z", "w"])
            })?,
            orientation_covariance: from
                .or_absent(NOT_THERE, |from| from.f64_array("orientation_covariance"))?,
            angular_velocity: from.components("angular_velocity", ["x", "y", "z"])?.into(),
            angular_velocity_covariance: from.or_absent([0.0; 9], |from| {
                from.f64_array("angular_velocity_covariance")
            })?,
            linear_acceleration: from
                .components("linear_acceleration", ["x", "y", "z"])?
                .into(),
            linear_acceleration_covariance: from.or_absent([0.0; 9], |from| {
                from.f64_array("linear_acceleration_covariance")
            })?,
        })
    }
}

impl Encode for Imu<'_> {
    const SCHEMA: &'static str = "sensor_msgs/msg/Imu";

    fn write(&self, to: &mut CdrWriter) {
        self.header.write(to);
        to.f64_array(&self.orientation);
        to.f64_array(&self.orientation_covariance);
        to.f64_array(self.angular_velocity.as_slice());
        to.f64_array(&self.angular_velocity_covariance);
        to.f64_array(self.linear_acceleration.as_slice());
        to.f64_array(&self.linear_acceleration_covariance);
    }
}
