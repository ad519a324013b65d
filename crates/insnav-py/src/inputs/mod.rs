//! Arrays as the user has them → samples as the navigator takes them.
//!
//! `kinds` are the kinds of data with their columns, `stated` what fixes say of their errors, `source` the samples.

mod kinds;
mod source;
mod stated;

pub(crate) use kinds::{heading_sample, position_sample, velocity_sample};
pub(crate) use source::{Arrays, turn};
pub(crate) use stated::Stated;

use self::kinds::{Read, STREAMS, imu};
use self::source::Inertial;
use crate::arrays::{Argument, counted_from};
use crate::failure::{Failure, fail};
use insnav_core::config::Config;
use insnav_core::sample::{MagneticField, Sample};
use insnav_core::time::Time;
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::{PyMapping, PyTuple};

/// The instant from which the seconds of all kinds count, ns.
pub(crate) const ZERO: &str = "t0_ns";
/// Antenna from the IMU, where the settings do not say it.
const LEVER_ARM: &str = "lever_arm_b_m";

/// Keys of the kinds of data.
pub(crate) fn kinds() -> [&'static str; STREAMS.len()] {
    STREAMS.each_ref().map(|s| s.key)
}

/// All samples in the order of time; at one instant inertial ones first. Inertial ones are turned by the mounting that the
/// settings name.
pub(crate) fn arrays(arrays: &Bound<'_, PyMapping>, config: &Config) -> PyResult<Arrays> {
    let py = arrays.py();
    let keys = arrays.keys()?;
    for key in keys.iter() {
        let key = key.str()?.to_string();
        if !STREAMS.iter().any(|s| s.key == key) && key != ZERO && key != LEVER_ARM {
            let known = STREAMS.iter().map(|s| s.key).chain([ZERO, LEVER_ARM]);
            let known: Vec<&str> = known.collect();
            return Err(Failure::new(
                "unknown_stream",
                format!("unknown key `{key}` among the arrays"),
                format!("known: {}", known.join(", ")),
            )
            .about("log", key, format!("one of {}", known.join(", ")))
            .into_py_err(py));
        }
    }
    let given = |key: &str| keys.contains(key);
    if given("imu")? && given("imu_increment")? {
        return Err(Failure::new(
            "two_imus",
            "both `imu` and `imu_increment` are given",
            "give the inertial data once",
        )
        .about("log", "imu and imu_increment", "one of them")
        .into_py_err(py));
    }
    let origin = zero(arrays)?;
    let lever_arm_b = lever_arm(arrays)?;
    let (mut inertial, mut others) = (Inertial::default(), Vec::new());
    let mut dated = false;
    for stream in &STREAMS {
        if given(stream.key)? {
            let fail = fail(py);
            let arguments = stream.arguments(&arrays.get_item(stream.key)?)?;
            // Dates are instants already.
            let dates = arguments[0].is_dates().map_err(fail)?;
            dated |= dates && origin.0 == 0;
            let shift = if dates { 0 } else { origin.0 };
            let later = |t: Time| counted_from(Time(shift), &arguments[0].name, t);
            match stream.read {
                Read::Inertial(read) => {
                    inertial = read(&arguments).map_err(fail)?;
                    for time in &mut inertial.times {
                        *time = later(*time).map_err(fail)?;
                    }
                }
                Read::Aiding(read) => {
                    let samples = read(&arguments).map_err(fail)?;
                    for sample in samples {
                        others.push(sample.at(later(sample.time()).map_err(fail)?));
                    }
                }
            }
        }
    }
    // Stable: rows of one kind keep their order.
    others.sort_by_key(Sample::time);
    let arrays = Arrays {
        inertial,
        others,
        inertial_first: true,
        origin,
        dated,
        lever_arm_b,
    };
    Ok(arrays.mounted(config))
}

/// From when seconds count: 0 unless the arrays say it.
fn zero(arrays: &Bound<'_, PyMapping>) -> PyResult<Time> {
    if !arrays.contains(ZERO)? {
        return Ok(Time(0));
    }
    let given = arrays.get_item(ZERO)?;
    given.extract().map(Time).map_err(|_| {
        Failure::argument(
            "not_numbers",
            ZERO,
            given.to_string(),
            "a whole number of nanoseconds",
            "",
        )
        .into_py_err(arrays.py())
    })
}

fn lever_arm(arrays: &Bound<'_, PyMapping>) -> PyResult<Option<Vector3<f64>>> {
    if !arrays.contains(LEVER_ARM)? {
        return Ok(None);
    }
    let column = Argument::new(LEVER_ARM, &arrays.get_item(LEVER_ARM)?).column(Some(3));
    let arm = column.map_err(fail(arrays.py()))?;
    if arm.iter().all(|x| x.is_finite()) {
        return Ok(Some(Vector3::from_column_slice(&arm)));
    }
    Err(Failure::argument(
        "not_finite",
        LEVER_ARM,
        format!("{arm:?}"),
        "three finite numbers",
        "leave it out where it is not known",
    )
    .into_py_err(arrays.py()))
}

/// Rates, forces and, where there are, fields, in the order of time; at one instant the field first, so that it is known when the
/// inertial sample comes. Rows of `mag` with NaN are instants without a field.
pub(crate) fn inertial_and_magnetic(
    t: &Bound<'_, PyAny>,
    gyro: &Bound<'_, PyAny>,
    accel: &Bound<'_, PyAny>,
    mag: Option<&Bound<'_, PyAny>>,
    config: &Config,
) -> Result<Arrays, Failure> {
    let columns = [
        Argument::new("t", t),
        Argument::new("gyro", gyro),
        Argument::new("accel", accel),
    ];
    let inertial = imu(&columns)?;
    let mut others = Vec::new();
    if let Some(mag) = mag {
        // A pair of columns has stamps of its own.
        let (times, field) = match mag.cast::<PyTuple>().map(|pair| (pair.len(), pair)) {
            Ok((2, pair)) => {
                let item = |i: usize| {
                    pair.get_item(i)
                        .map_err(|e| Failure::new("not_numbers", format!("mag: {e}"), ""))
                };
                let times = Argument::new("mag[0]", &item(0)?).times()?;
                (times, Argument::new("mag[1]", &item(1)?))
            }
            _ => (columns[0].times()?, Argument::new("mag", mag)),
        };
        let fields = field.vectors(times.len())?;
        others.extend(
            times
                .into_iter()
                .zip(fields)
                .filter(|(_, field_b)| field_b.iter().all(|v| v.is_finite()))
                .map(|(time, field_b)| Sample::Magnetic(MagneticField { time, field_b })),
        );
    }
    let arrays = Arrays {
        inertial,
        others,
        inertial_first: false,
        origin: Time(0),
        dated: false,
        lever_arm_b: None,
    };
    Ok(arrays.mounted(config))
}

pub(crate) fn type_name(object: &Bound<'_, PyAny>) -> String {
    object
        .get_type()
        .name()
        .map_or_else(|_| "that".to_owned(), |name| name.to_string())
}
