//! `insnav.AttitudeFilter`: the orientation filter, sample by sample and over arrays, with access to what it knows.

use crate::arrays::{Argument, bools, matrices, matrix, rows, scalars};
use crate::failure::{Failure, fail};
use crate::inputs::{self, inertial_and_magnetic};
use crate::interrupt::{Stop, interruptible};
use crate::pickle;
use crate::run::dictionary;
use crate::settings;
use insnav_core::ahrs::{AHRS_BLOCKS, Ahrs, AhrsEpoch, AhrsSettings, Smoother};
use insnav_core::attitude::Euler;
use insnav_core::config::Config;
use insnav_core::error::Error;
use insnav_core::imu::ImuGrade;
use insnav_core::sample::{ImuSample, MagneticField, Sample};
use insnav_core::time::Time;
use insnav_log::{ImuAxes, ahrs_settings, imu_to_body};
use nalgebra::{DMatrix, Matrix3};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PySlice, PyTuple, PyType};
use serde::{Deserialize, Serialize};

#[derive(Clone, Serialize, Deserialize)]
struct State {
    filter: Ahrs,
    /// Mounting of the settings, degrees.
    mounting_rpy_deg: [f64; 3],
}

impl State {
    /// Settings that know where the unit's axes are, and nothing else.
    fn mounting(&self) -> Config {
        let mut config = Config::default();
        config.imu.mounting_rpy_deg = self.mounting_rpy_deg;
        config
    }
}

/// Attitude from gyro, accelerometer and, where there is one, magnetometer: the filter of :func:`insnav.ahrs`, sample by sample.
///
/// ``n`` is magnetic north, east, down; without a field north is where the body looked when it began. At rest the first attitude comes
/// after 0.3 s with a field and after 1 s without one, for which it waits so long; in motion it levels for longer, up to 2 s; corrections every twentieth of a second, attitude at every sample. A gap of more than half a second levels anew,
/// biases and calibration stay.
///
/// Parameters
/// ----------
/// config : mapping or path, optional
///     Settings as of :func:`insnav.run`: ``imu.grade`` and ``noise`` say what the unit is worth (else a consumer's), ``imu.mounting_rpy_deg``
///     how it is mounted. With the same ones and ``noise="datasheet"`` :func:`insnav.ahrs` gives the same bits.
/// settings : mapping, optional
///     What the filter takes unit, carrier and field for, in SI units: any of the keys of :attr:`settings`, such as
///     ``{"update_interval": 0.02, "field": {"delay_sigma": 0.0}}``.
/// gyro_range_deg_per_s : float, optional
///     Where the gyros' range ends; nowhere.
/// carrier_speed_m_per_s : float, optional
///     How fast the carrier goes about, one sigma, as of :func:`insnav.ahrs`.
///
/// Raises
/// ------
/// ConfigError
///     Settings that are unknown or outside their range; ``alignment.declination_deg``, which is for :func:`insnav.ahrs`.
///
/// Examples
/// --------
/// >>> import insnav
/// >>> filter = insnav.AttitudeFilter({"imu": {"grade": "consumer"}})
/// >>> for k in range(100):
/// ...     epoch = filter.step(0.01 * k, gyro=[0.0, 0.0, 0.0], accel=[0.0, 0.0, -9.80665], mag=[20e-6, 0.0, 44e-6])
/// >>> abs(round(epoch.pitch_deg, 6)), min(epoch.heading_deg, 360 - epoch.heading_deg) < 1e-6, epoch.magnetic
/// (0.0, True, True)
/// >>> sorted(filter.blocks)
/// ['accel_bias', 'attitude', 'delay', 'disturbance', 'field', 'gyro_bias', 'offset', 'velocity']
#[pyclass(module = "insnav")]
pub(crate) struct AttitudeFilter(State);

#[pymethods]
impl AttitudeFilter {
    #[new]
    #[pyo3(signature = (config=None, *, settings=None, gyro_range_deg_per_s=None, carrier_speed_m_per_s=None))]
    fn new(
        py: Python<'_>,
        config: Option<&Bound<'_, PyAny>>,
        settings: Option<&Bound<'_, PyAny>>,
        gyro_range_deg_per_s: Option<f64>,
        carrier_speed_m_per_s: Option<f64>,
    ) -> PyResult<Self> {
        let fail = fail(py);
        let config = settings::config(config)?;
        if config.alignment.declination_deg.is_some() {
            return Err(fail(Failure::from(Error::Config {
                key: "alignment.declination_deg",
                value: config.alignment.declination_deg.unwrap_or_default(),
                expected: "left out: the filter counts headings from magnetic north; add it to them, or use insnav.ahrs",
            })));
        }
        let grade = config.imu.grade.unwrap_or(ImuGrade::Consumer);
        let noise = config.noise.over(grade);
        let mut found = ahrs_settings(&config, noise, carrier_speed_m_per_s);
        found.gyro_range = gyro_range_deg_per_s.map(f64::to_radians);
        if let Some(given) = settings {
            let given = settings::mapping(given, "settings")?;
            found = overlaid(&found, given).map_err(fail)?;
        }
        Ok(AttitudeFilter(State {
            filter: Ahrs::new(found).map_err(|e| fail(e.into()))?,
            mounting_rpy_deg: config.imu.mounting_rpy_deg,
        }))
    }

    /// Take a sample: rate and force over the interval that ends at its stamp, and the field at it.
    ///
    /// Parameters
    /// ----------
    /// t : float or numpy.datetime64
    ///     Stamp, s, after that of the sample before.
    /// gyro : (3,)
    ///     Angular rate, body axes (forward-right-down), rad/s.
    /// accel : (3,)
    ///     Specific force, body axes, m/s²; (0, 0, -g) at rest and level.
    /// mag : (3,), optional
    ///     Magnetic field, body axes, in any unit that stays the same. A field with a stamp of its own goes to :meth:`field` before.
    ///
    /// Returns
    /// -------
    /// AttitudeEpoch or None
    ///     None until the first attitude is known.
    ///
    /// Raises
    /// ------
    /// NavigationError
    ///     A stamp that is not after the one before. The filter is as before.
    /// ArgumentError
    ///     Shapes and numbers that cannot be used.
    #[pyo3(signature = (t, gyro, accel, mag=None))]
    fn step<'py>(
        &mut self,
        t: &Bound<'py, PyAny>,
        gyro: &Bound<'py, PyAny>,
        accel: &Bound<'py, PyAny>,
        mag: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        let py = gyro.py();
        let fail = fail(py);
        let time = time(t).map_err(fail)?;
        let mut samples = Vec::with_capacity(2);
        if let Some(mag) = mag {
            samples.push(Sample::Magnetic(MagneticField {
                time,
                field_b: Argument::new("mag", mag).vector().map_err(fail)?,
            }));
        }
        samples.push(Sample::Imu(ImuSample {
            time,
            angular_rate_b: Argument::new("gyro", gyro).vector().map_err(fail)?,
            specific_force_b: Argument::new("accel", accel).vector().map_err(fail)?,
        }));
        self.turn(&mut samples);
        // A sample that is refused must not leave its field behind.
        let mut next = self.0.filter.clone();
        let mut epoch = None;
        for sample in &samples {
            epoch = take(&mut next, sample).map_err(|e| fail(e.into()))?;
        }
        self.0.filter = next;
        epoch.map(|e| one(py, &e)).transpose()
    }

    /// Take a magnetic field with a stamp of its own, body axes, shape (3,): before the first inertial sample that is later.
    fn field(&mut self, t: &Bound<'_, PyAny>, mag: &Bound<'_, PyAny>) -> PyResult<()> {
        let py = mag.py();
        let fail = fail(py);
        let field = MagneticField {
            time: time(t).map_err(fail)?,
            field_b: Argument::new("mag", mag).vector().map_err(fail)?,
        };
        let mut samples = [Sample::Magnetic(field)];
        self.turn(&mut samples);
        take(&mut self.0.filter, &samples[0]).map_err(|e| fail(e.into()))?;
        Ok(())
    }

    /// Take arrays: the same as so many steps, bit for bit. Other threads run meanwhile.
    ///
    /// Parameters
    /// ----------
    /// t : (n,)
    ///     Seconds, or ``datetime64``.
    /// gyro, accel : (n, 3)
    ///     As of :meth:`step`.
    /// mag : (n, 3) or (t, field), optional
    ///     Rows of NaN where there is none; or a tuple of stamps and fields.
    ///
    /// Returns
    /// -------
    /// Attitudes
    ///     One row for each sample that has an attitude.
    ///
    /// Raises
    /// ------
    /// NavigationError, ArgumentError
    ///     As of :meth:`step`; name the row. The filter is as before.
    #[pyo3(signature = (t, gyro, accel, mag=None))]
    fn run<'py>(
        &mut self,
        t: &Bound<'py, PyAny>,
        gyro: &Bound<'py, PyAny>,
        accel: &Bound<'py, PyAny>,
        mag: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = t.py();
        let fail = fail(py);
        let source =
            inertial_and_magnetic(t, gyro, accel, mag, &self.0.mounting()).map_err(fail)?;
        let mut next = self.0.filter.clone();
        // Of a copy, so that an interruption leaves the filter as it was.
        let work = move |stop: &Stop| -> Result<_, Error> {
            let mut epochs = Vec::new();
            for sample in source.iter().take_while(|_| stop.proceed()) {
                epochs.extend(take(&mut next, &sample)?);
            }
            Ok((next, epochs))
        };
        let (next, epochs) = interruptible(py, work)?.map_err(|e| fail(e.into()))?;
        self.0.filter = next;
        many(py, &epochs)
    }

    /// Attitudes of a whole record, each from all of it (Rauch, Tung and Striebel), by a filter of the same settings that begins anew.
    ///
    /// Parameters, returns and errors as of :meth:`run`; this filter stays as it is.
    #[pyo3(signature = (t, gyro, accel, mag=None))]
    fn smooth<'py>(
        &self,
        t: &Bound<'py, PyAny>,
        gyro: &Bound<'py, PyAny>,
        accel: &Bound<'py, PyAny>,
        mag: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = t.py();
        let fail = fail(py);
        let source =
            inertial_and_magnetic(t, gyro, accel, mag, &self.0.mounting()).map_err(fail)?;
        let settings = *self.0.filter.settings();
        let work = move |stop: &Stop| -> Result<_, Error> {
            let mut smoother = Smoother::new(settings)?;
            for sample in source.iter().take_while(|_| stop.proceed()) {
                match sample {
                    Sample::Magnetic(field) => smoother.field(&field)?,
                    Sample::Imu(sample) => {
                        smoother.step(&sample)?;
                    }
                    _ => {}
                }
            }
            Ok(smoother.finish())
        };
        let epochs = interruptible(py, work)?.map_err(|e| fail(e.into()))?;
        many(py, &epochs)
    }

    /// What is estimated, by block: ``attitude`` as a quaternion (w, x, y, z), and the others as in :attr:`covariance`.
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let state = self.0.filter.state();
        let q = &state.attitude;
        let out = PyDict::new(py);
        out.set_item("attitude", scalars(py, [q.w, q.i, q.j, q.k])?)?;
        for (name, vector) in [
            ("gyro_bias", &state.gyro_bias),
            ("velocity", &state.velocity),
            ("accel_bias", &state.accel_bias),
            ("offset", &state.offset),
            ("disturbance", &state.disturbance),
        ] {
            out.set_item(name, scalars(py, vector.iter().copied())?)?;
        }
        out.set_item("field", scalars(py, state.field.iter().copied())?)?;
        out.set_item("delay", scalars(py, [state.delay])?)?;
        Ok(out)
    }

    /// Covariance of the errors at the last correction, shape (21, 21); :attr:`blocks` says what stands where.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let p = self.0.filter.covariance();
        matrix(
            py,
            &DMatrix::from_fn(p.nrows(), p.ncols(), |i, j| p[(i, j)]),
        )
    }

    /// Where each block stands in :attr:`covariance`: slices by name.
    ///
    /// Attitude (level frame, rad: true = Exp(error) ∘ estimate), gyro bias (body, rad/s), velocity about its mean (level frame, m/s),
    /// accelerometer bias (body, m/s²), horizontal and downward field, field that turns with the body, field of the surroundings (level
    /// frame; all three in the magnetometer's unit), delay of the magnetometer (s).
    #[getter]
    fn blocks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        for (name, at, count) in AHRS_BLOCKS {
            out.set_item(
                name,
                PySlice::new(py, at as isize, (at + count) as isize, 1),
            )?;
        }
        Ok(out)
    }

    /// Settings in SI units, as a dictionary.
    #[getter]
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        dictionary(py, serde_json::to_string(self.0.filter.settings()))
    }

    /// How often the field became another one: iron that was put on or came near.
    #[getter]
    fn field_changes(&self) -> u32 {
        self.0.filter.field_changes()
    }

    #[classmethod]
    fn _from_state(_class: &Bound<'_, PyType>, state: &[u8]) -> PyResult<Self> {
        pickle::load::<Self, _>(state).map(AttitudeFilter)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        pickle::reduce(slf, &slf.borrow().0)
    }
}

impl AttitudeFilter {
    /// By the mounting of the settings, as arrays are.
    fn turn(&self, samples: &mut [Sample]) {
        let to_body = imu_to_body(ImuAxes::Frd, Some(self.0.mounting_rpy_deg));
        if to_body != Matrix3::identity() {
            samples.iter_mut().for_each(|s| inputs::turn(s, &to_body));
        }
    }
}

fn take(filter: &mut Ahrs, sample: &Sample) -> Result<Option<AhrsEpoch>, Error> {
    match sample {
        Sample::Magnetic(field) => filter.field(field).map(|()| None),
        Sample::Imu(sample) => filter.step(sample),
        _ => Ok(None),
    }
}

/// Settings with some of their keys replaced.
fn overlaid(settings: &AhrsSettings, given: toml::Table) -> Result<AhrsSettings, Failure> {
    let wrong = |e: String| {
        Failure::new(
            "bad_option",
            format!("settings: {e}"),
            "AttitudeFilter().settings has all keys",
        )
        .about("settings", e, "keys of AttitudeFilter().settings")
    };
    let mut table = toml::Table::try_from(settings).map_err(|e| wrong(e.to_string()))?;
    lay(&mut table, given);
    table
        .try_into()
        .map_err(|e: toml::de::Error| wrong(e.message().to_owned()))
}

fn lay(onto: &mut toml::Table, given: toml::Table) {
    for (key, value) in given {
        match (onto.get_mut(&key), value) {
            (Some(toml::Value::Table(inner)), toml::Value::Table(table)) => lay(inner, table),
            (_, value) => _ = onto.insert(key, value),
        }
    }
}

fn time(t: &Bound<'_, PyAny>) -> Result<Time, Failure> {
    Argument::new("t", t).instant()
}

/// `insnav.AttitudeEpoch`.
fn one<'py>(py: Python<'py>, epoch: &AhrsEpoch) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyDict::new(py);
    let (q, euler) = (&epoch.attitude, Euler::from_quaternion(&epoch.attitude));
    fields.set_item("time_s", epoch.time.seconds())?;
    fields.set_item("time_ns", epoch.time.0)?;
    fields.set_item("quaternion_nb_wxyz", scalars(py, [q.w, q.i, q.j, q.k])?)?;
    fields.set_item("roll_deg", euler.roll.to_degrees())?;
    fields.set_item("pitch_deg", euler.pitch.to_degrees())?;
    fields.set_item("heading_deg", euler.heading_deg())?;
    let covariance = by_rows(&epoch.covariance);
    fields.set_item(
        "attitude_covariance_n_rad2",
        rows(py, covariance.into_iter())?,
    )?;
    let bias = epoch.gyro_bias.iter().copied();
    fields.set_item("gyro_bias_rad_per_s", scalars(py, bias)?)?;
    fields.set_item("rests", epoch.rests)?;
    fields.set_item("saturated", epoch.saturated)?;
    fields.set_item("magnetic", epoch.magnetic)?;
    make(py, "AttitudeEpoch", &fields)
}

/// `insnav.Attitudes`.
fn many<'py>(py: Python<'py>, epochs: &[AhrsEpoch]) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyDict::new(py);
    let angles: Vec<Euler> = epochs
        .iter()
        .map(|e| Euler::from_quaternion(&e.attitude))
        .collect();
    let seconds = epochs.iter().map(|e| e.time.seconds());
    fields.set_item("time_s", scalars(py, seconds)?)?;
    fields.set_item("time_ns", scalars(py, epochs.iter().map(|e| e.time.0))?)?;
    let quaternions = epochs.iter().map(|e| {
        let q = &e.attitude;
        [q.w, q.i, q.j, q.k]
    });
    fields.set_item("quaternion_nb_wxyz", rows(py, quaternions)?)?;
    let angle = |get: fn(&Euler) -> f64| scalars(py, angles.iter().map(get));
    fields.set_item("roll_deg", angle(|a| a.roll.to_degrees())?)?;
    fields.set_item("pitch_deg", angle(|a| a.pitch.to_degrees())?)?;
    fields.set_item("heading_deg", angle(Euler::heading_deg)?)?;
    let covariances = epochs.iter().map(|e| by_rows(&e.covariance));
    fields.set_item("attitude_covariance_n_rad2", matrices(py, covariances)?)?;
    let biases = epochs.iter().map(|e| <[f64; 3]>::from(e.gyro_bias));
    fields.set_item("gyro_bias_rad_per_s", rows(py, biases)?)?;
    fields.set_item("rests", bools(py, epochs.iter().map(|e| e.rests))?)?;
    fields.set_item("saturated", bools(py, epochs.iter().map(|e| e.saturated))?)?;
    fields.set_item("magnetic", bools(py, epochs.iter().map(|e| e.magnetic))?)?;
    make(py, "Attitudes", &fields)
}

fn make<'py>(
    py: Python<'py>,
    class: &str,
    fields: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyAny>> {
    py.import("insnav._attitude")?
        .getattr(class)?
        .call((), Some(fields))
}

fn by_rows(m: &Matrix3<f64>) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| m[(i, j)]))
}
