//! What was found, as the classes of `insnav._align`: those are written in Python, so that they can be pickled.

use crate::arrays::{bools, matrix, scalars};
use insnav_core::alignment::{AlignmentMethod, AlignmentResult, StopReport, Taper};
use nalgebra::{DMatrix, UnitQuaternion, Vector3};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

/// One of the classes of `insnav._align`, by the names of its fields.
pub(super) fn make<'py>(
    py: Python<'py>,
    class: &str,
    fields: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyAny>> {
    py.import("insnav._align")?
        .getattr(class)?
        .call((), Some(fields))
}

pub(super) fn vector<'py>(py: Python<'py>, v: &Vector3<f64>) -> PyResult<Bound<'py, PyAny>> {
    scalars(py, v.iter().copied())
}

pub(super) fn quaternion<'py>(
    py: Python<'py>,
    q: &UnitQuaternion<f64>,
) -> PyResult<Bound<'py, PyAny>> {
    scalars(py, [q.w, q.i, q.j, q.k])
}

/// Degrees from 0 to 360.
pub(super) fn turns(angle: f64) -> f64 {
    angle.to_degrees().rem_euclid(360.0)
}

/// `insnav.align.Alignment`; `summary` is the command's report where it was asked.
pub(super) fn alignment<'py>(
    py: Python<'py>,
    found: &AlignmentResult,
    summary: Option<Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyDict::new(py);
    let (euler, sigma) = (found.euler(), found.sigma());
    // Levelling knows a heading only when it is told.
    let north = found.method != AlignmentMethod::Levelling || found.azimuth.is_some();
    let three = |at: usize, factor: f64| scalars(py, (0..3).map(|i| sigma[at + i] * factor));
    fields.set_item("method", found.method.name())?;
    fields.set_item("reason", &found.reason)?;
    fields.set_item("at_s", found.at.seconds())?;
    fields.set_item("quaternion_nb_wxyz", quaternion(py, &found.q_nb)?)?;
    fields.set_item("roll_deg", euler.roll.to_degrees())?;
    fields.set_item("pitch_deg", euler.pitch.to_degrees())?;
    fields.set_item("heading_deg", north.then(|| turns(euler.heading)))?;
    fields.set_item("sigma_attitude_n_deg", three(0, 1f64.to_degrees())?)?;
    fields.set_item("sigma_azimuth_deg", found.azimuth_sigma.to_degrees())?;
    fields.set_item("azimuth_deg", found.azimuth.map(turns))?;
    fields.set_item("gyro_bias_rad_per_s", vector(py, &found.gyro_bias)?)?;
    fields.set_item("sigma_gyro_bias_rad_per_s", three(3, 1.0)?)?;
    fields.set_item("accel_bias_m_per_s2", vector(py, &found.accel_bias)?)?;
    fields.set_item("sigma_accel_bias_m_per_s2", three(6, 1.0)?)?;
    let covariance = DMatrix::from_fn(9, 9, |i, j| found.covariance[(i, j)]);
    fields.set_item("covariance", matrix(py, &covariance)?)?;
    fields.set_item("observable", bools(py, found.observable)?)?;
    fields.set_item("weakest", scalars(py, found.weakest.iter().copied())?)?;
    fields.set_item("geometry_ratio", found.geometry_ratio)?;
    fields.set_item("norm_residual", found.norm_residual.map(<(f64, f64)>::from))?;
    fields.set_item("nis_ratio", found.nis_ratio)?;
    let stops = found.stops.iter().map(|s| stop(py, s));
    let stops: PyResult<Vec<_>> = stops.collect();
    fields.set_item("stops", PyTuple::new(py, stops?)?)?;
    fields.set_item("summary", summary)?;
    make(py, "Alignment", &fields)
}

fn stop<'py>(py: Python<'py>, seen: &StopReport) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyDict::new(py);
    fields.set_item("begin_s", seen.begin.seconds())?;
    fields.set_item("end_s", seen.end.seconds())?;
    fields.set_item("rate_n_rad_per_s", vector(py, &seen.rate_n)?)?;
    fields.set_item(
        "residual_rate_n_rad_per_s",
        vector(py, &seen.residual_rate_n)?,
    )?;
    fields.set_item("sigma_rate_rad_per_s", vector(py, &seen.sigma_rate)?)?;
    fields.set_item("quaternion_nb_wxyz", quaternion(py, &seen.q_nb)?)?;
    let rocking = seen.rocking_rms.map(f64::to_degrees);
    fields.set_item("rocking_rms_deg", vector(py, &rocking)?)?;
    fields.set_item("rocking_period_s", seen.rocking_period_s)?;
    fields.set_item("velocity_rms_m_per_s", seen.velocity_rms)?;
    fields.set_item("taper", taper_name(seen.taper))?;
    fields.set_item("half_disagreement_sigma", seen.half_disagreement)?;
    make(py, "AlignmentStop", &fields)
}

pub(super) fn taper_name(taper: Taper) -> &'static str {
    match taper {
        Taper::None => "none",
        Taper::HannSquared => "hann_squared",
    }
}
