//! `insnav.ahrs`: orientation from arrays, as the command finds it from a log.

use crate::arrays::{matrices, rows, scalars};
use crate::failure::{Failure, fail, warn};
use crate::inputs::inertial_and_magnetic;
use crate::interrupt::{Stop, interruptible};
use crate::pickle;
use crate::run::dictionary;
use crate::settings;
use insnav_core::attitude::Euler;
use insnav_core::time::Time;
use insnav_log::{
    GyroRange, OrientationEpoch, OrientationNoise, OrientationPlan, OrientationRequest, Stoppable,
};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString, PyTuple, PyType};

/// Orientation with its covariance: gyro, accelerometer and, where there is one, magnetometer.
///
/// Does what the command ``insnav ahrs`` does. Other threads run meanwhile.
///
/// Parameters
/// ----------
/// t : (n,)
///     Seconds, or ``datetime64``.
/// gyro : (n, 3)
///     Angular rate, body axes (forward-right-down), rad/s.
/// accel : (n, 3)
///     Specific force, body axes, m/s²; (0, 0, -g) at rest and level.
/// mag : (n, 3) or (t, field), optional
///     Magnetic field, body axes, T, rows of NaN where there is none; or a tuple of stamps and fields.
/// smooth : bool, default False
///     Use the whole record for every instant, in place of what was before it.
/// noise : {"auto", "datasheet"}
///     Noise of the sensors: what the record shows by itself, or what ``config`` says and else the class of the unit.
/// config : mapping or path, optional
///     Settings as of :func:`insnav.run`: ``imu.grade``, ``noise``, ``imu.mounting_rpy_deg``, ``alignment.declination_deg``.
/// gyro_range_deg_per_s : float, None or "auto", default "auto"
///     Where the gyros' range ends; ``None``: nowhere; ``"auto"``: where the record shows it.
/// carrier_speed_m_per_s : float, optional
///     How fast the carrier goes about, one sigma; 1 for hands (the default), 8 for cars, whose long accelerations look like
///     tilts otherwise.
///
/// Returns
/// -------
/// Orientation
///     One row for each inertial sample from the first attitude on: at rest 0.3 s into the record with ``mag`` and 1 s
///     without, in motion later, up to 2 s.
///
/// Raises
/// ------
/// InsnavError
///     Arrays or settings that cannot be used; says what, where and the remedy.
///
/// Warns
/// -----
/// InsnavWarning
///     Data that look wrong, noise that the record does not tell; all warnings are in ``summary["warnings"]`` too.
#[pyfunction]
#[pyo3(
    signature = (t, gyro, accel, mag=None, *, smooth=false, noise="auto", config=None, gyro_range_deg_per_s=Range::AUTO, carrier_speed_m_per_s=None),
    text_signature = "(t, gyro, accel, mag=None, *, smooth=False, noise='auto', config=None, gyro_range_deg_per_s='auto', carrier_speed_m_per_s=None)"
)]
// One argument each of the Python function.
#[allow(clippy::too_many_arguments)]
pub(crate) fn ahrs<'py>(
    t: &Bound<'py, PyAny>,
    gyro: &Bound<'py, PyAny>,
    accel: &Bound<'py, PyAny>,
    mag: Option<&Bound<'py, PyAny>>,
    smooth: bool,
    noise: &str,
    config: Option<&Bound<'py, PyAny>>,
    gyro_range_deg_per_s: Option<Range>,
    carrier_speed_m_per_s: Option<f64>,
) -> PyResult<Orientation> {
    let py = t.py();
    let fail = fail(py);
    let mut config = settings::config(config)?;
    // Neither wanted nor needed.
    config.gnss.used = false;
    let request = OrientationRequest {
        noise: match noise {
            "auto" => OrientationNoise::Identified,
            "datasheet" => OrientationNoise::Stated,
            other => {
                return Err(fail(Failure::unknown_word(
                    "noise",
                    other,
                    "auto, datasheet",
                )));
            }
        },
        gyro_range: gyro_range_deg_per_s.map_or(GyroRange::Unlimited, |r| r.0),
        smooth,
        carrier_speed: carrier_speed_m_per_s,
    };
    let source = inertial_and_magnetic(t, gyro, accel, mag, &config).map_err(fail)?;
    let work = move |stop: &Stop| {
        let source = Stoppable::new(&source, stop.asked());
        let plan = OrientationPlan::make(&source, &config, request)?;
        let mut epochs = Vec::new();
        let report = plan.execute(&source, |epoch| {
            epochs.push(*epoch);
            Ok(())
        })?;
        Ok((epochs, report))
    };
    let (epochs, report) = interruptible(py, work)?.map_err(fail)?;
    for warning in &report.warnings {
        warn(py, warning)?;
    }
    Ok(Orientation {
        epochs,
        summary: dictionary(py, serde_json::to_string(&report))?.unbind(),
    })
}

/// Where the gyros' range ends: a number of degrees per second, or `"auto"`.
#[derive(Clone, Copy)]
pub(crate) struct Range(GyroRange);

impl Range {
    const AUTO: Option<Range> = Some(Range(GyroRange::AsSeen));
}

impl<'py> FromPyObject<'_, 'py> for Range {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let wrong = || {
            PyTypeError::new_err(
                "gyro_range_deg_per_s: expected a positive number of degrees per second, None or \"auto\"",
            )
        };
        if let Ok(text) = object.cast::<PyString>() {
            return (text.to_str()? == "auto")
                .then_some(Range(GyroRange::AsSeen))
                .ok_or_else(wrong);
        }
        match object.extract::<f64>() {
            Ok(range) if range > 0.0 && range.is_finite() => {
                Ok(Range(GyroRange::Of(range.to_radians())))
            }
            _ => Err(wrong()),
        }
    }
}

/// Orientation with its uncertainty: one row an inertial sample, every column a numpy array.
///
/// ``b`` is forward-right-down. ``n`` is north-east-down: of magnetic north, of true north where ``alignment.declination_deg`` is
/// given, and without a magnetometer of where the body looked when it began (``summary["heading_reference"]``). Every access makes a new
/// array.
#[pyclass(frozen, module = "insnav")]
pub(crate) struct Orientation {
    epochs: Vec<OrientationEpoch>,
    summary: Py<PyDict>,
}

/// An epoch as it is pickled: stamp, attitude, covariance, rate, force.
type Row = (
    Time,
    UnitQuaternion<f64>,
    Matrix3<f64>,
    Vector3<f64>,
    Vector3<f64>,
);

type Column<'py> = PyResult<Bound<'py, PyAny>>;

impl Orientation {
    fn angle<'py>(&self, py: Python<'py>, get: fn(&Euler) -> f64) -> Column<'py> {
        let angles = self.epochs.iter();
        scalars(py, angles.map(|e| get(&Euler::from_quaternion(&e.q_nb))))
    }
}

#[pymethods]
impl Orientation {
    fn __len__(&self) -> usize {
        self.epochs.len()
    }

    fn __repr__(&self) -> String {
        match (self.epochs.first(), self.epochs.last()) {
            (Some(first), Some(last)) => format!(
                "<insnav.Orientation: {} epochs, {:.3} s to {:.3} s>",
                self.epochs.len(),
                first.time.seconds(),
                last.time.seconds()
            ),
            _ => "<insnav.Orientation: no epochs>".to_owned(),
        }
    }

    #[classmethod]
    fn _from_state(
        _class: &Bound<'_, PyType>,
        state: &[u8],
        summary: &Bound<'_, PyDict>,
    ) -> PyResult<Self> {
        let rows: Vec<Row> = pickle::load::<Self, _>(state)?;
        let epochs = rows.into_iter().map(|row| OrientationEpoch {
            time: row.0,
            q_nb: row.1,
            covariance_n: row.2,
            angular_rate_b: row.3,
            specific_force_b: row.4,
        });
        Ok(Orientation {
            epochs: epochs.collect(),
            summary: summary.clone().unbind(),
        })
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let py = slf.py();
        let this = slf.get();
        let rows: Vec<Row> = this
            .epochs
            .iter()
            .map(|e| {
                (
                    e.time,
                    e.q_nb,
                    e.covariance_n,
                    e.angular_rate_b,
                    e.specific_force_b,
                )
            })
            .collect();
        let make = slf.as_any().get_type().getattr("_from_state")?;
        let summary = this.summary.bind(py).clone();
        let arguments = [
            pickle::bytes::<Self>(py, &rows)?.into_any(),
            summary.into_any(),
        ];
        PyTuple::new(py, [make, PyTuple::new(py, arguments)?.into_any()])
    }

    /// What there is to tell, with the keys of ``insnav ahrs --format json``: the noise that was used, time at rest, gyro bias,
    /// the magnetometer's delay, the last orientation, warnings.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> Bound<'py, PyDict> {
        self.summary.bind(py).clone()
    }

    /// Time on the scale of ``t``, s, shape (n,).
    #[getter]
    fn time_s<'py>(&self, py: Python<'py>) -> Column<'py> {
        scalars(py, self.epochs.iter().map(|e| e.time.since(Time(0))))
    }

    /// Time on the scale of ``t``, ns, exact, int64, shape (n,).
    #[getter]
    fn time_ns<'py>(&self, py: Python<'py>) -> Column<'py> {
        scalars(py, self.epochs.iter().map(|e| e.time.0))
    }

    /// Unit quaternion that takes vectors from b to n (w, x, y, z), shape (n, 4).
    #[getter]
    fn quaternion_nb_wxyz<'py>(&self, py: Python<'py>) -> Column<'py> {
        rows(
            py,
            self.epochs
                .iter()
                .map(|e| [e.q_nb.w, e.q_nb.i, e.q_nb.j, e.q_nb.k]),
        )
    }

    /// Roll, right side down positive, degrees, shape (n,).
    #[getter]
    fn roll_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.angle(py, |angles| angles.roll.to_degrees())
    }

    /// Pitch, nose up positive, degrees, shape (n,).
    #[getter]
    fn pitch_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.angle(py, |angles| angles.pitch.to_degrees())
    }

    /// Heading, clockwise from north, 0 to 360 degrees, shape (n,).
    #[getter]
    fn heading_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.angle(py, Euler::heading_deg)
    }

    /// Covariance of the attitude error as a small rotation, true = Exp(error) ∘ estimate, axes n, rad², shape (n, 3, 3).
    #[getter]
    fn attitude_covariance_n_rad2<'py>(&self, py: Python<'py>) -> Column<'py> {
        let by_rows = |c: &Matrix3<f64>| [0, 1, 2].map(|i| [0, 1, 2].map(|j| c[(i, j)]));
        matrices(py, self.epochs.iter().map(|e| by_rows(&e.covariance_n)))
    }

    /// Standard deviation of the attitude as a small rotation about north, east and down, degrees, shape (n, 3).
    ///
    /// The last column is the standard deviation of the heading.
    #[getter]
    fn sigma_attitude_n_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        let sigma = |v: f64| v.max(0.0).sqrt().to_degrees();
        rows(
            py,
            self.epochs
                .iter()
                .map(|e| [0, 1, 2].map(|i| sigma(e.covariance_n[(i, i)]))),
        )
    }
}
