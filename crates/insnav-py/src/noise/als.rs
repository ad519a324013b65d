//! Autocovariance least squares, its parts and its relatives.

use super::arguments::{Solving, basis, known, lags as checked, model, rounds, runs};
use super::found;
use super::refusal::refused;
use crate::arrays::{Argument, counts, matrix, scalars, square_stack};
use crate::failure::fail;
use crate::interrupt::interruptible;
use crate::named::Named;
use crate::pickle;
use insnav_core::noise::{
    self, EstimateOptions, LagCovariance, MdmOptions, Step, measurements_of_innovations,
};
use nalgebra::DMatrix;
use pyo3::prelude::*;
use pyo3::types::{PyTuple, PyType};

/// What each unknown adds to the lag covariances of innovations; :func:`als_design` makes it.
#[pyclass(frozen, module = "insnav.noise")]
pub(crate) struct Design {
    inner: noise::Design,
}

#[pymethods]
impl Design {
    fn __repr__(&self) -> String {
        let (lags, p, k) = (
            self.inner.lags(),
            self.inner.channels(),
            self.inner.basis().len(),
        );
        format!("<insnav.noise.Design: {lags} lags, {p} channels, {k} unknowns>")
    }

    /// A, shape (lags * p * p, k): ``(A @ theta).reshape(lags, p, p)`` are the lag covariances of the model.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let p = self.inner.channels();
        let columns = self.inner.columns();
        // The core has the columns of each lag one after the other, numpy the rows.
        let by_rows = DMatrix::from_fn(columns.nrows(), columns.ncols(), |row, i| {
            let (lag, a, b) = (row / (p * p), row / p % p, row % p);
            columns[((lag * p + b) * p + a, i)]
        });
        matrix(py, &by_rows)
    }

    /// Names of the unknowns, in the order of theta: ``"Q[0,0]"``, …, ``"R[0,0]"``, ….
    #[getter]
    fn names<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let unknowns = self.inner.basis().unknowns();
        PyTuple::new(py, unknowns.iter().map(|u| u.name.as_str()))
    }

    /// Number of lags.
    #[getter]
    fn lags(&self) -> usize {
        self.inner.lags()
    }

    #[classmethod]
    fn _from_state(_class: &Bound<'_, PyType>, state: &[u8]) -> PyResult<Self> {
        pickle::load::<Self, _>(state).map(|inner| Design { inner })
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        pickle::reduce(slf, &slf.get().inner)
    }
}

/// Lag covariances of innovations: C[j] is the mean of nu[k + j] nu[k]ᵀ, for j = 0 … lags - 1.
///
/// The innovations must be those of a filter with a constant gain, after its transient; their mean is taken to be zero.
///
/// Parameters
/// ----------
/// nu : (N, p) or (N,)
///     Innovations.
/// lags : int
///     Number of lags.
/// runs : (k, 2) of int, optional
///     Contiguous pieces: for each its first row and the one after its last. No product spans two. Without it all of ``nu`` is one.
///
/// Returns
/// -------
/// C : (lags, p, p)
///     Lag covariances.
/// counts : (lags,)
///     How many products each is the mean of.
#[pyfunction]
#[pyo3(signature = (nu, lags, runs=None))]
pub(crate) fn lag_covariance<'py>(
    nu: &Bound<'py, PyAny>,
    #[pyo3(from_py_with = counts::lags)] lags: usize,
    runs: Option<&Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let py = nu.py();
    let fail = fail(py);
    let (record, p) = Argument::new("nu", nu).channels(None).map_err(fail)?;
    let lags = checked(lags).map_err(fail)?;
    let runs = self::runs(record, p, runs).map_err(fail)?;
    let found = interruptible(py, move |_| noise::lag_covariance(&runs.pieces(), p, lags))?
        .map_err(|e| fail(refused(e)))?;
    Ok((
        square_stack(py, found.values(), p)?,
        scalars(py, found.counts().iter().copied())?,
    ))
}

/// What each unknown adds to the lag covariances of the innovations of a filter with a constant gain.
///
/// x₊ = F x + G w, y = H x + v with white w (covariance Q per step) and v (R); the filter corrects its prediction by L times the
/// innovation. Neither Q nor R is needed, nor need L be the gain of any.
///
/// Parameters
/// ----------
/// F : (n, n)
///     Transition over one step.
/// G : (n, g)
///     Where the process noise enters.
/// H : (p, n)
///     What is measured.
/// L : (n, p)
///     Gain that corrects the predicted state (not the predictor's F L). F - F L H must be stable.
/// basis : str or mapping, optional
///     What is unknown: ``"diagonal"`` (the same as None) or ``"symmetric"`` Q and R, or ``{"Q": form, "R": form}``, where a form is
///     one of these words, a list of groups of components that share a variance (``[[0, 1, 2]]``), or matrices of shape (k, m, m) whose factors are unknown.
/// lags : int, default 64
///     Number of lags.
///
/// Returns
/// -------
/// Design
///     Its ``matrix`` is A, with ``A @ theta`` equal to ``C.ravel()`` of :func:`lag_covariance` but for chance.
#[pyfunction]
#[pyo3(signature = (F, G, H, L, basis=None, lags=64))]
// Matrices have the names of the books.
#[allow(non_snake_case)]
pub(crate) fn als_design<'py>(
    F: &Bound<'py, PyAny>,
    G: &Bound<'py, PyAny>,
    H: &Bound<'py, PyAny>,
    L: &Bound<'py, PyAny>,
    basis: Option<&Bound<'py, PyAny>>,
    #[pyo3(from_py_with = counts::lags)] lags: usize,
) -> PyResult<Design> {
    let py = F.py();
    let fail = fail(py);
    let model = model(F, G, H).map_err(fail)?;
    let (n, p) = (model.states(), model.channels());
    let gain = Argument::new("L", L)
        .matrix(Some(n), Some(p))
        .map_err(fail)?;
    let basis = self::basis(basis, model.g.ncols(), p)?;
    let lags = checked(lags).map_err(fail)?;
    let inner = interruptible(py, move |_| noise::als_design(&model, &gain, &basis, lags))?
        .map_err(|e| fail(refused(e)))?;
    Ok(Design { inner })
}

/// Estimate the unknowns of a design from measured lag covariances.
///
/// Standard errors and chi2 are for Gaussian noise, by Bartlett's formula at the estimate, whichever weight is used.
///
/// Parameters
/// ----------
/// design : Design
///     What :func:`als_design` returned.
/// C : (lags, p, p)
///     Lag covariances.
/// counts : (lags,)
///     How many products each is the mean of.
/// weight : {"bartlett", "identity"}
///     By the inverse of their covariance at the estimate, or all alike.
/// constraint : {"nonnegative", "psd", "none"}
///     No factor negative (variances), Q and R positive semidefinite (bases with covariances), or nothing.
/// known : mapping, optional
///     Values of unknowns that are known, by name: ``{"Q[1,1]": 1e-12}``.
/// reweights : int, default 2
///     How often the Bartlett weight is taken anew at the estimate.
/// least_independent : float, default 10
///     The least number of independent products at each lag.
/// trace_penalty : float, default 0
///     Penalty on trace(Q), for a process noise of low rank. Biases what it penalises.
///
/// Returns
/// -------
/// Estimate
///     Q and R with standard errors and a test of the model.
///
/// Raises
/// ------
/// InsnavError
///     ``rank_deficient`` names the unknowns that the lags cannot tell; ``too_short``.
#[pyfunction]
#[pyo3(signature = (
    design, C, counts, *, weight="bartlett", constraint="nonnegative", known=None, reweights=2, least_independent=10.0,
    trace_penalty=0.0
))]
// One argument each of the Python function.
#[allow(non_snake_case, clippy::too_many_arguments)]
pub(crate) fn als_solve<'py>(
    design: &Bound<'py, Design>,
    C: &Bound<'py, PyAny>,
    counts: &Bound<'py, PyAny>,
    weight: &str,
    constraint: &str,
    known: Option<Named<f64>>,
    #[pyo3(from_py_with = counts::reweights)] reweights: usize,
    least_independent: f64,
    trace_penalty: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let py = C.py();
    let fail = fail(py);
    let shared = design.clone().unbind();
    let design = &design.get().inner;
    let (p, lags) = (design.channels(), design.lags());
    let covariances = Argument::new("C", C).square_stack(lags, p).map_err(fail)?;
    let counts = Argument::new("counts", counts)
        .column(Some(lags))
        .map_err(fail)?;
    let covariance = LagCovariance::new(p, covariances, counts).map_err(|e| fail(refused(e)))?;
    let options = Solving {
        weight,
        constraint,
        known,
        reweights,
        least_independent,
        trace_penalty,
    }
    .options(design.basis())
    .map_err(fail)?;
    let work = move |_: &_| noise::als_solve(&shared.get().inner, &covariance, &options);
    let found = interruptible(py, work)?.map_err(|e| fail(refused(e)))?;
    found::estimate(py, &found, None)
}

/// Estimate the noise of a linear model from measurements, by autocovariance least squares.
///
/// x₊ = F x + G w, y = H x + v. Each round makes the stationary filter of the estimate before, filters the record with it, and solves anew:
/// at the true gain the lag covariances tell most. Other threads run meanwhile.
///
/// Parameters
/// ----------
/// y : (N, p) or (N,)
///     Measurements, the response to known inputs taken out; with ``gain`` innovations.
/// F, G, H : (n, n), (n, g), (p, n)
///     The model, as of :func:`als_design`.
/// start : (k,)
///     Values of the unknowns for the first gain: a data sheet's, or a guess a hundred times off.
/// basis : str or mapping, optional
///     What is unknown, as of :func:`als_design`. Of diagonal Q and R: the variances of Q, then those of R.
/// lags : int, default 64
///     Number of lags.
/// rounds : int, default 3
///     How often the record is filtered.
/// skip : int, default 0
///     Samples at the begin of each run that are left out. The initial state is fitted, so that there is next to no transient.
/// runs : (k, 2) of int, optional
///     Contiguous pieces, as of :func:`lag_covariance`.
/// gain : (n, p), optional
///     ``y`` are the innovations of a filter with this constant gain.
/// hold_unidentified : bool, default True
///     Keep what the data do not identify (standard error above the value) at its start value, if they do not contradict that.
/// weight, constraint, known, reweights, least_independent, trace_penalty
///     As of :func:`als_solve`.
///
/// Returns
/// -------
/// Estimate
///     With the ``gain`` of the filter for the estimate, and theta after each of the ``rounds``.
///
/// Raises
/// ------
/// InsnavError
///     ``flat_channel``, ``saturated_channel``, ``unstable_filter`` (no stationary filter for this start), ``rank_deficient``, ``too_short``.
#[pyfunction]
#[pyo3(signature = (
    y, F, G, H, start, *, basis=None, lags=64, rounds=3, skip=0, runs=None, gain=None, hold_unidentified=true, weight="bartlett",
    constraint="nonnegative", known=None, reweights=2, least_independent=10.0, trace_penalty=0.0
))]
// One argument each of the Python function.
#[allow(non_snake_case, clippy::too_many_arguments)]
pub(crate) fn als_estimate<'py>(
    y: &Bound<'py, PyAny>,
    F: &Bound<'py, PyAny>,
    G: &Bound<'py, PyAny>,
    H: &Bound<'py, PyAny>,
    start: &Bound<'py, PyAny>,
    basis: Option<&Bound<'py, PyAny>>,
    #[pyo3(from_py_with = counts::lags)] lags: usize,
    #[pyo3(from_py_with = counts::rounds)] rounds: usize,
    #[pyo3(from_py_with = counts::skip)] skip: usize,
    runs: Option<&Bound<'py, PyAny>>,
    gain: Option<&Bound<'py, PyAny>>,
    hold_unidentified: bool,
    weight: &str,
    constraint: &str,
    known: Option<Named<f64>>,
    #[pyo3(from_py_with = counts::reweights)] reweights: usize,
    least_independent: f64,
    trace_penalty: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let py = y.py();
    let fail = fail(py);
    let model = model(F, G, H).map_err(fail)?;
    let (n, p) = (model.states(), model.channels());
    let (record, _) = Argument::new("y", y).channels(Some(p)).map_err(fail)?;
    let basis = self::basis(basis, model.g.ncols(), p)?;
    let start = Argument::new("start", start)
        .column(Some(basis.len()))
        .map_err(fail)?;
    let gain = gain
        .map(|gain| Argument::new("gain", gain).matrix(Some(n), Some(p)))
        .transpose()
        .map_err(fail)?;
    let runs = self::runs(record, p, runs).map_err(fail)?;
    let options = EstimateOptions {
        lags: checked(lags).map_err(fail)?,
        rounds: self::rounds("rounds", rounds).map_err(fail)?,
        skip,
        hold_unidentified,
        solve: Solving {
            weight,
            constraint,
            known,
            reweights,
            least_independent,
            trace_penalty,
        }
        .options(&basis)
        .map_err(fail)?,
    };
    let work = move |_: &_| {
        let pieces = runs.pieces();
        let Some(gain) = &gain else {
            return noise::als_estimate(&pieces, &model, &basis, &start, &options);
        };
        let measured = pieces
            .iter()
            .map(|nu| measurements_of_innovations(&model, gain, nu))
            .collect::<Result<Vec<_>, _>>()?;
        let measured: Vec<&[f64]> = measured.iter().map(Vec::as_slice).collect();
        noise::als_estimate(&measured, &model, &basis, &start, &options)
    };
    let found = interruptible(py, work)?.map_err(|e| fail(refused(e)))?;
    found::estimate(
        py,
        &found.estimate,
        Some((&found.filter.gain, &found.rounds)),
    )
}

/// Estimate the noise of a model that changes from step to step, from the innovations of one run of its filter.
///
/// No stationarity is assumed. The record is not filtered again: for that run the filter anew with the estimate.
///
/// Parameters
/// ----------
/// F, G, H, L : (N, n, n), (N, n, g), (N, p, n), (N, n, p)
///     Of each step: the transition to the next, where its process noise enters, what is measured, the gain that corrected the
///     predicted state. A matrix alone, without N, is the same at all steps.
/// nu : (N, p) or (N,)
///     Innovations.
/// P0 : (n, n)
///     Covariance of the first prediction.
/// basis : str or mapping, optional
///     As of :func:`als_design`.
/// lags : int, default 64
///     Number of lags.
/// weight, constraint, known, reweights, least_independent, trace_penalty
///     As of :func:`als_solve`.
///
/// Returns
/// -------
/// Estimate
///     Q and R with standard errors and a test of the model.
#[pyfunction]
#[pyo3(signature = (
    F, G, H, L, nu, P0, *, basis=None, lags=64, weight="bartlett", constraint="nonnegative", known=None, reweights=2,
    least_independent=10.0, trace_penalty=0.0
))]
// One argument each of the Python function.
#[allow(non_snake_case, clippy::too_many_arguments)]
pub(crate) fn als_estimate_ltv<'py>(
    F: &Bound<'py, PyAny>,
    G: &Bound<'py, PyAny>,
    H: &Bound<'py, PyAny>,
    L: &Bound<'py, PyAny>,
    nu: &Bound<'py, PyAny>,
    P0: &Bound<'py, PyAny>,
    basis: Option<&Bound<'py, PyAny>>,
    #[pyo3(from_py_with = counts::lags)] lags: usize,
    weight: &str,
    constraint: &str,
    known: Option<Named<f64>>,
    #[pyo3(from_py_with = counts::reweights)] reweights: usize,
    least_independent: f64,
    trace_penalty: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let py = nu.py();
    let fail = fail(py);
    let (innovations, p) = Argument::new("nu", nu).channels(None).map_err(fail)?;
    let count = innovations.len() / p;
    let initial = Argument::new("P0", P0).square().map_err(fail)?;
    let n = initial.nrows();
    let stack = |name: &str, object: &Bound<'py, PyAny>, rows: usize, columns: Option<usize>| {
        Argument::new(name, object)
            .matrix_or_stack(count, Some(rows), columns)
            .map_err(fail)
    };
    let f = stack("F", F, n, Some(n))?;
    let g = stack("G", G, n, None)?;
    let h = stack("H", H, p, Some(n))?;
    let gains = stack("L", L, n, Some(p))?;
    let basis = self::basis(basis, g.first().map_or(0, DMatrix::ncols), p)?;
    let lags = checked(lags).map_err(fail)?;
    let steps: Vec<Step> = f
        .into_iter()
        .zip(g)
        .zip(h)
        .zip(gains)
        .map(|(((f, g), h), gain)| Step { h, gain, f, g })
        .collect();
    let options = Solving {
        weight,
        constraint,
        known,
        reweights,
        least_independent,
        trace_penalty,
    }
    .options(&basis)
    .map_err(fail)?;
    let work = move |_: &_| {
        noise::als_estimate_ltv(&steps, &innovations, &initial, &basis, lags, &options)
    };
    let found = interruptible(py, work)?.map_err(|e| fail(refused(e)))?;
    found::estimate(py, &found, None)
}

/// Estimate the noise of a linear model from measurements alone, by the measurement-difference method.
///
/// No filter, no gain, no start value, any F: a start for :func:`als_estimate`, or a method for short records. Its standard errors are too
/// large, by up to the square root of the span.
///
/// Parameters
/// ----------
/// y : (N, p) or (N,)
///     Measurements, the response to known inputs taken out.
/// F, G, H : (n, n), (n, g), (p, n)
///     The model, as of :func:`als_design`.
/// basis : str or mapping, optional
///     As of :func:`als_design`.
/// span : int, default 50
///     Samples that are looked at together.
/// reweights : int, default 3
///     How often the weight is taken anew at the estimate.
/// known : mapping, optional
///     Values of unknowns that are known, by name.
/// runs : (k, 2) of int, optional
///     Contiguous pieces, as of :func:`lag_covariance`.
///
/// Returns
/// -------
/// Estimate
///     Q and R with standard errors.
#[pyfunction]
#[pyo3(signature = (y, F, G, H, *, basis=None, span=50, reweights=3, known=None, runs=None))]
// One argument each of the Python function.
#[allow(non_snake_case, clippy::too_many_arguments)]
pub(crate) fn mdm_estimate<'py>(
    y: &Bound<'py, PyAny>,
    F: &Bound<'py, PyAny>,
    G: &Bound<'py, PyAny>,
    H: &Bound<'py, PyAny>,
    basis: Option<&Bound<'py, PyAny>>,
    #[pyo3(from_py_with = counts::span)] span: usize,
    #[pyo3(from_py_with = counts::reweights)] reweights: usize,
    known: Option<Named<f64>>,
    runs: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = y.py();
    let fail = fail(py);
    let model = model(F, G, H).map_err(fail)?;
    let p = model.channels();
    let (record, _) = Argument::new("y", y).channels(Some(p)).map_err(fail)?;
    let basis = self::basis(basis, model.g.ncols(), p)?;
    let runs = self::runs(record, p, runs).map_err(fail)?;
    let options = MdmOptions {
        span,
        reweights: rounds("reweights", reweights).map_err(fail)?,
        known: self::known(known, &basis).map_err(fail)?,
    };
    let work = move |_: &_| noise::mdm_estimate(&runs.pieces(), &model, &basis, &options);
    let found = interruptible(py, work)?.map_err(|e| fail(refused(e)))?;
    found::estimate(py, &found, None)
}
