//! Allan deviation.

use super::found;
use super::refusal::refused;
use crate::arrays::{Argument, counts};
use crate::failure::fail;
use crate::interrupt::interruptible;
use insnav_core::noise::{self, AllanPoint, averaging_samples};
use pyo3::prelude::*;

/// Averaging times to a doubling, where none are given: a fit uses two of them.
const PER_OCTAVE: usize = 2;

/// Overlapping Allan deviation of a sensor's samples at equal steps.
///
/// Parameters
/// ----------
/// x : (n,)
///     The record, in any unit: a gyro's rate, an accelerometer's specific force.
/// step_s : float
///     Step between samples, s.
/// samples : (k,) of int, optional
///     How many samples to average over, for each averaging time. Without it two averaging times to a doubling, up to a quarter of the
///     record.
///
/// Returns
/// -------
/// AllanDeviation
///     Deviations in the unit of the record.
#[pyfunction]
#[pyo3(signature = (x, step_s, samples=None))]
pub(crate) fn overlapping_allan<'py>(
    x: &Bound<'py, PyAny>,
    step_s: f64,
    #[pyo3(from_py_with = counts::samples)] samples: Option<Vec<usize>>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = x.py();
    let fail = fail(py);
    let argument = Argument::new("x", x);
    let record = argument.column(None).map_err(fail)?;
    if let Some(row) = record.iter().position(|v| !v.is_finite()) {
        let remedy = "cut the record where samples are missing: an average must not span a gap";
        return Err(fail(argument.not_finite(Some(row), remedy)));
    }
    let averaged = samples.unwrap_or_else(|| averaging_samples(record.len(), PER_OCTAVE));
    let points = interruptible(py, move |_| {
        noise::overlapping_allan(&record, step_s, &averaged)
    })?
    .map_err(|e| fail(refused(e)))?;
    found::deviations(py, &points)
}

/// Fit white noise N, flicker noise B and random walk K to Allan deviations: N²/τ + (2 ln 2/π) B² + K² τ/3.
///
/// Neighbouring averaging times share their data, so they are weighted by their whole covariance under the fit. The shortest times
/// are left out until the fit is good.
///
/// Parameters
/// ----------
/// deviation : AllanDeviation
///     What :func:`overlapping_allan` returned: five averaging times or more.
///
/// Returns
/// -------
/// AllanFit
///     Coefficients with their standard errors, and what the fit is worth.
#[pyfunction]
#[pyo3(signature = (deviation))]
pub(crate) fn fit_allan<'py>(deviation: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let py = deviation.py();
    let fail = fail(py);
    let column = |name: &str, rows: Option<usize>| -> PyResult<Vec<f64>> {
        Argument::new(&format!("deviation.{name}"), &deviation.getattr(name)?)
            .column(rows)
            .map_err(fail)
    };
    let tau = column("tau_s", None)?;
    let rows = Some(tau.len());
    let (samples, values) = (column("samples", rows)?, column("deviation", rows)?);
    let differences = column("differences", rows)?;
    let points: Vec<AllanPoint> = (0..tau.len())
        .map(|i| AllanPoint {
            tau_s: tau[i],
            samples: samples[i] as usize,
            deviation: values[i],
            differences: differences[i] as usize,
        })
        .collect();
    let told = points.clone();
    let fit = interruptible(py, move |_| noise::fit_allan(&told))?.map_err(|e| fail(refused(e)))?;
    found::fit(py, &fit, &points)
}
