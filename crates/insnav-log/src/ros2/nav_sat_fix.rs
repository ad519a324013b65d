//! `sensor_msgs/msg/NavSatFix`.

use super::{Decode, Encode, Header};
use crate::cdr::CdrWriter;
use crate::wire::{DecodeError, Wire};

/// What the stated covariance is worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum CovarianceType {
    /// Nothing: not known.
    #[default]
    Unknown = 0,
    /// Made up from a dilution of precision.
    Approximated = 1,
    /// The diagonal is known.
    DiagonalKnown = 2,
    /// All of it is known.
    Known = 3,
}

impl From<u8> for CovarianceType {
    /// As messages number them; what they do not define is worth nothing.
    fn from(number: u8) -> Self {
        match number {
            1 => CovarianceType::Approximated,
            2 => CovarianceType::DiagonalKnown,
            3 => CovarianceType::Known,
            _ => CovarianceType::Unknown,
        }
    }
}

/// A GNSS position.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NavSatFix<'a> {
    /// Stamp, and the frame of the antenna.
    pub header: Header<'a>,
    /// −2 not set, −1 no fix, 0 fix, 1 satellite-based augmentation, 2 ground-based augmentation.
    pub status: i8,
    /// Bits of the satellite systems in use.
    pub service: u16,
    /// Latitude, degrees.
    pub latitude_deg: f64,
    /// Longitude, degrees.
    pub longitude_deg: f64,
    /// Height, m: above the ellipsoid by definition, above sea level from many drivers.
    pub altitude_m: f64,
    /// Covariance in east, north, up, m², row by row.
    pub position_covariance: [f64; 9],
    /// What the covariance is worth.
    pub position_covariance_type: CovarianceType,
}

impl<'a> Decode<'a> for NavSatFix<'a> {
    fn read<W: Wire<'a>>(from: &mut W) -> Result<Self, DecodeError> {
        let header = Header::of(from)?;
        let (status, service) = from.or_absent((-2, 0), |from| {
            from.nested("status", |from| {
                Ok((
                    from.i8("status")?,
                    from.or_absent(0, |from| from.u16("service"))?,
                ))
            })
        })?;
        Ok(NavSatFix {
            header,
            status,
            service,
            latitude_deg: from.f64("latitude")?,
            longitude_deg: from.f64("longitude")?,
            altitude_m: from.f64("altitude")?,
            position_covariance: from
                .or_absent([0.0; 9], |from| from.f64_array("position_covariance"))?,
            position_covariance_type: CovarianceType::from(
                from.or_absent(0, |from| from.u8("position_covariance_type"))?,
            ),
        })
    }
}

impl Encode for NavSatFix<'_> {
    const SCHEMA: &'static str = "sensor_msgs/msg/NavSatFix";

    fn write(&self, to: &mut CdrWriter) {
        self.header.write(to);
        to.i8(self.status);
        to.u16(self.service);
        to.f64(self.latitude_deg);
        to.f64(self.longitude_deg);
        to.f64(self.altitude_m);
        to.f64_array(&self.position_covariance);
        to.u8(self.position_covariance_type as u8);
    }
}
