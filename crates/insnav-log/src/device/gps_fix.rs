//! `gps_msgs/GPSFix` (ROS 1: `gps_common/GPSFix`): position, and velocity as track, speed and climb.

use super::from_sigmas;
use crate::content::{Content, Fix, Stamp, Velocity, stated_covariance};
use crate::ros2::{CovarianceType, Header};
use crate::wire::{DecodeError, Fields, Wire};
use nalgebra::Vector3;

/// The message's errors are bounds of 95 %. On one axis that is 1.96 standard deviations; of a circle's radius √(−2 ln 0.05).
const AXIS_95: f64 = 1.959_963_984_540_054;
const CIRCLE_95: f64 = 2.447_746_830_680_816;

/// Position and velocity. The covariance goes before the error fields; a zero or negative error is not stated.
pub(crate) fn gps_fix<'a>(fields: &mut Fields<'a>) -> Result<Content<'a>, DecodeError> {
    let header = Header::of(fields)?;
    let status = fields.integer_at("status.status").unwrap_or(0);
    let covariance = fields.or_absent([0.0; 9], |f| f.f64_array("position_covariance"))?;
    let kind = CovarianceType::from(fields.or_absent(0, |f| f.u8("position_covariance_type"))?);
    let mut optional = |name: &'static str| fields.or_absent(f64::NAN, |f| f.f64(name));
    let (err_horz, err_vert) = (optional("err_horz")?, optional("err_vert")?);
    let (err_speed, err_climb) = (optional("err_speed")?, optional("err_climb")?);
    let (track_deg, speed, climb) = (optional("track")?, optional("speed")?, optional("climb")?);

    let position = Fix {
        no_fix: status == -1,
        latitude_deg: fields.f64("latitude")?,
        longitude_deg: fields.f64("longitude")?,
        height_m: fields.f64("altitude")?,
        ellipsoidal: false,
        covariance_enu: stated_covariance(kind, &covariance)
            .or_else(|| from_sigmas(err_horz / CIRCLE_95, err_vert / AXIS_95)),
    };
    // All zero without an error is what a driver leaves that measures no velocity.
    let stated = !(speed == 0.0
        && track_deg == 0.0
        && climb == 0.0
        && (err_speed.is_nan() || err_speed <= 0.0));
    let velocity = (speed.is_finite() && track_deg.is_finite() && stated).then(|| {
        let (sin, cos) = track_deg.to_radians().sin_cos();
        let vertical = if err_climb > 0.0 {
            err_climb
        } else {
            err_speed
        };
        Velocity {
            no_fix: status == -1,
            by_convention: false,
            enu: Vector3::new(speed * sin, speed * cos, climb),
            covariance_enu: from_sigmas(err_speed / AXIS_95, vertical / AXIS_95),
        }
    });
    Ok(Content {
        position: Some(position),
        velocity,
        ..Content::empty(Stamp::Host(header.stamp), header.frame_id)
    })
}
