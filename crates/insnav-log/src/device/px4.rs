//! PX4's messages: forward-right-down and north-east-down, stamped in microseconds since the autopilot's power-on, or of Unix
//! time where its bridge to ROS 2 keeps both clocks equal.

use super::from_sigmas;
use crate::content::{Axes, Content, Fix, Rates, Stamp, Velocity};
use crate::wire::{DecodeError, FieldName, Fields, Wire};
use insnav_core::time::Time;
use nalgebra::Vector3;

/// Stamps above this are Unix time: 2001-09-09; no autopilot runs for thirty years.
const UNIX_FROM_US: i64 = 1_000_000_000_000_000;
/// The stamp of accelerations that are not valid.
const INVALID: i64 = 0x7fff_ffff;

/// `px4_msgs/SensorCombined`: rates and forces, each the mean over its interval.
///
/// A mean is the value in the middle of its interval, so half of the interval is taken off the stamp. They are not taken as
/// increments from one message to the next: the bridge to ROS 2 thins messages out, and then the intervals do not join.
pub(crate) fn sensor_combined<'a>(fields: &mut Fields<'a>) -> Result<Content<'a>, DecodeError> {
    let interval_us = fields.f64("gyro_integral_dt")?;
    let angular_rate: [f64; 3] = fields.f64_array("gyro_rad")?;
    let force_valid = fields
        .integer_at("accelerometer_timestamp_relative")
        .is_none_or(|us| us != INVALID);
    let mut specific_force: [f64; 3] = fields.f64_array("accelerometer_m_s2")?;
    if !force_valid {
        specific_force = [f64::NAN; 3];
    }
    Ok(Content {
        rates: Some(Rates {
            angular_rate: angular_rate.into(),
            specific_force: specific_force.into(),
            axes: Axes::Frd,
        }),
        ..Content::empty(stamp(fields, -0.5 * interval_us)?, "")
    })
}

/// `px4_msgs/SensorGps`, and `VehicleGpsPosition` before it: position in degrees or in 1e-7 degrees and millimetres.
pub(crate) fn sensor_gps<'a>(fields: &mut Fields<'a>) -> Result<Content<'a>, DecodeError> {
    // 0 and 1: none. 2 has no height of its own.
    let no_fix = fields.u8("fix_type")? < 2;
    let (latitude_deg, longitude_deg) = if fields.has("latitude_deg") {
        (fields.f64("latitude_deg")?, fields.f64("longitude_deg")?)
    } else {
        (fields.f64("lat")? * 1e-7, fields.f64("lon")? * 1e-7)
    };
    let height_m = if fields.has("altitude_ellipsoid_m") {
        fields.f64("altitude_ellipsoid_m")?
    } else {
        fields.f64("alt_ellipsoid")? * 1e-3
    };
    let (eph, epv) = (fields.f64("eph")?, fields.f64("epv")?);
    let position = Fix {
        no_fix,
        latitude_deg,
        longitude_deg,
        height_m,
        ellipsoidal: true,
        covariance_enu: from_sigmas(eph, epv),
    };
    // The name notwithstanding, a standard deviation.
    let sigma = fields.or_absent(f64::NAN, |f| f.f64("s_variance_m_s"))?;
    let down = fields.f64("vel_d_m_s")?;
    let velocity = Velocity {
        no_fix: no_fix || fields.or_absent(1, |f| f.u8("vel_ned_valid"))? == 0,
        by_convention: false,
        enu: Vector3::new(fields.f64("vel_e_m_s")?, fields.f64("vel_n_m_s")?, -down),
        covariance_enu: from_sigmas(sigma, sigma),
    };
    Ok(Content {
        position: Some(position),
        velocity: Some(velocity),
        ..Content::empty(stamp(fields, 0.0)?, "")
    })
}

/// One gauss in tesla.
const GAUSS: f64 = 1e-4;

/// `px4_msgs/VehicleMagnetometer`: field in gauss.
pub(crate) fn vehicle_magnetometer<'a>(
    fields: &mut Fields<'a>,
) -> Result<Content<'a>, DecodeError> {
    let field: [f64; 3] = fields.f64_array("magnetometer_ga")?;
    Ok(Content {
        field: Some((Vector3::from(field) * GAUSS, Axes::Frd)),
        ..Content::empty(stamp(fields, 0.0)?, "")
    })
}

fn stamp(fields: &Fields<'_>, shift_us: f64) -> Result<Stamp, DecodeError> {
    let us = fields
        .integer_at("timestamp")
        .ok_or(DecodeError::Missing(FieldName {
            parent: "",
            name: "timestamp",
        }))?;
    let shift_ns = if shift_us.is_finite() {
        (shift_us * 1e3) as i64
    } else {
        0
    };
    let time = Time(us.saturating_mul(1000).saturating_add(shift_ns));
    Ok(match us {
        0 => Stamp::Host(Time(0)),
        us if us < UNIX_FROM_US => Stamp::Own(time),
        _ => Stamp::Host(time),
    })
}
