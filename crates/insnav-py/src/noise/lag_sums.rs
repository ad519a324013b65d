//! Lag covariances of innovations that come one at a time.

use super::arguments::{self, MOST_SUMS};
use super::refusal::{refusal, refused};
use crate::arrays::{Argument, counts, scalars, square_stack};
use crate::failure::{Failure, fail};
use crate::interrupt::Signals;
use crate::pickle;
use insnav_core::noise::LagSums;
use pyo3::prelude::*;
use pyo3::types::{PyTuple, PyType};

/// Lag covariances of innovations as they come: sums of products nu[k + j] nu[k]ᵀ, which do not grow with the record.
///
/// The innovations must come from one filter with a constant gain, after its transient; their mean is taken to be zero. One that is not
/// finite ends the run, so that no product spans it.
///
/// Parameters
/// ----------
/// channels : int
///     Components of an innovation.
/// lags : int
///     Number of lags.
/// retention : float, default 1
///     Factor that products lose with each sample: 1 - 1/n remembers about n, 1 everything.
///
/// Examples
/// --------
/// >>> from insnav import noise
/// >>> sums = noise.LagAccumulator(1, 2)
/// >>> for nu in (1.0, 2.0, 4.0):
/// ...     sums.step([nu])
/// >>> sums.covariance[:, 0, 0].tolist(), sums.counts.tolist()
/// ([7.0, 5.0], [3.0, 2.0])
#[pyclass(module = "insnav.noise")]
pub(crate) struct LagAccumulator(LagSums);

#[pymethods]
impl LagAccumulator {
    #[new]
    #[pyo3(signature = (channels, lags, *, retention=1.0))]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = counts::channels)] channels: usize,
        #[pyo3(from_py_with = counts::lags)] lags: usize,
        retention: f64,
    ) -> PyResult<Self> {
        let sizes = arguments::lags(lags).and_then(|lags| {
            // Before memory is asked for: as many sums as a record could fill at most.
            let fits = channels.saturating_mul(channels).saturating_mul(lags) <= MOST_SUMS;
            match fits {
                true => Ok(lags),
                false => Err(Failure::argument(
                    "bad_option",
                    "channels",
                    format!("{channels} with {lags} lags"),
                    format!("at most {MOST_SUMS} sums"),
                    "fewer lags or channels",
                )),
            }
        });
        let lags = sizes.map_err(fail(py))?;
        LagSums::new(channels, lags, retention)
            .map(LagAccumulator)
            .map_err(|e| refused(e).into_py_err(py))
    }

    /// Take the next innovation, shape (p,).
    fn step(&mut self, nu: &Bound<'_, PyAny>) -> PyResult<()> {
        let py = nu.py();
        let fail = fail(py);
        let p = self.0.channels();
        let nu = Argument::new("nu", nu).column(Some(p)).map_err(fail)?;
        self.0.push(&nu).map_err(|e| fail(refused(e)))
    }

    /// Take innovations, shape (n, p), or (n,) of one channel: the same as so many steps, bit for bit. Other threads run meanwhile.
    ///
    /// An interruption (Ctrl-C) leaves the sums as they were before.
    fn run(&mut self, nu: &Bound<'_, PyAny>) -> PyResult<()> {
        let py = nu.py();
        let fail = fail(py);
        let p = self.0.channels();
        let (record, _) = Argument::new("nu", nu).channels(Some(p)).map_err(fail)?;
        let sums = &self.0;
        self.0 = py.detach(|| -> PyResult<_> {
            let mut next = sums.clone();
            let mut signals = Signals::of_long_rounds();
            for nu in record.chunks_exact(p) {
                signals.look()?;
                next.push(nu).map_err(refusal)?;
            }
            Ok(next)
        })?;
        Ok(())
    }

    /// The next sample does not follow the last one: a gap, another log, a change of the gain.
    fn end_run(&mut self) {
        self.0.end_run();
    }

    /// Add what another of the same sizes has gathered.
    fn merge(&mut self, other: &Self) -> PyResult<()> {
        self.0
            .merge(&other.0)
            .map_err(|e| Python::attach(|py| refused(e).into_py_err(py)))
    }

    /// Means of the products: C[j] of nu[k + j] nu[k]ᵀ, shape (lags, p, p); zero before the first product of a lag.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        square_stack(py, &self.0.covariances(), self.0.channels())
    }

    /// Of how many products of full weight each mean is as good as, shape (lags,).
    #[getter]
    fn counts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        scalars(py, self.0.counts())
    }

    fn __repr__(&self) -> String {
        let (p, lags) = (self.0.channels(), self.0.lags());
        let count = self.0.counts().first().copied().unwrap_or(0.0);
        format!("<insnav.noise.LagAccumulator: {p} channels, {lags} lags, {count:.0} samples>")
    }

    #[classmethod]
    fn _from_state(_class: &Bound<'_, PyType>, state: &[u8]) -> PyResult<Self> {
        pickle::load::<Self, _>(state).map(LagAccumulator)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        pickle::reduce(slf, &slf.borrow().0)
    }
}
