//! `insnav.read_mcap`, `read_solution` and `write_mcap`: logs and solutions between files and arrays.

use crate::columns::{Columns, Fixes};
use crate::epochs::EpochColumns;
use crate::failure::{Failure, fail};
use crate::inputs;
use crate::interrupt::{Stop, interruptible};
use crate::named::Named;
use crate::run::{dictionary, read_options};
use crate::settings;
use crate::sim::Scenario;
use crate::solution::solution;
use insnav_core::config::Config;
use insnav_core::time::Time;
use insnav_log::{
    Log, LogWriter, LogWriterOptions, METADATA_NAME, ReadOptions, Role, read_solution_states,
    read_solution_updates, read_solution_withheld, write_simulated,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Read a log into arrays, as :func:`insnav.run` reads it.
///
/// ``run(read_mcap(path))`` gives the columns of ``run(path)`` to the last bit; what the summary says of the file itself (its topics, stamps
/// on the recorder's clock, damage) is of the latter only. Other threads run meanwhile.
///
/// Parameters
/// ----------
/// path : path
///     An MCAP file with ROS 2, ROS 1, JSON or foxglove protobuf messages.
/// topics : mapping, optional
///     Topics by role where they cannot be told, as of :func:`insnav.run`.
/// imu_axes : {"flu", "frd"}, optional
///     Axes of the IMU's messages.
/// time_source : {"header", "log", "publish"}, optional
///     Which stamp of a message counts.
/// config : mapping or path, optional
///     Settings, for what they say of the reading: maps of messages, the topic that declares standing, whether GNSS is read. A mounting that they
///     state is left to :func:`insnav.run`, which is given the same settings.
///
/// Returns
/// -------
/// Recording
///     A dictionary with the keys of :class:`Arrays`, ``t0_ns`` and, where the log says it, ``lever_arm_b_m`` among them: body axes
///     forward-right-down, turned by the mounting that ``/tf_static`` states where the settings state none; fixes with covariances
///     (n, 3, 3). Its attributes tell of the file.
///
/// Raises
/// ------
/// LogError
///     A file that cannot be read, or without what could be navigated.
///
/// See Also
/// --------
/// read_solution : for what :func:`insnav.run` writes.
#[pyfunction]
#[pyo3(signature = (path, *, topics=None, imu_axes=None, time_source=None, config=None))]
pub(crate) fn read_mcap<'py>(
    py: Python<'py>,
    path: PathBuf,
    topics: Option<Named<String>>,
    imu_axes: Option<&str>,
    time_source: Option<&str>,
    config: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let fail = fail(py);
    let for_reading = settings::for_reading(config)?;
    let config = settings::config(config)?;
    let mut reading = for_reading.over(read_options(topics, imu_axes, time_source).map_err(fail)?);
    if config.imu.mounting_rpy_deg != [0.0; 3] {
        reading.imu_mounting_rpy_deg = Some([0.0; 3]);
    }
    let reading = reading.with_settings_of(&config);
    let read = move |stop: &Stop| -> Result<_, Failure> {
        let log = Log::open(&path, reading)?;
        let t0 = log.t0()?.unwrap_or(Time(0));
        let mut columns = Columns::new(t0, Fixes::Exact);
        let mut samples = log.samples()?;
        for sample in samples.by_ref() {
            stop.check()?;
            columns.push(&sample?);
        }
        if columns.is_empty() {
            log.require(Role::Imu)?;
        }
        let counts = samples.counts();
        let lever_arm_b = log.lever_arm_b()?;
        Ok((log, t0, columns, counts, lever_arm_b))
    };
    let (log, t0, columns, counts, lever_arm_b) = interruptible(py, read)?.map_err(fail)?;
    let arrays = columns.into_mapping(py, lever_arm_b)?;
    arrays.set_item("t0_ns", t0.0)?;
    let chosen = PyDict::new(py);
    for role in Role::ALL {
        if let Some(topic) = log.selected().topic(role) {
            chosen.set_item(role.key(), &log.topics()[topic].name)?;
        }
    }
    let about = PyDict::new(py);
    about.set_item("path", log.path().display().to_string())?;
    about.set_item("topics", chosen)?;
    about.set_item("counts", dictionary(py, serde_json::to_string(&counts))?)?;
    about.set_item("metadata", metadata(&log))?;
    py.import("insnav._recording")?
        .getattr("Recording")?
        .call((arrays,), Some(&about))
}

/// The record of our own files.
fn metadata(log: &Log) -> BTreeMap<String, String> {
    log.metadata(METADATA_NAME).cloned().unwrap_or_default()
}

/// Read a solution back from the file that :func:`insnav.run` or the command has written.
///
/// Parameters
/// ----------
/// path : path
///     An MCAP file with a topic ``/insnav/state``.
///
/// Returns
/// -------
/// Solution
///     The columns and updates of the run, to the last bit. Its ``summary`` has what the file says of the run: ``config``, the settings as
///     used, ``withhold``, and ``metadata``; the report of the run is not in the file.
///
/// Raises
/// ------
/// LogError
///     A file that cannot be read, or is no solution.
#[pyfunction]
pub(crate) fn read_solution(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyAny>> {
    let fail = fail(py);
    let read = move |_: &Stop| -> Result<_, Failure> {
        let log = Log::open(&path, ReadOptions::default())?;
        let mut epochs = EpochColumns::default();
        read_solution_states(&log, |state| epochs.push(state))?;
        let updates = read_solution_updates(&log)?;
        let withheld = read_solution_withheld(&log)?;
        let t0 = match log.t0()? {
            Some(t0) => t0,
            None => epochs.first().unwrap_or(Time(0)),
        };
        Ok((metadata(&log), epochs, updates, withheld, t0))
    };
    let (metadata, epochs, updates, withheld, t0) = interruptible(py, read)?.map_err(fail)?;
    let summary = PyDict::new(py);
    for key in ["config", "withhold"] {
        if let Some(text) = metadata.get(key) {
            summary.set_item(key, text)?;
        }
    }
    summary.set_item("metadata", metadata)?;
    solution(py, epochs, &updates, &withheld, t0, &summary)
}

/// Write arrays or a simulated drive as a log: an MCAP file of ROS 2 messages, for the command and for all that reads such files.
///
/// The file appears under its name when it is complete. Other threads run meanwhile.
///
/// Parameters
/// ----------
/// path : path
///     Where to.
/// data : Arrays, Recording or insnav.sim.Simulation
///     Arrays as of :func:`insnav.run`; ``t0_ns`` and ``lever_arm_b_m`` among them are stored with them. Messages are recorded at their stamps.
///     A simulation is simulated once more, and written as ``insnav simulate`` writes it: byte for byte, each message at the instant of its
///     arrival.
/// overwrite : bool, default False
///     Replace the file when it exists.
///
/// Raises
/// ------
/// LogError
///     A file that cannot be written; ``imu_increment`` and ``heading``, for which there is no standard message.
/// ArgumentError
///     Arrays that cannot be used.
///
/// Notes
/// -----
/// Topics: ``/imu/data``, ``/gps/fix``, ``/gps/vel``, ``/imu/mag``, ``/vehicle/standing``, ``/vehicle/speed``, ``/tf_static``. Numbers are kept to
/// the last bit, but for latitudes and longitudes, which go by way of radians (a unit in the last place, 1 nm), and the sigmas of arrays, which
/// are written as variances. What declares standing has to be named when it is read: ``topics={"standing": "/vehicle/standing"}``.
///
/// Examples
/// --------
/// >>> import insnav, os, tempfile
/// >>> drive = insnav.sim.Scenario.car_drive(60.0).simulate(seed=1)
/// >>> with tempfile.TemporaryDirectory() as folder:
/// ...     path = os.path.join(folder, "drive.mcap")
/// ...     insnav.write_mcap(path, drive)
/// ...     recording = insnav.read_mcap(path)
/// >>> recording["imu"][0].shape
/// (12001,)
#[pyfunction]
#[pyo3(signature = (path, data, *, overwrite=false))]
pub(crate) fn write_mcap(path: PathBuf, data: &Bound<'_, PyAny>, overwrite: bool) -> PyResult<()> {
    let py = data.py();
    let fail = fail(py);
    if let Ok(mapping) = data.cast::<PyMapping>() {
        let arrays = inputs::arrays(mapping, &Config::default())?;
        let write = move |stop: &Stop| -> Result<(), Failure> {
            stop.writes(&path)?;
            let options = LogWriterOptions {
                force: overwrite,
                // Of dates, seconds count from the first sample.
                t0: (!arrays.is_dated()).then(|| arrays.zero()),
                lever_arm_b: arrays.lever_arm(),
                ..LogWriterOptions::default()
            };
            let mut writer = LogWriter::create(&path, options)?;
            for sample in arrays.iter() {
                stop.check()?;
                writer.write(&sample)?;
            }
            writer.finish()?;
            Ok(())
        };
        return interruptible(py, write)?.map_err(fail);
    }
    let simulated = data.getattr_opt("scenario")?.zip(data.getattr_opt("seed")?);
    if let Some((scenario, seed)) = simulated
        && let Ok(scenario) = scenario.cast::<Scenario>()
    {
        let (scenario, seed) = (scenario.clone().unbind(), seed.extract()?);
        let write = move |stop: &Stop| -> Result<(), Failure> {
            let file = scenario.get().file();
            let simulation = file.simulate(seed)?;
            stop.writes(&path)?;
            write_simulated(&path, &simulation, &file.scenario.gnss, overwrite, |_| {
                stop.check().map_err(Failure::from)
            })
        };
        return interruptible(py, write)?.map_err(fail);
    }
    Err(PyTypeError::new_err(format!(
        "data: expected a mapping of arrays or a simulation, not {}",
        data.get_type()
    )))
}
