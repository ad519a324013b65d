//! The class: made, run over arrays, finished, looked at, kept.

use super::pending::Pending;
use crate::arrays::counted_from;
use crate::epochs::EpochColumns;
use crate::failure::{Failure, fail, refused};
use crate::filter::{Eskf, imu_noise};
use crate::geometry::nav_state::NavState;
use crate::inputs;
use crate::interrupt::{Signals, interruptible};
use crate::known_start::known_start;
use crate::pickle;
use crate::settings;
use crate::solution::solution;
use insnav_core::config::Config;
use insnav_core::imu::{ImuGrade, ImuNoise};
use insnav_core::navigator;
use insnav_core::time::Time;
use insnav_log::ros2::State;
use insnav_log::{ImuAxes, SinkOptions, config_text, imu_to_body, parse_config};
use nalgebra::Matrix3;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping, PyTuple};
use serde::{Deserialize, Serialize};

pub(super) type Any<'py> = Bound<'py, PyAny>;

/// The navigator of :func:`insnav.run`, one sample after the other: for live data, and to look inside.
///
/// Samples of all kinds come in about the order of time; the solution comes out about a second later, at the tail of a horizon in
/// which late samples find their place (:meth:`latest` predicts to the newest inertial sample). :meth:`batch` is the same as stepping every
/// sample, bit for bit, and many calls go on from each other. A navigator pickles and copies whole, wherever it is: what is saved and resumed
/// gives the bits of one run.
///
/// :func:`insnav.run` looks at a whole log before it begins (class and noise of the unit, clocks, wheels). Here the settings say it: without
/// ``imu.grade`` the worst class is taken. :meth:`from_toml` takes the settings that a run has found.
///
/// Parameters
/// ----------
/// config : mapping or path, optional
///     Settings as of :func:`insnav.run`.
/// noise : str or ImuNoise, optional
///     Class of the inertial unit or its noise, in place of those of the settings.
/// start : mapping, optional
///     A state that is known (see :class:`Start`), with its ``time_s``, in place of a start found in the data.
/// t0_ns : int, default 0
///     Instant from which the seconds of samples, ``start``, epochs, stops and events count, ns: with that of a log, stamps of today are exact. Dates (``datetime64``, those of pandas
///     and Python's own) are instants already.
/// keep : bool, default True
///     Keep epochs (at ``output.rate_hz``), measurements and events until they are taken; else the newest epoch alone.
///
/// Examples
/// --------
/// >>> import insnav
/// >>> start = {
/// ...     "time_s": 0.0,
/// ...     "latitude_deg_longitude_deg_height_m": [50.0, 14.0, 300.0],
/// ...     "velocity_n_m_per_s": [0.0, 0.0, 0.0],
/// ...     "roll_deg_pitch_deg_heading_deg": [0.0, 0.0, 90.0],
/// ...     "sigma_position_n_m": [1.0, 1.0, 1.0],
/// ...     "sigma_velocity_n_m_per_s": [0.1, 0.1, 0.1],
/// ...     "sigma_attitude_n_deg": [0.1, 0.1, 1.0],
/// ... }
/// >>> navigator = insnav.Navigator({"imu": {"grade": "industrial"}, "output": {"rate_hz": 10.0}}, start=start)
/// >>> for k in range(500):
/// ...     navigator.step_imu(0.01 * k, (0.0, 0.0, 0.0), (0.0, 0.0, -9.81))
/// >>> navigator.latest().time_s, round(navigator.epoch.time_s, 9)
/// (4.99, 3.9)
/// >>> navigator.finish()
/// >>> len(navigator.take())
/// 50
#[pyclass(module = "insnav")]
pub(crate) struct Navigator {
    pub(super) core: Box<navigator::Navigator>,
    pub(super) pending: Pending,
    config: Config,
    /// From the unit's axes to the body's, where these differ.
    pub(super) to_body: Option<Matrix3<f64>>,
    /// From when seconds count.
    pub(super) zero: Time,
    pub(super) finished: bool,
}

/// What is pickled: settings by their text.
#[derive(Serialize)]
struct Saved<'a> {
    core: &'a navigator::Navigator,
    pending: &'a Pending,
    config: String,
    zero: Time,
    finished: bool,
}

#[derive(Deserialize)]
struct Restored {
    core: Box<navigator::Navigator>,
    pending: Pending,
    config: String,
    zero: Time,
    finished: bool,
}

fn to_body(config: &Config) -> Option<Matrix3<f64>> {
    let to_body = imu_to_body(ImuAxes::Frd, Some(config.imu.mounting_rpy_deg));
    (to_body != Matrix3::identity()).then_some(to_body)
}

impl Navigator {
    fn make(
        py: Python<'_>,
        config: Config,
        noise: Option<&Any<'_>>,
        start: Option<&Any<'_>>,
        t0_ns: i64,
        keep: bool,
    ) -> PyResult<Self> {
        let zero = Time(t0_ns);
        let noise: ImuNoise = match noise {
            Some(given) => imu_noise("noise", given)?,
            None => {
                let grade = config.imu.grade.unwrap_or(ImuGrade::Consumer);
                config.noise.over(grade)
            }
        };
        let core = match start {
            None => navigator::Navigator::new(&config, noise),
            Some(given) => {
                let start = known_start(given)?;
                let Some(time_s) = start.time_s else {
                    return Err(fail(py)(Failure::argument(
                        "bad_start",
                        "start: time_s",
                        "missing",
                        "seconds on the scale of the samples",
                        "no inertial sample is here yet that could say when",
                    )));
                };
                let at = counted_from(zero, "start: time_s", Time::from_seconds(time_s));
                start.navigator(&config, noise, at.map_err(fail(py))?)
            }
        };
        let mut core = core.map_err(refused(py, zero))?;
        core.set_origin(zero);
        let options = SinkOptions {
            rate_hz: config.output.rate_hz,
            lever_arm_b_m: config.output.lever_arm_b_m,
            ..SinkOptions::default()
        };
        Ok(Navigator {
            core: Box::new(core),
            pending: Pending::new(&options, keep, zero),
            to_body: to_body(&config),
            config,
            zero,
            finished: false,
        })
    }
}

fn columns_of(states: impl IntoIterator<Item = State<'static>>) -> EpochColumns {
    let mut columns = EpochColumns::default();
    columns.extend(states);
    columns
}

#[cold]
pub(super) fn is_finished(py: Python<'_>) -> PyErr {
    fail(py)(
        Failure::new(
            "finished",
            "the navigator has finished",
            "make another one, or go on from a copy that was made before finish()",
        )
        .of(crate::failure::Class::Navigation),
    )
}

#[pymethods]
impl Navigator {
    #[new]
    #[pyo3(signature = (config=None, *, noise=None, start=None, t0_ns=0, keep=true))]
    fn new(
        py: Python<'_>,
        config: Option<&Any<'_>>,
        noise: Option<&Any<'_>>,
        start: Option<&Any<'_>>,
        t0_ns: i64,
        keep: bool,
    ) -> PyResult<Self> {
        let config = settings::config(config)?;
        Self::make(py, config, noise, start, t0_ns, keep)
    }

    /// A navigator with settings in the words of the TOML file, such as ``solution.summary["config"]``: what a run has found.
    ///
    /// Parameters
    /// ----------
    /// text : str
    ///     The settings.
    /// noise, start, t0_ns, keep
    ///     As of the class.
    ///
    /// Returns
    /// -------
    /// Navigator
    ///     One that has seen nothing yet.
    #[staticmethod]
    #[pyo3(signature = (text, *, noise=None, start=None, t0_ns=0, keep=true))]
    fn from_toml(
        py: Python<'_>,
        text: &str,
        noise: Option<&Any<'_>>,
        start: Option<&Any<'_>>,
        t0_ns: i64,
        keep: bool,
    ) -> PyResult<Self> {
        let config = parse_config(text, "text", &[]).map_err(|e| fail(py)(e.into()))?;
        Self::make(py, config, noise, start, t0_ns, keep)
    }

    /// Take many samples in the order of time: the same as stepping them one by one, bit for bit. Other threads run meanwhile; an
    /// interruption (Ctrl-C) leaves the navigator behind the samples that it had taken by then.
    ///
    /// Parameters
    /// ----------
    /// arrays : Arrays
    ///     As of :func:`insnav.run`. Calls go on from each other. Seconds count from their ``t0_ns``, else from that of the navigator; the
    ///     lever arm is that of the settings.
    ///
    /// Raises
    /// ------
    /// NavigationError
    ///     Of the samples that could not be used, the first; all others have been used.
    /// KeyboardInterrupt
    ///     Ctrl-C: the samples up to then have been used, :meth:`latest` says until when.
    fn batch(&mut self, py: Python<'_>, arrays: &Bound<'_, PyMapping>) -> PyResult<()> {
        if self.finished {
            return Err(is_finished(py));
        }
        let samples = if self.zero == Time(0) || arrays.contains(inputs::ZERO)? {
            inputs::arrays(arrays, &self.config)?
        } else {
            let with_zero = PyDict::new(py);
            with_zero.update(arrays)?;
            with_zero.set_item(inputs::ZERO, self.zero.0)?;
            inputs::arrays(with_zero.as_any().cast()?, &self.config)?
        };
        let (core, pending) = (&mut self.core, &mut self.pending);
        let (first, others) = py.detach(|| -> PyResult<_> {
            let (mut first, mut others) = (None, 0);
            let mut signals = Signals::new();
            for sample in samples.iter() {
                signals.look()?;
                if let Err(e) = core.step(&sample, pending) {
                    others += usize::from(first.is_some());
                    first.get_or_insert(e);
                }
            }
            Ok((first, others))
        })?;
        match (first, others) {
            (None, _) => Ok(()),
            (Some(e), 0) => Err(refused(py, self.zero)(e)),
            (Some(e), others) => {
                let failure = Failure::from(e).counted_from(Some(self.zero));
                Err(failure.with_others(others).into_py_err(py))
            }
        }
    }

    /// Use everything that still waits: after the last sample, once.
    ///
    /// Raises
    /// ------
    /// AlignmentError
    ///     The data ended before the run could start.
    /// NavigationError
    ///     Of the samples that waited and could not be used, the first; all others have been used, and :meth:`take` has what came out.
    /// KeyboardInterrupt
    ///     Ctrl-C: the navigator is as it was before.
    fn finish(&mut self, py: Python<'_>) -> PyResult<()> {
        if self.finished {
            return Err(is_finished(py));
        }
        let (mut core, mut pending) = (self.core.clone(), self.pending.emptied());
        let (core, pending, outcome) = interruptible(py, move |_| {
            let outcome = core.finish(&mut pending);
            (core, pending, outcome)
        })?;
        self.core = core;
        self.pending.follow(pending);
        self.finished = true;
        outcome.map_err(refused(py, self.zero))
    }

    /// Whether the run has begun: attitude and position are known.
    #[getter]
    fn started(&self) -> bool {
        self.core.filter().is_some()
    }

    /// The newest epoch that came out (:class:`Epoch`), at the tail of the horizon; None before the first.
    #[getter]
    fn epoch<'py>(&self, py: Python<'py>) -> PyResult<Option<Any<'py>>> {
        let Some(state) = self.pending.newest() else {
            return Ok(None);
        };
        let one = solution(
            py,
            columns_of([*state]),
            &[],
            &[],
            self.zero,
            &PyDict::new(py),
        )?;
        let at = state.header.stamp.since(self.zero);
        one.call_method1("epoch", (at,)).map(Some)
    }

    /// Position, velocity and attitude predicted to the newest inertial sample; None before the start.
    ///
    /// Returns
    /// -------
    /// NavState or None
    ///     In radians, of the IMU. It knows no ``t0_ns``: its ``time_s`` counts from the zero of dates, ``time_ns`` is the instant.
    fn latest(&self) -> Option<NavState> {
        self.core.latest().map(NavState)
    }

    /// A copy of the filter at the tail of the horizon (:class:`insnav.filter.Eskf`); None before the start. It knows no ``t0_ns``: its seconds
    /// count from the zero of dates.
    #[getter]
    fn filter(&self) -> Option<Eskf> {
        let mut filter = self.core.filter()?.clone();
        filter.settle();
        Some(Eskf(filter))
    }

    /// Factors on the stated sigmas of positions as used now, horizontal and vertical: learnt, or as set.
    #[getter]
    fn gnss_sigma_scale(&self) -> (f64, f64) {
        self.core.gnss_sigma_scale().into()
    }

    /// The same of velocities.
    #[getter]
    fn gnss_velocity_sigma_scale(&self) -> (f64, f64) {
        self.core.gnss_velocity_sigma_scale().into()
    }

    /// Take what has come out since the last time: epochs and measurements. An hour at 200 Hz is copied in 0.4 s, at the end of which Ctrl-C is
    /// heard; the same is true of pickling.
    ///
    /// Returns
    /// -------
    /// Solution
    ///     Its ``summary`` has the settings alone.
    fn take<'py>(&mut self, py: Python<'py>) -> PyResult<Any<'py>> {
        let (states, updates) = self.pending.take();
        let summary = PyDict::new(py);
        summary.set_item("config", config_text(&self.config))?;
        solution(py, columns_of(states), &updates, &[], self.zero, &summary)
    }

    /// Take the events since the last time: start, stops, gaps, samples that were not used.
    ///
    /// Returns
    /// -------
    /// list of Event
    ///     In the order in which they happened.
    fn take_events<'py>(&mut self, py: Python<'py>) -> PyResult<Vec<Any<'py>>> {
        let events = self.pending.take_events();
        events.iter().map(|event| event.object(py)).collect()
    }

    fn __repr__(&self) -> String {
        match self.core.filter() {
            None => "<insnav.Navigator: waiting for a start>".to_owned(),
            Some(filter) => format!(
                "<insnav.Navigator at {:.6} s{}>",
                filter.nominal().nav.time.since(self.zero),
                if self.finished { ", finished" } else { "" }
            ),
        }
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let own = slf.try_borrow()?;
        let saved = Saved {
            core: &own.core,
            pending: &own.pending,
            config: config_text(&own.config),
            zero: own.zero,
            finished: own.finished,
        };
        pickle::reduce(slf, &saved)
    }

    #[staticmethod]
    fn _from_state(py: Python<'_>, state: &[u8]) -> PyResult<Self> {
        let saved: Restored = pickle::load::<Self, _>(state)?;
        let config = parse_config(&saved.config, "pickle", &[]).map_err(|e| fail(py)(e.into()))?;
        Ok(Navigator {
            core: saved.core,
            pending: saved.pending,
            to_body: to_body(&config),
            config,
            zero: saved.zero,
            finished: saved.finished,
        })
    }
}
