//! `insnav.noise.identify_noise`: what `insnav noise` does, on arrays.

use super::found;
use super::refusal::refused;
use crate::arrays::Argument;
use crate::failure::fail;
use crate::inputs::inertial_and_magnetic;
use crate::interrupt::{Stop, interruptible};
use crate::run::dictionary;
use crate::settings;
use insnav_core::noise::{self, AxisStability, NoiseReading};
use insnav_log::{NoiseRequest, RunError, Stoppable, identify_log_noise};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

/// Noise of gyros, accelerometers and magnetometer from a record at rest or turning.
///
/// Does what the command ``insnav noise`` does: Allan deviation over the longest rest, and autocovariance least squares over windows of
/// all of the record, those that accelerate left out. Other threads run meanwhile.
///
/// Parameters
/// ----------
/// t : (n,)
///     Seconds, or ``datetime64``, at equal steps.
/// gyro : (n, 3)
///     Angular rate, body axes (forward-right-down), rad/s.
/// accel : (n, 3)
///     Specific force, body axes, m/s²; (0, 0, -g) at rest and level.
/// mag : (n, 3) or (t, field), optional
///     Magnetic field, body axes, T, rows of NaN where there is none; or a tuple of stamps and fields.
/// config : mapping or path, optional
///     Settings as of :func:`insnav.run`: ``imu.grade`` and ``noise`` say what is kept where the record tells nothing.
/// window_s : float, optional
///     Length of a window. Without it by the noise itself.
/// part_s : (float, float), optional
///     A part of the record that is looked at alone, and that counts as rest, on the scale of ``t``.
///
/// Returns
/// -------
/// dict
///     The report, with the keys of ``insnav noise --format json``: ``als`` and ``allan``, each number with its standard error, whether it
///     was accepted and why; ``config`` is the ``[noise]`` block for a settings file.
///
/// Raises
/// ------
/// InsnavError
///     Uneven steps, a channel that is flat or at the end of its range, a record too short.
#[pyfunction]
#[pyo3(signature = (t, gyro, accel, mag=None, *, config=None, window_s=None, part_s=None))]
// One argument each of the Python function.
#[allow(clippy::too_many_arguments)]
pub(crate) fn identify_noise<'py>(
    t: &Bound<'py, PyAny>,
    gyro: &Bound<'py, PyAny>,
    accel: &Bound<'py, PyAny>,
    mag: Option<&Bound<'py, PyAny>>,
    config: Option<&Bound<'py, PyAny>>,
    window_s: Option<f64>,
    part_s: Option<[f64; 2]>,
) -> PyResult<Bound<'py, PyDict>> {
    let py = t.py();
    let fail = fail(py);
    let config = settings::config(config)?;
    let source = inertial_and_magnetic(t, gyro, accel, mag, &config).map_err(fail)?;
    let request = NoiseRequest {
        part: part_s,
        window_s,
    };
    let work = move |stop: &Stop| {
        let source = Stoppable::new(&source, stop.asked());
        identify_log_noise(&source, &config, &request)
    };
    let report = interruptible(py, work)?.map_err(|e| match e {
        // What the command says of it names its flags.
        RunError::Noise(refusal) => fail(refused(refusal)),
        other => fail(other.into()),
    })?;
    dictionary(py, serde_json::to_string(&report))
}

/// Allan deviation and its fit on every axis of a unit at rest, over its longest piece without a gap.
///
/// Parameters
/// ----------
/// t : (n,)
///     Seconds, or ``datetime64``, at equal steps but for gaps.
/// gyro : (n, 3)
///     Angular rate, body axes, rad/s.
/// accel : (n, 3)
///     Specific force, body axes, m/s².
///
/// Returns
/// -------
/// RestStability
///     Deviations and fits, gyros in rad/s, accelerometers in m/s².
///
/// Raises
/// ------
/// ArgumentError, IdentificationError
///     Uneven steps, a flat channel, less than ten seconds.
#[pyfunction]
pub(crate) fn rest_stability<'py>(
    t: &Bound<'py, PyAny>,
    gyro: &Bound<'py, PyAny>,
    accel: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = t.py();
    let fail = fail(py);
    let times = Argument::new("t", t).times().map_err(fail)?;
    let rows = times.len();
    let gyro = Argument::new("gyro", gyro).finite_vectors(rows);
    let gyro = gyro.map_err(fail)?;
    let accel = Argument::new("accel", accel).finite_vectors(rows);
    let accel = accel.map_err(fail)?;
    let stability = interruptible(py, move |_| {
        let rows = times.iter().zip(&gyro).zip(&accel);
        let readings: Vec<NoiseReading> = rows
            .map(|((&time, &rate), &force)| NoiseReading {
                time,
                angular_rate_b: rate,
                specific_force_b: force,
                magnetic_field_b: None,
            })
            .collect();
        noise::rest_stability(&readings)
    })?
    .map_err(|e| fail(refused(e)))?;
    let fields = PyDict::new(py);
    fields.set_item("begin_s", stability.begin.seconds())?;
    fields.set_item("end_s", stability.end.seconds())?;
    fields.set_item("step_s", stability.step_s)?;
    let of = |axes: &[AxisStability; 3]| {
        let axes = axes.iter().map(|axis| {
            let points = found::deviations(py, &axis.points)?;
            PyTuple::new(py, [points, found::fit(py, &axis.fit, &axis.points)?])
        });
        let axes: PyResult<Vec<_>> = axes.collect();
        PyTuple::new(py, axes?)
    };
    fields.set_item("gyro", of(&stability.gyro)?)?;
    fields.set_item("accel", of(&stability.accel)?)?;
    found::make(py, "RestStability", &fields)
}
