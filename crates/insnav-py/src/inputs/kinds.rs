//! The kinds of data: their keys, their columns, and what becomes of these.

use super::source::Inertial;
use super::stated::{Stated, stated};
use super::type_name;
use crate::arrays::Argument;
use crate::failure::Failure;
use insnav_core::earth::Geodetic;
use insnav_core::sample::{
    GnssPosition, GnssVelocity, Heading, MagneticField, Sample, Speed, Standstill,
};
use insnav_core::time::Time;
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// One kind of data: its key and the names of its columns, the last of which may be absent in some kinds.
pub(super) struct Stream {
    pub(super) key: &'static str,
    columns: &'static [&'static str],
    required: usize,
    pub(super) read: Read,
}

/// What becomes of the columns.
pub(super) enum Read {
    Inertial(fn(&[Argument<'_>]) -> Result<Inertial, Failure>),
    Aiding(fn(&[Argument<'_>]) -> Result<Vec<Sample>, Failure>),
}

pub(super) const STREAMS: [Stream; 8] = [
    Stream {
        key: "imu",
        columns: &[
            "time_s",
            "angular_rate_b_rad_per_s",
            "specific_force_b_m_per_s2",
        ],
        required: 3,
        read: Read::Inertial(imu),
    },
    Stream {
        key: "imu_increment",
        columns: &["time_s", "angle_b_rad", "velocity_b_m_per_s"],
        required: 3,
        read: Read::Inertial(imu_increment),
    },
    Stream {
        key: "gnss_position",
        columns: &["time_s", "latitude_deg_longitude_deg_height_m", "sigma_n_m"],
        required: 2,
        read: Read::Aiding(gnss_position),
    },
    Stream {
        key: "gnss_velocity",
        columns: &["time_s", "velocity_n_m_per_s", "sigma_n_m_per_s"],
        required: 2,
        read: Read::Aiding(gnss_velocity),
    },
    Stream {
        key: "heading",
        columns: &["time_s", "heading_deg", "sigma_deg"],
        required: 3,
        read: Read::Aiding(heading),
    },
    Stream {
        key: "standstill",
        columns: &["time_s", "standing"],
        required: 2,
        read: Read::Aiding(standstill),
    },
    Stream {
        key: "speed",
        columns: &["time_s", "speed_m_per_s"],
        required: 2,
        read: Read::Aiding(speed),
    },
    Stream {
        key: "magnetic_field",
        columns: &["time_s", "field_b_tesla"],
        required: 2,
        read: Read::Aiding(magnetic_field),
    },
];

impl Stream {
    /// The columns of one kind, without an optional one that is absent or `None`.
    pub(super) fn arguments<'py>(&self, given: &Bound<'py, PyAny>) -> PyResult<Vec<Argument<'py>>> {
        let py = given.py();
        let expected = || {
            let (required, optional) = self.columns.split_at(self.required);
            let mut text = required.join(", ");
            if let [optional] = optional {
                text += &format!("[, {optional}]");
            }
            format!("{}: expected a tuple ({text})", self.key)
        };
        // A mapping or a string iterates too, over the wrong things; an array of shape (3, n) is most likely meant otherwise.
        let columns: Bound<'py, PyTuple> = match given.cast::<PyTuple>() {
            Ok(tuple) => tuple.clone(),
            Err(_) => given
                .cast::<pyo3::types::PyList>()
                .map_err(|_| {
                    pyo3::exceptions::PyTypeError::new_err(format!(
                        "{}, not {}",
                        expected(),
                        type_name(given)
                    ))
                })?
                .to_tuple(),
        };
        let mut columns: Vec<Bound<'py, PyAny>> = columns.iter().collect();
        if columns.len() == self.columns.len()
            && self.required < self.columns.len()
            && columns.last().is_some_and(|c| c.is_none())
        {
            columns.pop();
        }
        if !(self.required..=self.columns.len()).contains(&columns.len()) {
            return Err(Failure::new(
                "wrong_shape",
                format!("{}, not {} columns", expected(), columns.len()),
                "the names say units and frame: n is north-east-down, b is forward-right-down",
            )
            .about(
                self.key,
                format!("{} columns", columns.len()),
                expected().split_once("expected ").map_or("", |(_, e)| e),
            )
            .into_py_err(py));
        }
        Ok(self
            .columns
            .iter()
            .zip(columns)
            .map(|(name, object)| Argument {
                name: format!("{}: {name}", self.key),
                object,
            })
            .collect())
    }
}

pub(super) fn imu(columns: &[Argument<'_>]) -> Result<Inertial, Failure> {
    let times = columns[0].times()?;
    Ok(Inertial {
        turns: columns[1].vectors(times.len())?,
        forces: columns[2].vectors(times.len())?,
        times,
        increments: false,
    })
}

fn imu_increment(columns: &[Argument<'_>]) -> Result<Inertial, Failure> {
    Ok(Inertial {
        increments: true,
        ..imu(columns)?
    })
}

fn gnss_position(columns: &[Argument<'_>]) -> Result<Vec<Sample>, Failure> {
    let times = columns[0].times()?;
    let positions = columns[1].vectors(times.len())?;
    let stated = stated(columns.get(2), &times)?;
    let rows = times.into_iter().zip(positions).zip(stated);
    Ok(rows
        .map(|((time, p), stated)| position_sample(time, &p, stated))
        .collect())
}

/// A fix of latitude and longitude in degrees and height.
pub(crate) fn position_sample(time: Time, p: &Vector3<f64>, stated: Stated) -> Sample {
    Sample::GnssPosition(GnssPosition {
        time,
        position: Geodetic::from_degrees(p.x, p.y, p.z),
        covariance_n: stated.covariance(),
    })
}

fn gnss_velocity(columns: &[Argument<'_>]) -> Result<Vec<Sample>, Failure> {
    let times = columns[0].times()?;
    let velocities = columns[1].vectors(times.len())?;
    let stated = stated(columns.get(2), &times)?;
    let rows = times.into_iter().zip(velocities).zip(stated);
    Ok(rows
        .map(|((time, velocity_n), stated)| velocity_sample(time, velocity_n, stated))
        .collect())
}

/// A velocity, with a NaN Down component where there is none.
pub(crate) fn velocity_sample(time: Time, velocity_n: Vector3<f64>, stated: Stated) -> Sample {
    // Without a Down component its sigma says nothing; any finite one lets the horizontal pair through.
    let stated = match stated {
        Stated::Sigma(s) if velocity_n.z.is_nan() => Stated::Sigma(Vector3::new(s.x, s.y, s.x)),
        other => other,
    };
    Sample::GnssVelocity(GnssVelocity {
        time,
        velocity_n,
        covariance_n: stated.covariance(),
    })
}

fn magnetic_field(columns: &[Argument<'_>]) -> Result<Vec<Sample>, Failure> {
    let times = columns[0].times()?;
    let fields = columns[1].vectors(times.len())?;
    let rows = times.into_iter().zip(fields);
    Ok(rows
        .map(|(time, field_b)| Sample::Magnetic(MagneticField { time, field_b }))
        .collect())
}

fn heading(columns: &[Argument<'_>]) -> Result<Vec<Sample>, Failure> {
    let times = columns[0].times()?;
    let headings = columns[1].column(Some(times.len()))?;
    let sigmas = columns[2].column(Some(times.len()))?;
    let rows = times.into_iter().zip(headings).zip(sigmas).enumerate();
    rows.map(|(row, ((time, heading), sigma))| {
        heading_sample(time, heading, sigma, &columns[2].name, Some((row, time)))
    })
    .collect()
}

/// A heading and its sigma, degrees. `name`, `row`: those of the sigma, for messages.
pub(crate) fn heading_sample(
    time: Time,
    heading_deg: f64,
    sigma_deg: f64,
    name: &str,
    row: Option<(usize, Time)>,
) -> Result<Sample, Failure> {
    Stated::Sigma(Vector3::repeat(sigma_deg)).possible(name, row)?;
    Ok(Sample::Heading(Heading {
        time,
        heading: heading_deg.to_radians(),
        sigma: sigma_deg.to_radians(),
    }))
}

fn standstill(columns: &[Argument<'_>]) -> Result<Vec<Sample>, Failure> {
    let times = columns[0].times()?;
    let standing = columns[1].column(Some(times.len()))?;
    let rows = times.into_iter().zip(standing).enumerate();
    rows.map(|(row, (time, standing))| {
        if standing.is_nan() {
            return Err(Failure::new(
                "not_finite",
                format!("{}[{row}]: neither true nor false", columns[1].name),
                "drop the rows in which nobody says anything",
            )
            .about(&columns[1].name, "nan", "true or false")
            .at(time));
        }
        Ok(Sample::Standstill(Standstill {
            time,
            standing: standing != 0.0,
        }))
    })
    .collect()
}

fn speed(columns: &[Argument<'_>]) -> Result<Vec<Sample>, Failure> {
    let times = columns[0].times()?;
    let speeds = columns[1].column(Some(times.len()))?;
    let rows = times.into_iter().zip(speeds);
    Ok(rows
        .map(|(time, speed)| Sample::Speed(Speed { time, speed }))
        .collect())
}
