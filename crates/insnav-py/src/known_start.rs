//! A start as the user knows it → what the plan takes.

use crate::arrays::{Argument, MOST_SECONDS, too_far};
use crate::failure::{Failure, fail};
use insnav_core::attitude::Euler;
use insnav_core::earth::Geodetic;
use insnav_log::KnownStart;
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::PyMapping;

const TIME: &str = "time_s";
const POSITION: &str = "latitude_deg_longitude_deg_height_m";
const VELOCITY: &str = "velocity_n_m_per_s";
const ATTITUDE: &str = "roll_deg_pitch_deg_heading_deg";
const POSITION_SIGMA: &str = "sigma_position_n_m";
const VELOCITY_SIGMA: &str = "sigma_velocity_n_m_per_s";
const ATTITUDE_SIGMA: &str = "sigma_attitude_n_deg";
const KEYS: [&str; 7] = [
    TIME,
    POSITION,
    VELOCITY,
    ATTITUDE,
    POSITION_SIGMA,
    VELOCITY_SIGMA,
    ATTITUDE_SIGMA,
];

const SECONDS: &str = "give seconds on the scale of the solution's time_s";

/// A start from a mapping with the keys of `insnav.Start`.
pub(crate) fn known_start(given: &Bound<'_, PyAny>) -> PyResult<KnownStart> {
    let py = given.py();
    let fail = fail(py);
    let given = given.cast::<PyMapping>().map_err(|_| {
        fail(Failure::argument(
            "bad_start",
            "start",
            format!("an object of {}", given.get_type()),
            "a mapping with the keys of insnav.Start",
            "",
        ))
    })?;
    for key in given.keys()?.iter() {
        let key = key.str()?.to_string();
        if !KEYS.contains(&key.as_str()) {
            return Err(fail(
                Failure::new(
                    "bad_start",
                    format!("start: unknown key `{key}`"),
                    format!("known: {}", KEYS.join(", ")),
                )
                .about("start", key, format!("one of {}", KEYS.join(", "))),
            ));
        }
        let name = format!("start: {key}");
        let value = given.get_item(&key)?;
        // A day without a time is an object like any other to numpy.
        let dated =
            value.hasattr("isoformat")? || Argument::new(&name, &value).is_dated().map_err(fail)?;
        if dated {
            return Err(fail(
                Failure::new(
                    "bad_start",
                    format!("{name} is a date, expected a number"),
                    SECONDS,
                )
                .about(&name, "a date", "a number"),
            ));
        }
    }
    let item = |key: &str| -> PyResult<Argument<'_>> {
        if !given.contains(key)? {
            return Err(fail(
                Failure::new(
                    "bad_start",
                    format!("start: `{key}` is missing"),
                    "a start needs position, velocity and attitude, each with its sigmas",
                )
                .about(&format!("start: {key}"), "nothing", "three numbers"),
            ));
        }
        Ok(Argument {
            name: format!("start: {key}"),
            object: given.get_item(key)?,
        })
    };
    let vector = |key: &str, rule: fn(f64) -> bool, expected: &str| -> PyResult<Vector3<f64>> {
        let values = item(key)?.column(Some(3)).map_err(fail)?;
        if values.iter().all(|&x| x.is_finite() && rule(x)) {
            Ok(Vector3::from_column_slice(&values))
        } else {
            Err(fail(
                Failure::new(
                    "bad_start",
                    format!("start: {key} = {values:?}"),
                    format!("three numbers, {expected}"),
                )
                .about(
                    &format!("start: {key}"),
                    format!("{values:?}"),
                    format!("three numbers, {expected}"),
                ),
            ))
        }
    };
    let finite = |key| vector(key, |_| true, "finite");
    let sigma = |key| vector(key, |x| x > 0.0, "finite and above 0");
    let time_s = match given.contains(TIME)? && !given.get_item(TIME)?.is_none() {
        true => Some(item(TIME)?.object.extract::<f64>().map_err(|_| {
            fail(Failure::argument(
                "bad_start",
                "start: time_s",
                "no number",
                "a number",
                SECONDS,
            ))
        })?),
        false => None,
    };
    if time_s.is_some_and(|t| !t.is_finite()) {
        return Err(fail(
            Failure::new(
                "bad_start",
                "start: time_s is not finite",
                "seconds, or leave it out for the first inertial sample",
            )
            .about("start: time_s", "not finite", "seconds"),
        ));
    }
    if let Some(t) = time_s.filter(|t| t.abs() > MOST_SECONDS) {
        return Err(fail(too_far("start: time_s", "", t)));
    }
    let p = finite(POSITION)?;
    let position = Geodetic::from_degrees(p.x, p.y, p.z);
    if !position.is_valid() {
        return Err(fail(
            Failure::new(
                "bad_start",
                format!("start: {POSITION} = [{}, {}, {}]", p.x, p.y, p.z),
                "latitude and longitude in degrees, height in metres",
            )
            .about(
                &format!("start: {POSITION}"),
                format!("[{}, {}, {}]", p.x, p.y, p.z),
                "latitude and longitude in degrees, height in metres",
            ),
        ));
    }
    let a = finite(ATTITUDE)?;
    Ok(KnownStart {
        time_s,
        position,
        velocity_n: finite(VELOCITY)?,
        q_nb: Euler::from_degrees(a.x, a.y, a.z).to_quaternion(),
        position_sigma: sigma(POSITION_SIGMA)?,
        velocity_sigma: sigma(VELOCITY_SIGMA)?,
        attitude_sigma: sigma(ATTITUDE_SIGMA)?.map(f64::to_radians),
    })
}
