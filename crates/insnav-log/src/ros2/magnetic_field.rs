//! `sensor_msgs/msg/MagneticField`.

use super::{Decode, Encode, Header};
use crate::cdr::CdrWriter;
use crate::wire::{DecodeError, Wire};
use nalgebra::Vector3;

/// A magnetic field.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MagneticField<'a> {
    /// Stamp and frame.
    pub header: Header<'a>,
    /// Field, T.
    pub magnetic_field: Vector3<f64>,
    /// Its covariance, T², row by row; zeros: not known.
    pub magnetic_field_covariance: [f64; 9],
}

impl<'a> Decode<'a> for MagneticField<'a> {
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        Ok(MagneticField {
            header: Header::of(from)?,
            magnetic_field: from.components("magnetic_field", ["x", "y", "z"])?.into(),
            magnetic_field_covariance: from
                .or_absent([0.0; 9], |from| from.f64_array("magnetic_field_covariance"))?,
        })
    }
}

impl Encode for MagneticField<'_> {
    const SCHEMA: &'static str = "sensor_msgs/msg/MagneticField";

    fn write(&self, to: &mut CdrWriter) {
        self.header.write(to);
        to.f64_array(self.magnetic_field.as_slice());
        to.f64_array(&self.magnetic_field_covariance);
    }
}
