//! The published experiments, by the command's own functions.

use super::sources::seed as seed_of;
use crate::arrays::counts;
use crate::failure::Failure;
use crate::interrupt::interruptible;
use crate::run::dictionary;
use insnav_cli::experiments::{Order, Paper, reproduce};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

fn made<'py>(
    py: Python<'py>,
    paper: Paper,
    runs: Option<u32>,
    seed: u64,
    imu: Option<PathBuf>,
    jobs: Option<u16>,
) -> PyResult<Bound<'py, PyDict>> {
    let made = interruptible(py, move |_| {
        let order = Order {
            runs,
            seed,
            imu: imu.as_deref(),
            jobs,
        };
        reproduce(paper, order)
    })?;
    let report = made.map_err(|problem| {
        Failure::new("bad_option", problem.message, problem.remedy).into_py_err(py)
    })?;
    dictionary(py, Ok(report))
}

/// Kozadaev & Makarenko 2017: what a filter makes of a stop of 300 s, its heading above all.
///
/// Ten variants on the same samples, from the paper's held heading to a constant pose; two negative controls beside them.
///
/// Parameters
/// ----------
/// runs : int, default 100
///     Number of runs, at least 2; all variants see the same. A hundred take some minutes on two cores.
/// seed : int, default 1
///     Seed of all random numbers.
/// imu : path, optional
///     A real unit that stood still for at least 300 s, in place of the simulated one: a log, or an ``imu.csv``.
/// multi_stop : bool, default False
///     Four stops with three drives of a minute between them.
/// jobs : int, optional
///     Number of threads; it changes nothing but the time. Absent: as many as there are cores.
///
/// Returns
/// -------
/// dict
///     That of ``insnav reproduce kozadaev2017 --format json``: ``rows`` with ``case``, ``variant``, ``quantity``, ``published``, ``ours``,
///     ``standard_error``, ``stated`` and ``limit`` (the Cramér–Rao bound); ``assumptions``.
///
/// Raises
/// ------
/// ArgumentError
///     An option or a record that cannot be used.
/// KeyboardInterrupt
///     Ctrl-C, at once. The runs that were asked for go on out of sight until they are made or the process ends.
///
/// References
/// ----------
/// [Kozadaev17]
#[pyfunction]
#[pyo3(signature = (runs=None, *, seed=1, imu=None, multi_stop=false, jobs=None))]
pub(crate) fn kozadaev2017(
    py: Python<'_>,
    #[pyo3(from_py_with = counts::runs)] runs: Option<u32>,
    #[pyo3(from_py_with = seed_of)] seed: u64,
    imu: Option<PathBuf>,
    multi_stop: bool,
    jobs: Option<u16>,
) -> PyResult<Bound<'_, PyDict>> {
    made(
        py,
        Paper::Kozadaev2017 { multi_stop },
        runs,
        seed,
        imu,
        jobs,
    )
}

/// Lobusov & Fomichev 2014: drifts and azimuth of a navigation-grade unit from stops in two positions.
///
/// The paper's equations beside the joint regression and the Kalman filter of ``insnav align``: still, rocking, quantised, with an accelerometer
/// bias, with realistic noise, and an hour of free run after compensation.
///
/// Parameters
/// ----------
/// runs : int, optional
///     Number of runs of the noisy case, at least 2; all others are made once. Absent: 100, of the drive 10.
/// seed : int, default 1
///     Seed of all random numbers.
/// drive : bool, default False
///     In place of the stops alone the drive between them: an hour without GNSS with a stop every five minutes.
/// jobs : int, optional
///     Number of threads; it changes nothing but the time. Absent: as many as there are cores.
///
/// Returns
/// -------
/// dict
///     That of ``insnav reproduce lobusov2014 --format json``, with rows as of :func:`kozadaev2017`.
///
/// Raises
/// ------
/// ArgumentError
///     An option that cannot be used.
/// KeyboardInterrupt
///     Ctrl-C, at once. The runs that were asked for go on out of sight until they are made or the process ends.
///
/// References
/// ----------
/// [Lobusov14]
#[pyfunction]
#[pyo3(signature = (runs=None, *, seed=1, drive=false, jobs=None))]
pub(crate) fn lobusov2014(
    py: Python<'_>,
    #[pyo3(from_py_with = counts::runs)] runs: Option<u32>,
    #[pyo3(from_py_with = seed_of)] seed: u64,
    drive: bool,
    jobs: Option<u16>,
) -> PyResult<Bound<'_, PyDict>> {
    made(py, Paper::Lobusov2014 { drive }, runs, seed, None, jobs)
}

/// Belokurov 2018: Q and R of an attitude filter (gyros, accelerometers, magnetometer) from its own innovations.
///
/// The paper's scheme with its errors corrected, on a simulated ADIS16405: at rest, turning, shaken, pushed, beside iron.
///
/// Parameters
/// ----------
/// runs : int, default 100
///     Number of runs of each case, at least 2; all variants see the same. A hundred take some minutes on two cores.
/// seed : int, default 1
///     Seed of all random numbers.
/// imu : path, optional
///     A real ADIS16405 that lay still for at least 180 s, besides the simulated one: a log, or an ``imu.csv``.
/// jobs : int, optional
///     Number of threads; it changes nothing but the time. Absent: as many as there are cores.
///
/// Returns
/// -------
/// dict
///     That of ``insnav reproduce belokurov2018 --format json``, with rows as of :func:`kozadaev2017`.
///
/// Raises
/// ------
/// ArgumentError
///     An option or a record that cannot be used.
/// KeyboardInterrupt
///     Ctrl-C, at once. The runs that were asked for go on out of sight until they are made or the process ends.
///
/// References
/// ----------
/// [Belokurov18]
#[pyfunction]
#[pyo3(signature = (runs=None, *, seed=1, imu=None, jobs=None))]
pub(crate) fn belokurov2018(
    py: Python<'_>,
    #[pyo3(from_py_with = counts::runs)] runs: Option<u32>,
    #[pyo3(from_py_with = seed_of)] seed: u64,
    imu: Option<PathBuf>,
    jobs: Option<u16>,
) -> PyResult<Bound<'_, PyDict>> {
    made(py, Paper::Belokurov2018, runs, seed, imu, jobs)
}
