//! `insnav.run`: the main job, as the command does it.

use crate::epochs::EpochColumns;
use crate::failure::{Failure, fail, warn, warn_of_arrays};
use crate::inputs;
use crate::interrupt::{Stop, interruptible};
use crate::known_start;
use crate::named::Named;
use crate::settings;
use crate::sinks::FileAndMemory;
use crate::solution::solution;
use insnav_core::config::Config;
use insnav_core::sample::GnssPosition;
use insnav_log::{
    ImuAxes, Log, Plan, ReadOptions, Role, RunOptions, RunReport, Source, Stoppable, TimeSource,
    UpdateRow,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Navigate: IMU and GNSS data become a trajectory with its uncertainty.
///
/// Does what the command ``insnav run`` does, to the last digit. Other threads run meanwhile.
///
/// Parameters
/// ----------
/// log : path or Arrays
///     An MCAP file with ROS 2, ROS 1, JSON or foxglove protobuf messages, or a mapping of arrays (see :class:`Arrays`).
/// config : mapping, path or TOML text, optional
///     Settings: a mapping with the sections and keys of the TOML file, such as
///     ``{"gnss": {"lever_arm_b_m": [0.5, 0.0, -1.2]}}``, the path of a file, or the text of one, such as ``summary["config"]`` of
///     another run (what has more than one line is no path). Seconds in it (``stationary.intervals_s``) count
///     from the log's zero, ``solution.t0_ns``: of arrays that of their ``time_s``.
/// output : path, optional
///     Where to write the solution as MCAP, for RViz, Foxglove, rerun, PlotJuggler and evo.
/// overwrite : bool, default False
///     Replace the output when it exists.
/// time_offset_s : float or "auto", optional
///     Seconds added to IMU stamps to meet the clock of GNSS positions; ``"auto"``: find it, and the lag of GNSS velocity,
///     in the data, 1.5 s to either side. ``summary["time_offset_s"]`` then has a sigma; where the data do not tell, it has none, the
///     setting stays, and a warning says so (``time_offset_unknown``). Without it a difference is looked for and warned of, but not used.
/// withhold : str, optional
///     Fixes to keep from the filter: intervals in seconds (``"120:150,300:330"``) or one in N epochs (``"every:2"``).
/// imu_only : bool, default False
///     Navigate without GNSS, from rest at the begin: positions count from the start. The same as ``{"gnss": {"use": False}}``.
/// start : mapping, optional
///     A state that is known, in place of a start found in the data (see :class:`Start`).
/// topics : mapping, optional
///     Of a log: topics by role (``"imu"``, ``"gnss"``, ``"gnss-velocity"``) where they cannot be told, and ``"standing"``: what
///     declares that the vehicle stands, a Bool or the speed of its wheels.
/// imu_axes : {"flu", "frd"}, optional
///     Of a log: axes of the IMU's messages; forward-left-up as ROS has it, or forward-right-down.
/// time_source : {"header", "log", "publish"}, optional
///     Of a log: which stamp of a message counts.
///
/// Returns
/// -------
/// Solution
///     Columns as numpy arrays, and a summary.
///
/// Raises
/// ------
/// InsnavError
///     Data, settings or a log that cannot be used; says what, where and the remedy.
///
/// Warns
/// -----
/// InsnavWarning
///     Data that look wrong; all warnings are in ``summary["warnings"]`` too.
///
/// Examples
/// --------
/// A unit that stands, without GNSS: positions count from the start.
///
/// >>> import numpy as np
/// >>> import insnav
/// >>> rng = np.random.default_rng(0)
/// >>> imu = (np.arange(0, 20, 0.01), rng.normal(0, 2e-4, (2000, 3)), [0, 0, -9.81] + rng.normal(0, 2e-2, (2000, 3)))
/// >>> solution = insnav.run({"imu": imu}, {"imu": {"grade": "consumer"}}, imu_only=True)
/// >>> bool(abs(solution.velocity_n_m_per_s).max() < 0.01)
/// True
#[pyfunction]
#[pyo3(signature = (
    log, config=None, *, output=None, overwrite=false, time_offset_s=None, withhold=None, imu_only=false, start=None,
    topics=None, imu_axes=None, time_source=None
))]
// One argument each of the Python function.
#[allow(clippy::too_many_arguments)]
pub(crate) fn run<'py>(
    log: &Bound<'py, PyAny>,
    config: Option<&Bound<'_, PyAny>>,
    output: Option<PathBuf>,
    overwrite: bool,
    time_offset_s: Option<&Bound<'_, PyAny>>,
    withhold: Option<&Bound<'_, PyAny>>,
    imu_only: bool,
    start: Option<&Bound<'_, PyAny>>,
    topics: Option<Named<String>>,
    imu_axes: Option<&str>,
    time_source: Option<&str>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = log.py();
    let fail = fail(py);
    let for_reading = settings::for_reading(config)?;
    let mut config = settings::config(config)?;
    if imu_only {
        config.gnss.used = false;
    }
    let mut options = RunOptions::default();
    match time_offset_s {
        None => {}
        Some(text) if text.extract::<&str>().is_ok_and(|t| t == "auto") => {
            options.time_offset_auto = true;
        }
        Some(number) => {
            config.gnss.time_offset_s = number.extract().map_err(|_| {
                PyTypeError::new_err("time_offset_s: expected a number of seconds or \"auto\"")
            })?;
            options.ignore_clocks = true;
        }
    }
    if let Some(given) = withhold {
        let text: &str = given.extract().map_err(|_| {
            PyTypeError::new_err(format!(
                "withhold: expected intervals as \"120:150,300:330\", or \"every:2\", not {}",
                given.get_type()
            ))
        })?;
        options.withhold = text.parse().map_err(|e| {
            fail(
                Failure::new(
                    "bad_option",
                    format!("withhold: {e}"),
                    "intervals as \"120:150,300:330\", or \"every:2\"",
                )
                .about(
                    "withhold",
                    format!("{text:?}"),
                    "intervals as \"120:150,300:330\", or \"every:2\"",
                ),
            )
        })?;
    }
    options.start = start.map(known_start::known_start).transpose()?;
    let job = Job {
        config,
        options,
        output,
        overwrite,
    };
    let done = if let Ok(mapping) = log.cast::<PyMapping>() {
        if topics.is_some() || imu_axes.is_some() || time_source.is_some() {
            return Err(PyTypeError::new_err(
                "topics, imu_axes and time_source say how to read a log; arrays have none",
            ));
        }
        let arrays = inputs::arrays(mapping, &job.config)?;
        if job.config.gnss.used {
            arrays.has_places().map_err(|e| fail(e.of_arrays()))?;
        }
        interruptible(py, move |stop| {
            job.run(&arrays, &[], stop)
                .map_err(|e| e.counted_from(Some(arrays.zero())).of_arrays())
        })?
    } else if let Ok(path) = log.extract::<PathBuf>() {
        let reading = for_reading
            .over(read_options(topics, imu_axes, time_source).map_err(fail)?)
            .with_settings_of(&job.config);
        not_the_input(&path, job.output.as_deref()).map_err(fail)?;
        interruptible(py, move |stop| {
            let log = Log::open(&path, reading)?;
            // As the command has it, so that both write the same file.
            let names = [
                ("input", path.display().to_string()),
                ("input_crc32", format!("{:08x}", log.crc32())),
            ];
            job.run(&log, &names, stop)
                .map_err(|e| e.counted_from(log.t0().ok().flatten()))
        })?
    } else {
        return Err(PyTypeError::new_err(format!(
            "log: expected the path of a log or a mapping of arrays, not {}",
            log.get_type()
        )));
    };
    let (plan, epochs, updates, withheld, report) = done.map_err(fail)?;
    let is_arrays = log.cast::<PyMapping>().is_ok();
    for warning in &report.warnings {
        match is_arrays {
            true => warn_of_arrays(py, warning)?,
            false => warn(py, warning)?,
        }
    }
    let summary = dictionary(py, serde_json::to_string(&report))?;
    solution(py, epochs, &updates, &withheld, plan.origin, &summary)
}

/// A recording is not written over by its own solution, whatever `overwrite` says.
fn not_the_input(input: &Path, output: Option<&Path>) -> Result<(), Failure> {
    let same = output.is_some_and(
        |output| match (input.canonicalize(), output.canonicalize()) {
            (Ok(a), Ok(b)) => a == b,
            _ => false,
        },
    );
    if !same {
        return Ok(());
    }
    Err(Failure::new(
        "output_is_input",
        format!("output: {} is the log itself", input.display()),
        "name another output",
    )
    .about(
        "output",
        input.display().to_string(),
        "another file than the log",
    ))
}

/// How it was done, and what came of it: epochs, measurements, withheld fixes and the report.
type Done = (
    Plan,
    EpochColumns,
    Vec<UpdateRow>,
    Vec<GnssPosition>,
    RunReport,
);

/// What is to be done with any source.
struct Job {
    config: Config,
    options: RunOptions,
    output: Option<PathBuf>,
    overwrite: bool,
}

impl Job {
    fn run(
        &self,
        source: &impl Source,
        metadata: &[(&str, String)],
        stop: &Stop,
    ) -> Result<Done, Failure> {
        let source = &Stoppable::new(source, stop.asked());
        let plan = Plan::make(source, &self.config, &self.options)?;
        let mut options = plan.sink_options();
        options.force = self.overwrite;
        for (key, value) in metadata {
            options.metadata.insert((*key).to_owned(), value.clone());
        }
        source.proceed()?;
        if let Some(output) = &self.output {
            stop.writes(output)?;
        }
        let mut sink = FileAndMemory::new(
            self.output.as_deref(),
            options,
            plan.epochs_expected(),
            stop,
        )?;
        let report = plan.execute(source, &mut sink)?;
        source.proceed()?;
        sink.finish_file()?;
        let (epochs, updates, withheld) = sink.into_solution();
        Ok((plan, epochs, updates, withheld, report))
    }
}

/// How a log is read.
pub(crate) fn read_options(
    topics: Option<Named<String>>,
    imu_axes: Option<&str>,
    time_source: Option<&str>,
) -> Result<ReadOptions, Failure> {
    let mut options = ReadOptions::default();
    for (key, topic) in topics.map_or_else(BTreeMap::new, |topics| topics.0) {
        let role = Role::from_key(&key).ok_or_else(|| {
            Failure::unknown_word("topics", &key, &Role::ALL.map(Role::key).join(", "))
        })?;
        options.topics.push((role, topic));
    }
    options.imu_axes = match imu_axes {
        None | Some("flu") => ImuAxes::Flu,
        Some("frd") => ImuAxes::Frd,
        Some(other) => return Err(Failure::unknown_word("imu_axes", other, "flu, frd")),
    };
    options.time_source = match time_source {
        None | Some("header") => TimeSource::Header,
        Some("log") => TimeSource::Log,
        Some("publish") => TimeSource::Publish,
        Some(other) => {
            return Err(Failure::unknown_word(
                "time_source",
                other,
                "header, log, publish",
            ));
        }
    };
    Ok(options)
}

/// A report as a dictionary: by way of JSON, so that keys and values are those of the command.
pub(crate) fn dictionary(
    py: Python<'_>,
    json: serde_json::Result<String>,
) -> PyResult<Bound<'_, PyDict>> {
    let text = json.map_err(|e| pyo3::exceptions::PyRuntimeError::new_err(e.to_string()))?;
    let dictionary = py.import("json")?.call_method1("loads", (text,))?;
    Ok(dictionary.cast_into::<PyDict>()?)
}
