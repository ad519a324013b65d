//! Methods for comparison, as published: a window of innovations, and a recursion that forgets.

use super::arguments::MOST_SUMS;
use super::refusal::{refusal, refused};
use crate::arrays::{Argument, matrix, square_stack};
use crate::failure::{Failure, fail};
use crate::interrupt::Signals;
use crate::pickle;
use insnav_core::noise::{ForgettingNoise, InnovationWindow};
use nalgebra::DMatrix;
use pyo3::prelude::*;
use pyo3::types::{PyTuple, PyType};

/// Mean of nu nuᵀ over a window of the last innovations, and the Q or R that Mohamed and Schwarz make of it.
///
/// A method to compare with, not one to use: Q and R cannot both come from one covariance, and Q has the rank of the measurement.
/// :func:`als_estimate` uses the covariances at all lags, which do tell the two apart.
///
/// Parameters
/// ----------
/// channels : int
///     Components of an innovation.
/// window : int
///     Innovations in the window.
///
/// Notes
/// -----
/// [MohamedSchwarz99].
#[pyclass(module = "insnav.noise")]
pub(crate) struct MohamedSchwarz(InnovationWindow);

#[pymethods]
impl MohamedSchwarz {
    #[new]
    fn new(py: Python<'_>, channels: usize, window: usize) -> PyResult<Self> {
        // Before memory is asked for.
        if channels.saturating_mul(channels).saturating_mul(window) > MOST_SUMS {
            return Err(Failure::argument(
                "bad_option",
                "window",
                format!("{window} of {channels} channels"),
                format!("at most {MOST_SUMS} sums"),
                "a shorter window or fewer channels",
            )
            .into_py_err(py));
        }
        InnovationWindow::new(channels, window)
            .map(MohamedSchwarz)
            .map_err(|e| refused(e).into_py_err(py))
    }

    /// Take an innovation, shape (p,); for :meth:`measurement_noise_of_residuals` a residual after the update.
    fn step(&mut self, nu: &Bound<'_, PyAny>) -> PyResult<()> {
        let py = nu.py();
        let fail = fail(py);
        let p = self.0.channels();
        let nu = Argument::new("nu", nu).column(Some(p)).map_err(fail)?;
        self.0.push(&nu).map_err(|e| fail(refused(e)))
    }

    /// Take innovations, shape (n, p), or (n,) of one channel.
    ///
    /// Returns the window's mean after each, shape (n, p, p), NaN until it is full. Other threads run meanwhile; an interruption (Ctrl-C)
    /// leaves the window as it was before.
    fn run<'py>(&mut self, nu: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let py = nu.py();
        let fail = fail(py);
        let p = self.0.channels();
        let (record, _) = Argument::new("nu", nu).channels(Some(p)).map_err(fail)?;
        let window = &self.0;
        let (next, means) = py.detach(|| -> PyResult<_> {
            let mut next = window.clone();
            let mut signals = Signals::of_long_rounds();
            let mut means = Vec::with_capacity(record.len() * p);
            for nu in record.chunks_exact(p) {
                signals.look()?;
                next.push(nu).map_err(refusal)?;
                match next.covariance() {
                    Some(mean) => means.extend_from_slice(mean.as_slice()),
                    None => means.extend(std::iter::repeat_n(f64::NAN, p * p)),
                }
            }
            Ok((next, means))
        })?;
        self.0 = next;
        square_stack(py, &means, p)
    }

    /// Mean of nu nuᵀ over the window, shape (p, p); None until it is full.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.0.covariance().map(|c| matrix(py, &c)).transpose()
    }

    /// Q = L C Lᵀ of the whole state, shape (n, n), with the gain L (n, p); None until the window is full.
    #[allow(non_snake_case)]
    fn process_noise<'py>(&self, L: &Bound<'py, PyAny>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let py = L.py();
        let fail = fail(py);
        let gain = Argument::new("L", L)
            .matrix(None, Some(self.0.channels()))
            .map_err(fail)?;
        let found = self.0.process_noise(&gain).map_err(|e| fail(refused(e)))?;
        found.map(|q| matrix(py, &q)).transpose()
    }

    /// R = C - H P Hᵀ of innovations, P (n, n) of the prediction: as published, may be indefinite. None until the window is full.
    #[allow(non_snake_case)]
    fn measurement_noise<'py>(
        &self,
        H: &Bound<'py, PyAny>,
        P: &Bound<'py, PyAny>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.noise(H, P, InnovationWindow::measurement_noise)
    }

    /// R = C + H P Hᵀ, where the window holds residuals after the update and P (n, n) is that of the update. None until it is full.
    #[allow(non_snake_case)]
    fn measurement_noise_of_residuals<'py>(
        &self,
        H: &Bound<'py, PyAny>,
        P: &Bound<'py, PyAny>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        self.noise(H, P, InnovationWindow::measurement_noise_of_residuals)
    }

    fn __repr__(&self) -> String {
        let (p, w) = (self.0.channels(), self.0.length());
        format!("<insnav.noise.MohamedSchwarz: {p} channels, a window of {w}>")
    }

    #[classmethod]
    fn _from_state(_class: &Bound<'_, PyType>, state: &[u8]) -> PyResult<Self> {
        pickle::load::<Self, _>(state).map(MohamedSchwarz)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        pickle::reduce(slf, &slf.borrow().0)
    }
}

/// R of a window by one of the two formulas.
type OfWindow = fn(
    &InnovationWindow,
    &DMatrix<f64>,
    &DMatrix<f64>,
) -> Result<Option<DMatrix<f64>>, insnav_core::noise::Refusal>;

impl MohamedSchwarz {
    fn noise<'py>(
        &self,
        h: &Bound<'py, PyAny>,
        p: &Bound<'py, PyAny>,
        formula: OfWindow,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        let py = h.py();
        let fail = fail(py);
        let h = Argument::new("H", h)
            .matrix(Some(self.0.channels()), None)
            .map_err(fail)?;
        let n = h.ncols();
        let p = Argument::new("P", p)
            .matrix(Some(n), Some(n))
            .map_err(fail)?;
        let found = formula(&self.0, &h, &p).map_err(|e| fail(refused(e)))?;
        found.map(|r| matrix(py, &r)).transpose()
    }
}

/// The recursion Q ← t Q + (1 - t) L nu nuᵀ Lᵀ: a method to compare with, not one to use.
///
/// A t of 0.3 remembers one and a half samples, so that Q follows single innovations; what comes out is that of the whole state.
///
/// Parameters
/// ----------
/// Q : (n, n)
///     Covariance of the process noise of a step that it begins with.
/// retention : float, default 0.3
///     t, the share that is kept at each step.
///
/// Notes
/// -----
/// [Belokurov18].
#[pyclass(module = "insnav.noise")]
pub(crate) struct ForgettingProcessNoise(ForgettingNoise);

#[pymethods]
impl ForgettingProcessNoise {
    #[new]
    #[pyo3(signature = (Q, *, retention=0.3))]
    #[allow(non_snake_case)]
    fn new(Q: &Bound<'_, PyAny>, retention: f64) -> PyResult<Self> {
        let fail = fail(Q.py());
        let process = Argument::new("Q", Q).square().map_err(fail)?;
        if !(0.0..=1.0).contains(&retention) {
            return Err(fail(Failure::argument(
                "bad_option",
                "retention",
                format!("{retention}"),
                "between 0 and 1",
                "",
            )));
        }
        Ok(ForgettingProcessNoise(ForgettingNoise {
            retention,
            process,
        }))
    }

    /// Take an innovation, shape (p,), with the gain L (n, p) that it was used with.
    #[allow(non_snake_case)]
    fn step(&mut self, L: &Bound<'_, PyAny>, nu: &Bound<'_, PyAny>) -> PyResult<()> {
        let py = nu.py();
        let fail = fail(py);
        let nu = Argument::new("nu", nu).column(None).map_err(fail)?;
        let gain = Argument::new("L", L)
            .matrix(Some(self.0.process.nrows()), Some(nu.len()))
            .map_err(fail)?;
        self.0.push(&gain, &nu).map_err(|e| fail(refused(e)))
    }

    /// Take innovations, shape (n, p), or (n,) of one channel, with one gain or as many: (n, p) or (N, n, p). Returns Q after each, shape (N, n, n).
    #[allow(non_snake_case)]
    fn run<'py>(
        &mut self,
        L: &Bound<'py, PyAny>,
        nu: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = nu.py();
        let fail = fail(py);
        let (record, p) = Argument::new("nu", nu).channels(None).map_err(fail)?;
        let n = self.0.process.nrows();
        let gains = Argument::new("L", L)
            .matrix_or_stack(record.len() / p, Some(n), Some(p))
            .map_err(fail)?;
        let mut next = self.0.clone();
        let found = py.detach(|| -> PyResult<_> {
            let mut signals = Signals::of_long_rounds();
            let mut found = Vec::with_capacity(gains.len() * n * n);
            for (gain, nu) in gains.iter().zip(record.chunks_exact(p)) {
                signals.look()?;
                next.push(gain, nu).map_err(refusal)?;
                found.extend_from_slice(next.process.as_slice());
            }
            Ok(found)
        })?;
        self.0 = next;
        square_stack(py, &found, n)
    }

    /// Covariance of the process noise of a step, of the whole state, shape (n, n).
    #[getter]
    #[allow(non_snake_case)]
    fn Q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        matrix(py, &self.0.process)
    }

    /// t, the share that is kept at each step.
    #[getter]
    fn retention(&self) -> f64 {
        self.0.retention
    }

    #[classmethod]
    fn _from_state(_class: &Bound<'_, PyType>, state: &[u8]) -> PyResult<Self> {
        pickle::load::<Self, _>(state).map(ForgettingProcessNoise)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        pickle::reduce(slf, &slf.borrow().0)
    }
}
