//! `insnav.align.by_stops`: what `insnav align` does.

use super::found;
use super::record::{heading_and_sigma, method, windows};
use crate::failure::{Failure, fail, warn};
use crate::inputs;
use crate::interrupt::interruptible;
use crate::named::Named;
use crate::run::{dictionary, read_options};
use crate::settings;
use insnav_core::config::Config;
use insnav_log::Stoppable;
use insnav_log::{AlignRequest, Log, Role};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyMapping;
use std::path::PathBuf;

/// Attitude, heading and sensor drifts from standing data, in one position or several: what the command ``insnav align`` does.
///
/// Gyros that feel the Earth turn find north by themselves; a turn between stops tells their drift apart from it. Units that do
/// not are levelled, and told how far off the azimuth would be. Other threads run meanwhile.
///
/// Parameters
/// ----------
/// log : path or Arrays
///     An MCAP file, or a mapping of arrays (see :class:`insnav.Arrays`), of which ``imu`` or ``imu_increment`` is enough.
/// config : mapping or path, optional
///     Settings as of :func:`insnav.run`. What it says of the unit (``imu.grade``, ``noise``) counts; else what the record shows at rest.
/// method : str, default "auto"
///     ``"auto"``, ``"levelling"``, ``"two_vector"``, ``"coarse"``, ``"gyrocompass"``, ``"fine"``, ``"multi_position"``, ``"joint"``,
///     ``"kalman"``, ``"paper"`` or ``"zupt2"``, as the functions of :mod:`insnav.align` of these names.
/// stops : (k, 2), optional
///     Begin and end of each stop, s, on the scale of ``time_s`` (of a log from its zero). Without it those that a run finds.
/// latitude_deg : float, optional
///     Without it that of ``output.origin`` or ``alignment.latitude_deg``, else of the fixes.
/// heading_deg, heading_sigma_deg : float, optional
///     Heading of the forward axis at the first stop's begin from true north, where it is known, and its standard deviation.
/// max_azimuth_sigma_deg : float, default 5
///     The azimuth is called unobservable when its standard deviation would be larger.
/// topics, imu_axes, time_source
///     How to read a log, as of :func:`insnav.run`.
///
/// Returns
/// -------
/// Alignment
///     Its ``summary`` has the keys of ``insnav align --format json``.
///
/// Raises
/// ------
/// AlignmentError
///     The refusal, with what shows it and the remedy; ``time_s`` is the begin of the stop that it is about.
/// InsnavError
///     Data or settings that cannot be used; no latitude; no stops.
///
/// Warns
/// -----
/// InsnavWarning
///     A heading that is not found, stops that nobody confirms.
#[pyfunction]
#[pyo3(signature = (
    log, config=None, *, method="auto", stops=None, latitude_deg=None, heading_deg=None, heading_sigma_deg=None,
    max_azimuth_sigma_deg=5.0, topics=None, imu_axes=None, time_source=None
))]
// One argument each of the Python function.
#[allow(clippy::too_many_arguments)]
pub(crate) fn align_by_stops<'py>(
    log: &Bound<'py, PyAny>,
    config: Option<&Bound<'py, PyAny>>,
    method: &str,
    stops: Option<&Bound<'py, PyAny>>,
    latitude_deg: Option<f64>,
    heading_deg: Option<f64>,
    heading_sigma_deg: Option<f64>,
    max_azimuth_sigma_deg: f64,
    topics: Option<Named<String>>,
    imu_axes: Option<&str>,
    time_source: Option<&str>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = log.py();
    let fail = fail(py);
    let for_reading = settings::for_reading(config)?;
    let mut config = settings::config(config)?;
    let mut windows = match stops {
        Some(stops) => windows(stops).map_err(fail)?,
        None => Vec::new(),
    };
    // Those of the settings are known as well, as the command has it.
    windows.extend(config.stationary.intervals_s.as_slice());
    windows.sort_by(|a, b| a[0].total_cmp(&b[0]));
    windows.dedup();
    let request = AlignRequest {
        method: self::method(method, heading_deg).map_err(fail)?,
        stops: windows,
        latitude_deg,
        heading_deg: heading_and_sigma(heading_deg, heading_sigma_deg).map_err(fail)?,
        largest_azimuth_sigma_deg: Some(max_azimuth_sigma_deg),
    };
    let report = if let Ok(mapping) = log.cast::<PyMapping>() {
        if topics.is_some() || imu_axes.is_some() || time_source.is_some() {
            return Err(PyTypeError::new_err(
                "topics, imu_axes and time_source say how to read a log; arrays have none",
            ));
        }
        let arrays = inputs::arrays(mapping, &config)?;
        interruptible(py, move |stop| {
            let source = Stoppable::new(&arrays, stop.asked());
            insnav_log::align_by_stops(&source, &config, &request)
        })?
        .map_err(Failure::from)
    } else if let Ok(path) = log.extract::<PathBuf>() {
        let given = read_options(topics, imu_axes, time_source).map_err(fail)?;
        interruptible(py, move |stop| {
            let options = |config: &Config| {
                for_reading
                    .clone()
                    .over(given.clone())
                    .with_settings_of(config)
            };
            let mut log = Log::open(&path, options(&config))?;
            if config.gnss.used && log.optional(Role::GnssPosition)?.is_none() {
                // Stops are then looked for without it.
                config.gnss.used = false;
                log = log.read_anew(options(&config))?;
            }
            let source = Stoppable::new(&log, stop.asked());
            Ok(insnav_log::align_by_stops(&source, &config, &request)?)
        })?
    } else {
        return Err(PyTypeError::new_err(format!(
            "log: expected the path of a log or a mapping of arrays, not {}",
            log.get_type()
        )));
    }
    .map_err(fail)?;
    for warning in &report.warnings {
        warn(py, warning)?;
    }
    let summary = dictionary(py, serde_json::to_string(&report))?;
    found::alignment(py, &report.result, Some(summary))
}
