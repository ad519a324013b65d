//! `insnav.sim.Scenario`: a scenario file as a value, and what comes of it.

use super::sources::{not_negative, seed_or_none};
use super::truth::truth;
use crate::arrays::{Argument, scalars};
use crate::columns::{Columns, Fixes};
use crate::failure::{Failure, fail};
use crate::interrupt::{Stop, interruptible};
use crate::settings;
use insnav_core::attitude::Euler;
use insnav_core::imu::ImuGrade;
use insnav_core::sample::Sample;
use insnav_core::sim;
use insnav_log::{KnownStart, RunError, ScenarioFile, simulated_truth};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping, PyString, PyTuple};
use std::path::PathBuf;

/// Where a vehicle goes, and what its inertial unit and its receiver make of it: plain data, a simulation but for its seed.
///
/// A scenario has the keys of the file that ``insnav simulate`` reads, each explained in ``insnav.sim.EXAMPLE``. It cannot be changed;
/// :meth:`replace` makes another. Scenarios compare by value and can be pickled.
///
/// Examples
/// --------
/// >>> import insnav
/// >>> scenario = insnav.sim.Scenario.car_drive(90.0).replace(imu={"grade": "tactical"})
/// >>> drive = scenario.simulate(seed=1)
/// >>> solution = insnav.run(drive.arrays, {"imu": {"grade": "tactical"}})
/// >>> insnav.compare(solution, drive.truth).summary["all"]["horizontal_rms_m"] < 3.0
/// True
#[pyclass(frozen, eq, module = "insnav.sim")]
#[derive(PartialEq)]
pub(crate) struct Scenario {
    file: ScenarioFile,
}

/// A file, or the error that names the key.
fn parse(text: &str, origin: &str, py: Python<'_>) -> PyResult<Scenario> {
    let file = ScenarioFile::parse(text, origin, None);
    let file = file.map_err(|e| Failure::from(e).into_py_err(py))?;
    Ok(Scenario { file })
}

/// Why nothing can be made of a duration, before a route is made for it.
fn duration(value: f64, py: Python<'_>) -> PyResult<f64> {
    if value > 0.0 && value <= 1e6 {
        return Ok(value);
    }
    Err(Failure::argument(
        "bad_option",
        "duration_s",
        value.to_string(),
        "positive and at most 1000000",
        "",
    )
    .into_py_err(py))
}

#[pymethods]
impl Scenario {
    /// Standing on level ground, 200 samples a second of an automotive-grade unit, GNSS at 1 Hz.
    ///
    /// Parameters
    /// ----------
    /// duration_s : float
    ///     Length, s.
    /// heading_deg : float, default 0
    ///     Heading, clockwise from true north.
    #[staticmethod]
    #[pyo3(signature = (duration_s, heading_deg=0.0))]
    fn standing(py: Python<'_>, duration_s: f64, heading_deg: f64) -> PyResult<Self> {
        let scenario = sim::Scenario::standing(duration(duration_s, py)?, heading_deg);
        Ok(Scenario {
            file: ScenarioFile::ready(scenario, ImuGrade::Automotive),
        })
    }

    /// A car in town and on fast roads by turns, standing for the first minute: always the same way, of which a shorter duration is
    /// the beginning. 200 samples a second of an automotive-grade unit, GNSS at 1 Hz.
    ///
    /// Parameters
    /// ----------
    /// duration_s : float
    ///     Length, s.
    #[staticmethod]
    fn car_drive(py: Python<'_>, duration_s: f64) -> PyResult<Self> {
        let scenario = sim::Scenario::car_drive(duration(duration_s, py)?);
        Ok(Scenario {
            file: ScenarioFile::ready(scenario, ImuGrade::Automotive),
        })
    }

    /// Twelve minutes in town and on a fast road with a consumer-grade unit and receiver: stops, two outages, some outliers.
    #[staticmethod]
    fn demo() -> Self {
        Scenario {
            file: ScenarioFile::ready(sim::Scenario::demo(), ImuGrade::Consumer),
        }
    }

    /// From the file that ``insnav simulate`` takes.
    ///
    /// Parameters
    /// ----------
    /// source : path or str
    ///     A path; or the text itself, which is a ``str`` of more than one line.
    ///
    /// Raises
    /// ------
    /// ConfigError
    ///     A key that does not exist, with the one that was probably meant, or a number outside its range.
    #[staticmethod]
    fn from_toml(source: &Bound<'_, PyAny>) -> PyResult<Self> {
        let py = source.py();
        if let Ok(text) = source.cast::<PyString>()
            && text.to_str()?.contains('\n')
        {
            return parse(text.to_str()?, "scenario", py);
        }
        let path: PathBuf = source.extract().map_err(|_| {
            PyTypeError::new_err(format!(
                "source: expected a path or TOML text, not {}",
                source.get_type()
            ))
        })?;
        let file = ScenarioFile::load(&path, None);
        Ok(Scenario {
            file: file.map_err(|e| Failure::from(e).into_py_err(py))?,
        })
    }

    /// From a mapping with the sections and keys of the file.
    ///
    /// Raises
    /// ------
    /// ConfigError
    ///     As :meth:`from_toml`.
    ///
    /// Examples
    /// --------
    /// >>> import insnav
    /// >>> start = {"latitude_deg": 50.0, "longitude_deg": 14.0, "height_m": 300.0, "heading_deg": 90.0}
    /// >>> route = [{"duration_s": 20.0}, {"duration_s": 10.0, "speed_m_per_s": 12.0}, {"duration_s": 8.0, "turn_deg": 90.0}]
    /// >>> insnav.sim.Scenario.from_dict({"start": start, "route": route}).duration_s
    /// 38.0
    #[staticmethod]
    fn from_dict(mapping: &Bound<'_, PyMapping>) -> PyResult<Self> {
        let table = settings::table(mapping, "scenario")?;
        parse(&table.to_string(), "scenario", mapping.py())
    }

    /// The file that states it, every key with its number; :meth:`from_toml` makes the same scenario of it, to the last bit.
    fn to_toml(&self, py: Python<'_>) -> PyResult<String> {
        self.file
            .text()
            .map_err(|e| Failure::from(e).into_py_err(py))
    }

    /// The same as a dictionary, for :meth:`from_dict`.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        settings::object(py, toml::Value::Table(self.table(py)?))
    }

    /// Another scenario, with some parts replaced.
    ///
    /// Parameters
    /// ----------
    /// **parts
    ///     Keys of the file: ``seed``, ``duration_s``, ``route``, ``start``, ``body``, ``imu``, ``gnss``. Of a section only the keys that
    ///     are given change; lists are replaced as a whole. A new ``route`` brings its own length, unless ``duration_s`` is given too.
    ///
    /// Raises
    /// ------
    /// ConfigError
    ///     As :meth:`from_toml`.
    ///
    /// Examples
    /// --------
    /// >>> import insnav
    /// >>> scenario = insnav.sim.Scenario.car_drive(300.0)
    /// >>> scenario.replace(gnss={"outages": [{"begin_s": 200.0, "end_s": 230.0}]}).to_dict()["gnss"]["outages"]
    /// [{'begin_s': 200.0, 'end_s': 230.0}]
    #[pyo3(signature = (**parts))]
    fn replace(&self, py: Python<'_>, parts: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut whole = self.table(py)?;
        if let Some(parts) = parts {
            let parts = settings::table(parts.as_mapping(), "scenario")?;
            if parts.contains_key("route") || parts.contains_key("ready_route") {
                whole.remove("route");
                if parts.contains_key("route") {
                    whole.remove("duration_s");
                }
            }
            merge(&mut whole, parts);
        }
        parse(&whole.to_string(), "scenario", py)
    }

    /// Length in time, s.
    #[getter]
    fn duration_s(&self) -> f64 {
        self.file.scenario.duration_s
    }

    /// Seed that the file states, used where :meth:`simulate` is given none; or None.
    #[getter]
    fn seed(&self) -> Option<u64> {
        self.file.seed
    }

    /// Simulate: the same scenario and seed give the same numbers, those of the log that ``insnav simulate`` writes.
    ///
    /// Parameters
    /// ----------
    /// seed : int, optional
    ///     Seed of all random numbers, 0 to 2⁶⁴ − 1. Absent: that of the scenario, else 1. Every error has a sequence of its own:
    ///     switching one off leaves the others as they were.
    /// truth_rate_hz : float, default 10
    ///     How often a second the truth is told.
    ///
    /// Returns
    /// -------
    /// Simulation
    ///     Arrays for :func:`insnav.run`, the truth, and a start.
    ///
    /// Raises
    /// ------
    /// ConfigError
    ///     A number outside its range, with its key.
    #[pyo3(signature = (seed=None, *, truth_rate_hz=10.0))]
    fn simulate<'py>(
        slf: &Bound<'py, Self>,
        #[pyo3(from_py_with = seed_or_none)] seed: Option<u64>,
        truth_rate_hz: f64,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = slf.py();
        let fail = fail(py);
        let this = slf.get();
        let scenario = &this.file.scenario;
        let most = 2e7;
        if !(truth_rate_hz > 0.0 && truth_rate_hz * scenario.duration_s < most) {
            return Err(fail(Failure::argument(
                "bad_option",
                "truth_rate_hz",
                truth_rate_hz.to_string(),
                format!("positive, and at most {most:.0} rows"),
                "",
            )));
        }
        let seed = seed.or(this.file.seed).unwrap_or(1);
        let shared = slf.clone().unbind();
        let work = move |_: &Stop| -> Result<_, Failure> {
            let this = shared.get();
            let simulation = this.file.simulate(seed)?;
            let mut columns = Columns::new(simulation.trajectory.start(), Fixes::Sigmas);
            // They come in the order of their arrival.
            let mut samples: Vec<&Sample> = simulation.samples.iter().collect();
            samples.sort_by_key(|s| s.time());
            samples.into_iter().for_each(|s| columns.push(s));
            let truth: Vec<_> =
                simulated_truth(&simulation, &this.file.scenario, truth_rate_hz).collect();
            Ok((columns, truth))
        };
        let (columns, instants) = interruptible(py, work)?.map_err(fail)?;
        let fields = PyDict::new(py);
        fields.set_item("scenario", slf)?;
        fields.set_item("seed", seed)?;
        fields.set_item(
            "arrays",
            columns.into_mapping(py, Some(scenario.gnss.lever_arm_b_m.into()))?,
        )?;
        fields.set_item("truth", truth(py, &instants)?)?;
        fields.set_item("start", this.true_start(py)?)?;
        py.import("insnav._sim")?
            .getattr("Simulation")?
            .call((), Some(&fields))
    }

    /// What really was at any instants: :attr:`Simulation.truth` where one wants it.
    ///
    /// Simulates once more, since biases are random. The motion does not depend on the seed.
    ///
    /// Parameters
    /// ----------
    /// time_s : (n,)
    ///     Instants, s from the start on the clock of GNSS positions, such as ``solution.time_s``. Before the start and after the end the
    ///     first and the last instant hold.
    /// seed : int, optional
    ///     As of :meth:`simulate`.
    ///
    /// Returns
    /// -------
    /// Truth
    #[pyo3(signature = (time_s, seed=None))]
    fn truth_at<'py>(
        slf: &Bound<'py, Self>,
        time_s: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = seed_or_none)] seed: Option<u64>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = time_s.py();
        let fail = fail(py);
        let seconds = Argument::new("time_s", time_s).column(None).map_err(fail)?;
        if let Some(row) = seconds.iter().position(|s| !s.is_finite()) {
            return Err(fail(Failure::argument(
                "not_finite",
                "time_s",
                format!("no finite time in row {row}"),
                "finite numbers",
                "",
            )));
        }
        let shared = slf.clone().unbind();
        let work = move |_: &Stop| -> Result<Vec<_>, Failure> {
            let file = &shared.get().file;
            let simulation = file.simulate(seed.or(file.seed).unwrap_or(1))?;
            let (start, offset) = (
                simulation.trajectory.start(),
                file.scenario.gnss.time_offset_s,
            );
            let at = |&s: &f64| (s, simulation.truth_at(start.plus(s - offset)));
            Ok(seconds.iter().map(at).collect())
        };
        let instants = interruptible(py, work)?.map_err(fail)?;
        truth(py, &instants)
    }

    /// A start for :func:`insnav.run` (see :class:`insnav.Start`): the true state at the first inertial sample, or one that is wrong by
    /// chance.
    ///
    /// Parameters
    /// ----------
    /// sigma_position_n_m, sigma_velocity_n_m_per_s, sigma_attitude_n_deg : float or (3,)
    ///     Standard deviations that the start states: north, east, down; the attitude's about these axes.
    /// seed : int, optional
    ///     Draw the errors of the start from its sigmas, by this seed. Absent: the true state. Where the statistics of a filter are asked
    ///     for, such as its NEES, the errors must be drawn: a start that is better than it states is no honest one.
    ///
    /// Returns
    /// -------
    /// dict
    ///
    /// Raises
    /// ------
    /// ArgumentError
    ///     A number outside its range, with its name.
    #[pyo3(
        signature = (*, sigma_position_n_m=None, sigma_velocity_n_m_per_s=None, sigma_attitude_n_deg=None, seed=None),
        text_signature = "($self, *, sigma_position_n_m=0.1, sigma_velocity_n_m_per_s=0.02, sigma_attitude_n_deg=0.1, seed=None)"
    )]
    fn start<'py>(
        &self,
        py: Python<'py>,
        sigma_position_n_m: Option<&Bound<'py, PyAny>>,
        sigma_velocity_n_m_per_s: Option<&Bound<'py, PyAny>>,
        sigma_attitude_n_deg: Option<&Bound<'py, PyAny>>,
        #[pyo3(from_py_with = seed_or_none)] seed: Option<u64>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let fail = fail(py);
        let scenario = &self.file.scenario;
        let trajectory = sim::Trajectory::new(&scenario.drive)
            .map_err(|e| fail(Failure::from(RunError::from(e))))?;
        let nav = trajectory.at(trajectory.start()).nav;
        let sigma = |name: &str, given: Option<&Bound<'py, PyAny>>, usual: f64| match given {
            Some(given) => not_negative(name, given),
            None => Ok(nalgebra::Vector3::repeat(usual)),
        };
        let attitude_deg =
            sigma("sigma_attitude_n_deg", sigma_attitude_n_deg, 0.1).map_err(fail)?;
        let mut start = KnownStart {
            time_s: None,
            position: nav.position,
            velocity_n: nav.velocity_n,
            q_nb: nav.q_nb,
            position_sigma: sigma("sigma_position_n_m", sigma_position_n_m, 0.1).map_err(fail)?,
            velocity_sigma: sigma("sigma_velocity_n_m_per_s", sigma_velocity_n_m_per_s, 0.02)
                .map_err(fail)?,
            attitude_sigma: attitude_deg.map(f64::to_radians),
        };
        if let Some(seed) = seed {
            start = start.drawn(seed);
        }
        let mapping = PyDict::new(py);
        let vector = |v: [f64; 3]| scalars(py, v);
        let p = start.position;
        let e = Euler::from_quaternion(&start.q_nb);
        mapping.set_item(
            "latitude_deg_longitude_deg_height_m",
            vector([p.latitude_deg(), p.longitude_deg(), p.height])?,
        )?;
        mapping.set_item("velocity_n_m_per_s", vector(start.velocity_n.into())?)?;
        mapping.set_item(
            "roll_deg_pitch_deg_heading_deg",
            vector([e.roll.to_degrees(), e.pitch.to_degrees(), e.heading_deg()])?,
        )?;
        mapping.set_item("sigma_position_n_m", vector(start.position_sigma.into())?)?;
        mapping.set_item(
            "sigma_velocity_n_m_per_s",
            vector(start.velocity_sigma.into())?,
        )?;
        mapping.set_item("sigma_attitude_n_deg", vector(attitude_deg.into())?)?;
        Ok(mapping)
    }

    fn __repr__(&self) -> String {
        let s = &self.file.scenario;
        format!(
            "<insnav.sim.Scenario: {} s, {} legs, {} IMU at {} Hz>",
            s.duration_s,
            s.drive.legs.len(),
            self.file.grade.name(),
            s.imu.rate_hz
        )
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        let py = slf.py();
        let text = slf.get().to_toml(py)?;
        let make = py.get_type::<Scenario>().getattr("from_toml")?;
        PyTuple::new(py, [make, PyTuple::new(py, [text])?.into_any()])
    }
}

impl Scenario {
    /// As a file.
    pub(crate) fn file(&self) -> &ScenarioFile {
        &self.file
    }

    fn table(&self, py: Python<'_>) -> PyResult<toml::Table> {
        self.to_toml(py)?
            .parse()
            .map_err(|e: toml::de::Error| PyTypeError::new_err(e.to_string()))
    }

    fn true_start<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.start(py, None, None, None, None)
    }
}

/// The second over the first, section by section.
fn merge(into: &mut toml::Table, parts: toml::Table) {
    for (key, value) in parts {
        match (into.get_mut(&key), value) {
            (Some(toml::Value::Table(old)), toml::Value::Table(new)) => merge(old, new),
            (_, value) => {
                into.insert(key, value);
            }
        }
    }
}
