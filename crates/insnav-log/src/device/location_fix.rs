//! `foxglove.LocationFix`, in JSON, protobuf or as a ROS message: a position with its covariance, without a status.

use crate::content::{Content, Fix, Stamp, stated_covariance};
use crate::ros2::CovarianceType;
use crate::wire::{DecodeError, Fields, Wire};
use insnav_core::time::Time;

/// The position. Newer versions may have a velocity, whose axes the message's definition does not state: it is left alone.
pub(crate) fn location_fix<'a>(fields: &mut Fields<'a>) -> Result<Content<'a>, DecodeError> {
    let stamp = fields.or_absent(Time(0), |f| f.time("timestamp"))?;
    let frame_id = fields.or_absent("", |f| f.string("frame_id"))?;
    let covariance = fields.or_absent([0.0; 9], |f| f.f64_array("position_covariance"))?;
    Ok(Content {
        position: Some(Fix {
            no_fix: false,
            latitude_deg: fields.f64("latitude")?,
            longitude_deg: fields.f64("longitude")?,
            height_m: fields.or_absent(0.0, |f| f.f64("altitude"))?,
            ellipsoidal: false,
            covariance_enu: stated_covariance(covariance_type(fields)?, &covariance),
        }),
        ..Content::empty(Stamp::Host(stamp), frame_id)
    })
}

/// A number, or its name, which is how protobuf writes an enumeration in JSON.
fn covariance_type(fields: &mut Fields<'_>) -> Result<CovarianceType, DecodeError> {
    Ok(match fields.string("position_covariance_type") {
        Ok("APPROXIMATED") => CovarianceType::Approximated,
        Ok("DIAGONAL_KNOWN") => CovarianceType::DiagonalKnown,
        Ok("KNOWN") => CovarianceType::Known,
        Ok(_) => CovarianceType::Unknown,
        Err(_) => CovarianceType::from(fields.or_absent(0, |f| f.u8("position_covariance_type"))?),
    })
}
