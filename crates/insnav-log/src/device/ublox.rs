//! `ublox_msgs/NavPVT` and `NavRELPOSNED9`: u-blox' own messages, integers in millimetres and fractions of degrees.
//!
//! \[UBX-F9\], UBX-NAV-PVT and UBX-NAV-RELPOSNED.

use super::from_sigmas;
use crate::calendar;
use crate::content::{Content, Fix, NorthHeading, Stamp, Velocity};
use crate::ros2::Header;
use crate::wire::{DecodeError, Fields, Wire};
use insnav_core::time::Time;
use nalgebra::Vector3;

/// Bits of `valid`: date, time of day, and both resolved to the second.
const UTC_VALID: i64 = 0b111;

/// Position and velocity. Height is above the ellipsoid.
///
/// The message has no header: its stamp is its UTC, which is the receiver's clock; where that is not valid yet, the log
/// time is taken.
pub(crate) fn nav_pvt<'a>(fields: &mut Fields<'a>) -> Result<Content<'a>, DecodeError> {
    let header = Header::of(fields)?;
    let stamp = match utc(fields)? {
        Some(utc) if header.stamp.0 == 0 => Stamp::Own(utc),
        _ => Stamp::Host(header.stamp),
    };
    let fix_type = fields.u8("fixType")?;
    let flags = fields.u8("flags")?;
    // Two and three dimensions, and with dead reckoning; "fix OK" says within the limits of accuracy.
    let no_fix = !(2..=4).contains(&fix_type) || flags & 1 == 0;
    let mut millimetres = |name: &'static str| Ok(fields.f64(name)? * 1e-3);
    let (horizontal, vertical) = (millimetres("hAcc")?, millimetres("vAcc")?);
    let speed_sigma = millimetres("sAcc")?;
    let north = millimetres("velN")?;
    let east = millimetres("velE")?;
    let down = millimetres("velD")?;
    let height_m = millimetres("height")?;
    let position = Fix {
        no_fix,
        latitude_deg: fields.f64("lat")? * 1e-7,
        longitude_deg: fields.f64("lon")? * 1e-7,
        height_m,
        ellipsoidal: true,
        // Taken for each axis, as the drivers do that make a NavSatFix of this message.
        covariance_enu: from_sigmas(horizontal, vertical),
    };
    let velocity = Velocity {
        no_fix,
        by_convention: false,
        enu: Vector3::new(east, north, -down),
        covariance_enu: from_sigmas(speed_sigma, speed_sigma),
    };
    Ok(Content {
        position: Some(position),
        velocity: Some(velocity),
        ..Content::empty(stamp, header.frame_id)
    })
}

fn utc(fields: &mut Fields<'_>) -> Result<Option<Time>, DecodeError> {
    if i64::from(fields.u8("valid")?) & UTC_VALID != UTC_VALID {
        return Ok(None);
    }
    // Bytes of rubbish may say any number: a date that does not exist is none.
    let mut number = |name: &'static str| Ok(fields.f64(name)? as i64);
    let (year, month, day) = (number("year")?, number("month")?, number("day")?);
    let seconds = [
        (number("hour")?, 3600),
        (number("min")?, 60),
        (number("sec")?, 1),
    ]
    .iter()
    .try_fold(0, |sum: i64, &(value, unit)| {
        (0..=60).contains(&value).then_some(sum + value * unit)
    });
    // The fraction may be negative: the second is rounded.
    let nano = number("nano")?.clamp(-1_000_000_000, 1_000_000_000);
    let day = match (u32::try_from(month), u32::try_from(day)) {
        (Ok(month), Ok(day)) => calendar::day_of(year, month, day),
        _ => None,
    };
    Ok(day
        .zip(seconds)
        .and_then(|(day, seconds)| calendar::at(day, seconds * 1_000_000_000 + nano)))
}

/// Bits of `flags`: the relative position is valid, its heading is.
const POSITION_VALID: i64 = 1 << 2;
const HEADING_VALID: i64 = 1 << 8;

/// Heading of the line from the moving base's antenna to the rover's, as that of the body: right where both are mounted along
/// its forward axis, which is why this message is used only when it is named.
pub(crate) fn nav_rel_pos_ned<'a>(fields: &mut Fields<'a>) -> Result<Content<'a>, DecodeError> {
    let header = Header::of(fields)?;
    let flags = fields.f64("flags")? as i64;
    let heading = if fields.has("relPosHeading") {
        let valid = flags & POSITION_VALID != 0 && flags & HEADING_VALID != 0;
        let degrees = fields.f64("relPosHeading")? * 1e-5;
        let sigma_degrees = fields.f64("accHeading")? * 1e-5;
        valid.then(|| (degrees.to_radians(), sigma_degrees.to_radians()))
    } else {
        // Before protocol version 27: centimetres, with tenths of a millimetre beside them.
        let north = fields.f64("relPosN")? + fields.f64("relPosHPN")? * 1e-2;
        let east = fields.f64("relPosE")? + fields.f64("relPosHPE")? * 1e-2;
        let sigma_cm = fields.f64("accN")?.max(fields.f64("accE")?) * 1e-2;
        let length = north.hypot(east);
        let valid = flags & POSITION_VALID != 0 && length > 0.0;
        valid.then(|| (east.atan2(north), sigma_cm / length))
    };
    Ok(Content {
        heading: heading.map(|(heading, sigma)| NorthHeading { heading, sigma }),
        ..Content::empty(Stamp::Host(header.stamp), header.frame_id)
    })
}
