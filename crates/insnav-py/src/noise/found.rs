//! What was found, as the classes of `insnav._noise`: those are written in Python, so that they can be pickled.

use crate::arrays::{matrix, rows, scalars};
use insnav_core::noise::{AllanFit, AllanPoint, AllanTerm, Estimate, Verdict};
use nalgebra::DMatrix;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

/// One of the classes of `insnav._noise`, by the names of its fields.
pub(super) fn make<'py>(
    py: Python<'py>,
    class: &str,
    fields: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyAny>> {
    py.import("insnav._noise")?
        .getattr(class)?
        .call((), Some(fields))
}

/// `insnav.noise.Estimate`; gain and θ of each round where it was filtered.
pub(super) fn estimate<'py>(
    py: Python<'py>,
    found: &Estimate,
    filtered: Option<(&DMatrix<f64>, &[Vec<f64>])>,
) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyDict::new(py);
    fields.set_item("names", PyTuple::new(py, &found.names)?)?;
    fields.set_item("theta", scalars(py, found.theta.iter().copied())?)?;
    fields.set_item("se", scalars(py, found.standard_errors.iter().copied())?)?;
    fields.set_item("covariance", matrix(py, &found.covariance)?)?;
    let verdicts = found.verdicts.iter().map(|v| match v {
        Verdict::Estimated => "estimated",
        Verdict::OnBound => "on_bound",
        Verdict::Known => "known",
        Verdict::Held => "held",
    });
    fields.set_item("verdicts", PyTuple::new(py, verdicts)?)?;
    fields.set_item("Q", matrix(py, &found.q)?)?;
    fields.set_item("R", matrix(py, &found.r)?)?;
    fields.set_item("chi2", found.chi2)?;
    fields.set_item("dof", found.dof)?;
    fields.set_item("fits", found.fits())?;
    let hidden = found.not_identified().map(|i| found.names[i].as_str());
    let hidden: Vec<&str> = hidden.collect();
    fields.set_item("not_identified", PyTuple::new(py, hidden)?)?;
    fields.set_item("rank", found.rank)?;
    fields.set_item("cond", found.condition)?;
    fields.set_item("weakest", PyTuple::new(py, &found.weakest)?)?;
    fields.set_item("iters", found.reweights)?;
    if let Some((gain, rounds)) = filtered {
        let k = found.theta.len();
        let history = DMatrix::from_fn(rounds.len(), k, |i, j| rounds[i][j]);
        fields.set_item("gain", matrix(py, gain)?)?;
        fields.set_item("rounds", matrix(py, &history)?)?;
    }
    make(py, "Estimate", &fields)
}

/// `insnav.noise.AllanDeviation`.
pub(super) fn deviations<'py>(
    py: Python<'py>,
    points: &[AllanPoint],
) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyDict::new(py);
    fields.set_item("tau_s", scalars(py, points.iter().map(|p| p.tau_s))?)?;
    fields.set_item(
        "samples",
        scalars(py, points.iter().map(|p| p.samples as i64))?,
    )?;
    fields.set_item(
        "deviation",
        scalars(py, points.iter().map(|p| p.deviation))?,
    )?;
    fields.set_item(
        "differences",
        scalars(py, points.iter().map(|p| p.differences as i64))?,
    )?;
    make(py, "AllanDeviation", &fields)
}

/// `insnav.noise.AllanFit`, with what it says at the points.
pub(super) fn fit<'py>(
    py: Python<'py>,
    found: &AllanFit,
    points: &[AllanPoint],
) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyDict::new(py);
    let term = |t: AllanTerm| (t.value, t.standard_error);
    for (name, (value, error)) in [
        ("white", term(found.white)),
        ("flicker", term(found.flicker)),
        ("random_walk", term(found.random_walk)),
    ] {
        fields.set_item(name, value)?;
        fields.set_item(format!("{name}_se"), error)?;
    }
    fields.set_item("chi2", found.chi2)?;
    fields.set_item("dof", found.dof)?;
    fields.set_item("from_tau_s", found.from_tau_s)?;
    let fitted = points.iter().map(|p| found.deviation(p.tau_s));
    fields.set_item("fitted", scalars(py, fitted)?)?;
    let parts = points.iter().map(|p| found.parts(p.tau_s));
    fields.set_item("parts", rows(py, parts)?)?;
    let intervals = points
        .iter()
        .map(|p| <[f64; 2]>::from(p.interval(found, 1.0)));
    fields.set_item("interval", rows(py, intervals)?)?;
    make(py, "AllanFit", &fields)
}
