//! Arrays as the user has them → samples as the navigator takes them.

use crate::arrays::Argument;
use crate::failure::Failure;
use insnav_core::config::Config;
use insnav_core::earth::Geodetic;
use insnav_core::sample::{
    GnssPosition, GnssVelocity, Heading, ImuIncrement, ImuSample, MagneticField, Sample, Speed,
    Standstill,
};
use insnav_core::time::Time;
use insnav_log::{ImuAxes, RunError, Source, imu_to_body};
use nalgebra::{Matrix3, Vector3};
use pyo3::prelude::*;
use pyo3::types::{PyMapping, PyTuple};

/// One kind of data: its key and the names of its columns, the last of which may be absent in some kinds.
struct Stream {
    key: &'static str,
    columns: &'static [&'static str],
    required: usize,
    read: fn(&[Argument<'_>]) -> Result<Vec<Sample>, Failure>,
}

const STREAMS: [Stream; 7] = [
    Stream {
        key: "imu",
        columns: &[
            "time_s",
            "angular_rate_b_rad_per_s",
            "specific_force_b_m_per_s2",
        ],
        required: 3,
        read: imu,
    },
    Stream {
        key: "imu_increment",
        columns: &["time_s", "angle_b_rad", "velocity_b_m_per_s"],
        required: 3,
        read: imu_increment,
    },
    Stream {
        key: "gnss_position",
        columns: &["time_s", "latitude_deg_longitude_deg_height_m", "sigma_n_m"],
        required: 2,
        read: gnss_position,
    },
    Stream {
        key: "gnss_velocity",
        columns: &["time_s", "velocity_n_m_per_s", "sigma_n_m_per_s"],
        required: 2,
        read: gnss_velocity,
    },
    Stream {
        key: "heading",
        columns: &["time_s", "heading_deg", "sigma_deg"],
        required: 3,
        read: heading,
    },
    Stream {
        key: "standstill",
        columns: &["time_s", "standing"],
        required: 2,
        read: standstill,
    },
    Stream {
        key: "speed",
        columns: &["time_s", "speed_m_per_s"],
        required: 2,
        read: speed,
    },
];

/// Samples from arrays, to be read as often as a run wants.
pub(crate) struct Arrays(Vec<Sample>);

impl Source for Arrays {
    fn samples(&self) -> Result<Box<dyn Iterator<Item = Result<Sample, RunError>> + '_>, RunError> {
        self.0.samples()
    }

    /// Seconds out are seconds in.
    fn origin(&self) -> Result<Option<Time>, RunError> {
        Ok(Some(Time(0)))
    }
}

/// All samples in the order of time; at one instant inertial ones first. Inertial ones are turned by the mounting that the
/// settings name.
pub(crate) fn arrays(arrays: &Bound<'_, PyMapping>, config: &Config) -> PyResult<Arrays> {
    let py = arrays.py();
    let keys = arrays.keys()?;
    for key in keys.iter() {
        let key = key.str()?.to_string();
        if !STREAMS.iter().any(|s| s.key == key) {
            let known: Vec<&str> = STREAMS.iter().map(|s| s.key).collect();
            return Err(Failure::new(
                "unknown_stream",
                format!("unknown key `{key}` among the arrays"),
                format!("known: {}", known.join(", ")),
            )
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
        .into_py_err(py));
    }
    let mut samples = Vec::new();
    for stream in &STREAMS {
        if given(stream.key)? {
            let arguments = stream.arguments(&arrays.get_item(stream.key)?)?;
            let read = (stream.read)(&arguments).map_err(|e| e.into_py_err(py))?;
            samples.extend(read);
        }
    }
    // Stable: rows of one kind keep their order.
    samples.sort_by_key(|s| (s.time(), !s.is_inertial()));
    Ok(mounted(samples, config))
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
    let mut samples = imu(&columns)?;
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
        samples.extend(
            times
                .into_iter()
                .zip(fields)
                .filter(|(_, field_b)| field_b.iter().all(|v| v.is_finite()))
                .map(|(time, field_b)| Sample::Magnetic(MagneticField { time, field_b })),
        );
    }
    samples.sort_by_key(|s| (s.time(), s.is_inertial()));
    Ok(mounted(samples, config))
}

/// Turned by the mounting that the settings name.
fn mounted(mut samples: Vec<Sample>, config: &Config) -> Arrays {
    let to_body = imu_to_body(ImuAxes::Frd, Some(config.imu.mounting_rpy_deg));
    if to_body != Matrix3::identity() {
        samples.iter_mut().for_each(|s| turn(s, &to_body));
    }
    Arrays(samples)
}

impl Stream {
    /// The columns of one kind, without an optional one that is absent or `None`.
    fn arguments<'py>(&self, given: &Bound<'py, PyAny>) -> PyResult<Vec<Argument<'py>>> {
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

fn turn(sample: &mut Sample, to_body: &Matrix3<f64>) {
    match sample {
        Sample::Imu(s) => {
            s.angular_rate_b = to_body * s.angular_rate_b;
            s.specific_force_b = to_body * s.specific_force_b;
        }
        Sample::ImuIncrement(s) => {
            s.angle_b = to_body * s.angle_b;
            s.velocity_b = to_body * s.velocity_b;
        }
        Sample::Magnetic(s) => s.field_b = to_body * s.field_b,
        _ => {}
    }
}

fn type_name(object: &Bound<'_, PyAny>) -> String {
    object
        .get_type()
        .name()
        .map_or_else(|_| "that".to_owned(), |name| name.to_string())
}

fn imu(columns: &[Argument<'_>]) -> Result<Vec<Sample>, Failure> {
    let times = columns[0].times()?;
    let rates = columns[1].vectors(times.len())?;
    let forces = columns[2].vectors(times.len())?;
    let rows = times.into_iter().zip(rates).zip(forces);
    Ok(rows
        .map(|((time, angular_rate_b), specific_force_b)| {
            Sample::Imu(ImuSample {
                time,
                angular_rate_b,
                specific_force_b,
            })
        })
        .collect())
}

fn imu_increment(columns: &[Argument<'_>]) -> Result<Vec<Sample>, Failure> {
    let times = columns[0].times()?;
    let angles = columns[1].vectors(times.len())?;
    let velocities = columns[2].vectors(times.len())?;
    let rows = times.into_iter().zip(angles).zip(velocities);
    Ok(rows
        .map(|((time, angle_b), velocity_b)| {
            Sample::ImuIncrement(ImuIncrement {
                time,
                angle_b,
                velocity_b,
            })
        })
        .collect())
}

fn gnss_position(columns: &[Argument<'_>]) -> Result<Vec<Sample>, Failure> {
    let times = columns[0].times()?;
    let positions = columns[1].vectors(times.len())?;
    let sigmas = sigmas(columns.get(2), times.len())?;
    let rows = times.into_iter().zip(positions).zip(sigmas);
    Ok(rows
        .map(|((time, p), sigma)| {
            Sample::GnssPosition(GnssPosition {
                time,
                position: Geodetic::from_degrees(p.x, p.y, p.z),
                covariance_n: sigma.and_then(|s| covariance(&s)),
            })
        })
        .collect())
}

fn gnss_velocity(columns: &[Argument<'_>]) -> Result<Vec<Sample>, Failure> {
    let times = columns[0].times()?;
    let velocities = columns[1].vectors(times.len())?;
    let sigmas = sigmas(columns.get(2), times.len())?;
    let rows = times.into_iter().zip(velocities).zip(sigmas);
    Ok(rows
        .map(|((time, velocity_n), sigma)| {
            // Without a Down component its sigma says nothing; any finite one lets the horizontal pair through.
            let sigma = sigma.map(|s| {
                if velocity_n.z.is_nan() {
                    Vector3::new(s.x, s.y, s.x)
                } else {
                    s
                }
            });
            Sample::GnssVelocity(GnssVelocity {
                time,
                velocity_n,
                covariance_n: sigma.and_then(|s| covariance(&s)),
            })
        })
        .collect())
}

fn heading(columns: &[Argument<'_>]) -> Result<Vec<Sample>, Failure> {
    let times = columns[0].times()?;
    let headings = columns[1].column(Some(times.len()))?;
    let sigmas = columns[2].column(Some(times.len()))?;
    let rows = times.into_iter().zip(headings).zip(sigmas);
    Ok(rows
        .map(|((time, heading), sigma)| {
            Sample::Heading(Heading {
                time,
                heading: heading.to_radians(),
                sigma: sigma.to_radians(),
            })
        })
        .collect())
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
            ));
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

/// Stated sigmas, or `None` for every row.
fn sigmas(
    column: Option<&Argument<'_>>,
    rows: usize,
) -> Result<Vec<Option<Vector3<f64>>>, Failure> {
    match column {
        None => Ok(vec![None; rows]),
        Some(column) => Ok(column.vectors_or_one(rows)?.into_iter().map(Some).collect()),
    }
}

/// Diagonal covariance; `None` when a sigma is not known (NaN).
fn covariance(sigma: &Vector3<f64>) -> Option<Matrix3<f64>> {
    sigma
        .iter()
        .all(|s| s.is_finite())
        .then(|| Matrix3::from_diagonal(&sigma.component_mul(sigma)))
}
