//! The detector of stops: as a class, and over arrays.

use crate::arrays::{Argument, bools, rows, scalars};
use crate::failure::{Failure, fail};
use crate::inputs::{self, velocity_sample};
use crate::interrupt::{Stop, interruptible};
use crate::navigator::{stated, three};
use crate::pickle;
use crate::settings;
use insnav_core::config::{Config, VehicleKind};
use insnav_core::imu::ImuGrade;
use insnav_core::sample::{ImuSample, Sample, Speed, Standstill, Unfit};
use insnav_core::solution::Motion;
use insnav_core::stationary::{self, Belief, Evidence, Witness};
use insnav_core::time::Time;
use nalgebra::{Matrix3, Vector3};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping, PyTuple, PyType};
use serde::{Deserialize, Serialize};

/// Standard deviation of a velocity of which nobody knows anything, m/s.
const UNKNOWN_VELOCITY: f64 = 10.0;

/// Detector and what it is told of the filter.
#[derive(Clone, Serialize, Deserialize)]
struct State {
    detector: stationary::StopDetector,
    rate_b: Vector3<f64>,
    rate_covariance_b: Matrix3<f64>,
    velocity_n: Vector3<f64>,
    velocity_covariance_n: Matrix3<f64>,
}

impl State {
    fn new(config: &Config, gnss: bool) -> Self {
        let noise = config
            .noise
            .over(config.imu.grade.unwrap_or(ImuGrade::Consumer));
        let settings = config.stationary.for_vehicle(config.vehicle.kind);
        let mut detector = stationary::StopDetector::new(&settings, &noise);
        // Seconds are those of the arrays.
        detector.set_origin(Time(0));
        if !gnss {
            detector.never_by_gnss(config.vehicle.kind == VehicleKind::Car);
        }
        State {
            detector,
            rate_b: Vector3::zeros(),
            rate_covariance_b: Matrix3::from_diagonal_element(noise.gyro_bias_sigma.powi(2)),
            velocity_n: Vector3::zeros(),
            velocity_covariance_n: Matrix3::from_diagonal_element(UNKNOWN_VELOCITY.powi(2)),
        }
    }

    fn belief(&self) -> Belief {
        Belief {
            rate_b: self.rate_b,
            rate_covariance_b: self.rate_covariance_b,
            velocity_n: self.velocity_n,
            velocity_covariance_n: self.velocity_covariance_n,
        }
    }

    fn observe(&mut self, sample: &Sample) -> Result<(), Failure> {
        sample.check().map_err(|unfit| {
            let (code, what, why) = match unfit {
                Unfit::NotFinite { what } => ("not_finite", what, "is not finite"),
                Unfit::Impossible { what, why } => ("bad_value", what, why),
            };
            let message = format!("{what} at {}: {why}", sample.time());
            Failure::new(code, message, "leave the sample out")
        })?;
        let belief = self.belief();
        self.detector.observe(sample, &belief);
        Ok(())
    }
}

/// The detector of stops that a run uses, sample by sample.
///
/// It looks half a second ahead: after a sample stamped t, :attr:`standing_since_s` is of t - 0.5 s. Thresholds follow from the noise of
/// the unit at rest; :meth:`believe` tells what a filter knows, without which the gyro bias is taken to be anything that the class of
/// the unit allows, and the speed to be unknown.
///
/// Parameters
/// ----------
/// config : mapping or path, optional
///     Settings as of :func:`insnav.run`: all of ``stationary``, ``vehicle.kind``, and what the unit is worth (``imu.grade``, ``noise``; else
///     a consumer's).
/// gnss : bool, default False
///     Velocities of a receiver will come; without them a stop is believed unless what is believed of the velocity contradicts it.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from insnav import stationary
/// >>> detector = stationary.StopDetector({"imu": {"grade": "industrial"}})
/// >>> rng = np.random.default_rng(0)
/// >>> for k in range(1000):
/// ...     detector.step(0.01 * k, rng.normal(0, 1e-4, 3), rng.normal([0.0, 0.0, -9.81], 2e-3))
/// >>> detector.standing_since_s is not None
/// True
#[pyclass(module = "insnav.stationary")]
pub(crate) struct StopDetector(State);

#[pymethods]
impl StopDetector {
    #[new]
    #[pyo3(signature = (config=None, *, gnss=false))]
    fn new(config: Option<&Bound<'_, PyAny>>, gnss: bool) -> PyResult<Self> {
        Ok(StopDetector(State::new(&settings::config(config)?, gnss)))
    }

    /// Take an inertial sample: stamp (s, or a ``datetime64``), angular rate (rad/s) and specific force (m/s²), body axes, shape (3,).
    ///
    /// Stamps must not run backward; one at or before the last is left out.
    fn step(
        &mut self,
        t: &Bound<'_, PyAny>,
        gyro: &Bound<'_, PyAny>,
        accel: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let py = gyro.py();
        let fail = fail(py);
        let sample = ImuSample {
            time: time(t).map_err(fail)?,
            angular_rate_b: Argument::new("gyro", gyro).vector().map_err(fail)?,
            specific_force_b: Argument::new("accel", accel).vector().map_err(fail)?,
        };
        self.0.observe(&Sample::Imu(sample)).map_err(fail)
    }

    /// Take a receiver's velocity over ground, north, east, down, m/s, shape (3,), down NaN where it has none; with what it states of its
    /// errors, as of :meth:`insnav.Navigator.step_gnss_velocity`.
    #[pyo3(signature = (t, velocity_n_m_per_s, sigma_n_m_per_s=None))]
    fn gnss_velocity(
        &mut self,
        t: &Bound<'_, PyAny>,
        velocity_n_m_per_s: &Bound<'_, PyAny>,
        sigma_n_m_per_s: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let py = velocity_n_m_per_s.py();
        let fail = fail(py);
        let read = || {
            Ok(velocity_sample(
                time(t)?,
                three("velocity_n_m_per_s", velocity_n_m_per_s)?,
                stated("sigma_n_m_per_s", sigma_n_m_per_s)?,
            ))
        };
        self.0.observe(&read().map_err(fail)?).map_err(fail)
    }

    /// Take the speed of the wheels, m/s, whichever way they turn.
    fn speed(&mut self, py: Python<'_>, t: &Bound<'_, PyAny>, speed_m_per_s: f64) -> PyResult<()> {
        let speed = speed_m_per_s;
        time(t)
            .and_then(|time| self.0.observe(&Sample::Speed(Speed { time, speed })))
            .map_err(fail(py))
    }

    /// Somebody says whether the body stands, from t on.
    fn standstill(&mut self, py: Python<'_>, t: &Bound<'_, PyAny>, standing: bool) -> PyResult<()> {
        time(t)
            .and_then(|time| {
                let said = Standstill { time, standing };
                self.0.observe(&Sample::Standstill(said))
            })
            .map_err(fail(py))
    }

    /// What a filter knows about half a second before the next sample; what is not given stays as it was.
    ///
    /// Parameters
    /// ----------
    /// rate_b_rad_per_s : (3,), optional
    ///     What the gyros measure at rest: bias and Earth rate.
    /// rate_covariance_b_rad2_per_s2 : (3, 3), optional
    ///     Covariance of that.
    /// velocity_n_m_per_s : (3,), optional
    ///     Velocity, north, east, down.
    /// velocity_covariance_n_m2_per_s2 : (3, 3), optional
    ///     Covariance of that.
    #[pyo3(signature = (
        *, rate_b_rad_per_s=None, rate_covariance_b_rad2_per_s2=None, velocity_n_m_per_s=None,
        velocity_covariance_n_m2_per_s2=None
    ))]
    fn believe(
        &mut self,
        py: Python<'_>,
        rate_b_rad_per_s: Option<&Bound<'_, PyAny>>,
        rate_covariance_b_rad2_per_s2: Option<&Bound<'_, PyAny>>,
        velocity_n_m_per_s: Option<&Bound<'_, PyAny>>,
        velocity_covariance_n_m2_per_s2: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let mut state = self.0.clone();
        let mut read = || {
            if let Some(given) = rate_b_rad_per_s {
                state.rate_b = Argument::new("rate_b_rad_per_s", given).vector()?;
            }
            if let Some(given) = rate_covariance_b_rad2_per_s2 {
                state.rate_covariance_b =
                    Argument::new("rate_covariance_b_rad2_per_s2", given).fixed()?;
            }
            if let Some(given) = velocity_n_m_per_s {
                state.velocity_n = Argument::new("velocity_n_m_per_s", given).vector()?;
            }
            if let Some(given) = velocity_covariance_n_m2_per_s2 {
                state.velocity_covariance_n =
                    Argument::new("velocity_covariance_n_m2_per_s2", given).fixed()?;
            }
            Ok(())
        };
        read().map_err(fail(py))?;
        self.0 = state;
        Ok(())
    }

    /// Since when the body stands, s; None while it moves. Of half a second before the last sample.
    #[getter]
    fn standing_since_s(&self) -> Option<f64> {
        match self.0.detector.motion() {
            Motion::Stationary { since } => Some(since.seconds()),
            Motion::Moving => None,
        }
    }

    /// Who says so: ``"nobody"``, ``"detector"``, ``"declared"`` or ``"interval"``.
    #[getter]
    fn witness(&self) -> &'static str {
        witness_name(self.0.detector.evidence().witness)
    }

    /// Statistics over their thresholds as of the last sample: specific force, angular rate, mean rate, speed, shape (4,).
    ///
    /// All below 1 speak for a stop; NaN where there is nothing to judge.
    #[getter]
    fn ratios<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        scalars(py, ratios(&self.0.detector.evidence()))
    }

    /// Whether a body that stands rocks beyond its unit's noise.
    #[getter]
    fn rocks(&self) -> bool {
        self.0.detector.rocks()
    }

    fn __repr__(&self) -> String {
        match self.standing_since_s() {
            Some(since) => format!("<insnav.stationary.StopDetector: stands since {since:.3} s>"),
            None => "<insnav.stationary.StopDetector: moves>".to_owned(),
        }
    }

    #[classmethod]
    fn _from_state(_class: &Bound<'_, PyType>, state: &[u8]) -> PyResult<Self> {
        pickle::load::<Self, _>(state).map(StopDetector)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        pickle::reduce(slf, &slf.borrow().0)
    }
}

/// Stops of arrays, as the detector finds them without a filter.
///
/// A run (:func:`insnav.run`, whose ``stops`` are these) knows gyro bias and speed sample by sample and finds more; this is for studies of
/// the detector and for data without a solution. Other threads run meanwhile.
///
/// Parameters
/// ----------
/// arrays : Arrays
///     What :func:`insnav.run` takes: ``imu`` or ``imu_increment``; ``gnss_velocity``, ``speed`` and ``standstill`` where there are any.
/// config : mapping or path, optional
///     As of :class:`StopDetector`. ``stationary.intervals_s`` count on the scale of ``time_s``.
/// rate_b_rad_per_s : (3,), optional
///     What the gyros measure at rest (bias and Earth rate); zero.
/// sigma_rate_rad_per_s : float, optional
///     Standard deviation of that on each axis; by default the bias of the unit.
///
/// Returns
/// -------
/// StopIntervals
///     Stops, and what spoke for them at every inertial sample.
///
/// Raises
/// ------
/// InsnavError
///     Arrays or settings that cannot be used.
#[pyfunction]
#[pyo3(signature = (arrays, config=None, *, rate_b_rad_per_s=None, sigma_rate_rad_per_s=None))]
pub(crate) fn detect_stops<'py>(
    arrays: &Bound<'py, PyMapping>,
    config: Option<&Bound<'py, PyAny>>,
    rate_b_rad_per_s: Option<&Bound<'py, PyAny>>,
    sigma_rate_rad_per_s: Option<f64>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = arrays.py();
    let fail = fail(py);
    let config = settings::config(config)?;
    let source = inputs::arrays(arrays, &config)?;
    let samples = source.all();
    let heard = samples.iter().any(|s| matches!(s, Sample::GnssVelocity(_)));
    let mut state = State::new(&config, heard);
    let zero = source.zero();
    state.detector.set_origin(zero);
    if let Some(rate) = rate_b_rad_per_s {
        let rate = Argument::new("rate_b_rad_per_s", rate).vector();
        state.rate_b = rate.map_err(fail)?;
    }
    if let Some(sigma) = sigma_rate_rad_per_s {
        if !(sigma >= 0.0 && sigma.is_finite()) {
            return Err(fail(Failure::argument(
                "bad_option",
                "sigma_rate_rad_per_s",
                format!("{sigma}"),
                "zero or positive, and finite",
                "",
            )));
        }
        state.rate_covariance_b = Matrix3::from_diagonal_element(sigma * sigma);
    }
    let work = move |_: &Stop| {
        let usable = samples.into_iter().filter(|s| s.check().is_ok());
        let usable: Vec<Sample> = usable.collect();
        let belief = state.belief();
        stationary::detect_stops(&mut state.detector, &usable, &belief)
    };
    let found = interruptible(py, work)?;
    let fields = PyDict::new(py);
    let stops = &found.stops;
    let names = stops.iter().map(|s| witness_name(s.witness));
    let names: Vec<&str> = names.collect();
    let begin = stops.iter().map(|s| s.begin.since(zero));
    let end = stops.iter().map(|s| s.end.since(zero));
    let of_stops = stops.iter().map(|s| ratios(&s.evidence));
    fields.set_item("begin_s", scalars(py, begin)?)?;
    fields.set_item("end_s", scalars(py, end)?)?;
    fields.set_item("witness", PyTuple::new(py, names)?)?;
    fields.set_item("lasts", bools(py, stops.iter().map(|s| s.lasts))?)?;
    fields.set_item("ratios", rows(py, of_stops)?)?;
    let times = found.times.iter().map(|t| t.since(zero));
    fields.set_item("time_s", scalars(py, times)?)?;
    fields.set_item("standing", bools(py, found.standing.iter().copied())?)?;
    let of_samples = found.evidence.iter().map(ratios);
    fields.set_item("sample_ratios", rows(py, of_samples)?)?;
    py.import("insnav._stationary")?
        .getattr("StopIntervals")?
        .call((), Some(&fields))
}

fn ratios(evidence: &Evidence) -> [f64; 4] {
    [
        evidence.specific_force,
        evidence.angular_rate,
        evidence.mean_rate,
        evidence.speed,
    ]
}

fn witness_name(witness: Witness) -> &'static str {
    match witness {
        Witness::Nobody => "nobody",
        Witness::Detector => "detector",
        Witness::Declared => "declared",
        Witness::Interval => "interval",
    }
}

fn time(t: &Bound<'_, PyAny>) -> Result<Time, Failure> {
    Argument::new("t", t).instant()
}
