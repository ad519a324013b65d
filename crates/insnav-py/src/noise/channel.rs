//! The design of a channel with two states, in closed form.

use super::arguments;
use crate::arrays::{Argument, counts, matrix, scalars};
use crate::failure::{Failure, fail};
use crate::pickle;
use insnav_core::noise::ChannelColumns;
use nalgebra::{DMatrix, Matrix2, RowVector2, Vector2};
use pyo3::prelude::*;
use pyo3::types::{PyTuple, PyType};

/// Lag covariances of a channel with two states and one measurement, for the unknowns (q1, q2, r): the design in closed form.
///
/// Like an attitude angle and its gyro bias, F = [[1, -T], [0, φ]], H = [1, 0]. The same as :func:`als_design` of that model with
/// diagonal Q and R, a thousand times as fast.
///
/// Parameters
/// ----------
/// F : (2, 2)
///     Transition over one step.
/// H : (2,)
///     What is measured.
/// L : (2,)
///     Gain that corrects the predicted state.
/// lags : int, default 64
///     Number of lags, three or more.
///
/// Raises
/// ------
/// IdentificationError
///     F - F L H is not stable.
#[pyclass(frozen, module = "insnav.noise")]
pub(crate) struct ChannelDesign(ChannelColumns);

#[pymethods]
impl ChannelDesign {
    #[new]
    #[pyo3(signature = (F, H, L, *, lags=64))]
    #[allow(non_snake_case)]
    fn new(
        F: &Bound<'_, PyAny>,
        H: &Bound<'_, PyAny>,
        L: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = counts::lags)] lags: usize,
    ) -> PyResult<Self> {
        let py = F.py();
        let fail = fail(py);
        let f = Argument::new("F", F)
            .matrix(Some(2), Some(2))
            .map_err(fail)?;
        let h = Argument::new("H", H).column(Some(2)).map_err(fail)?;
        let gain = Argument::new("L", L).column(Some(2)).map_err(fail)?;
        let lags = arguments::lags(lags).map_err(fail)?;
        if lags < 3 {
            return Err(fail(Failure::argument(
                "bad_option",
                "lags",
                format!("{lags}"),
                "three or more",
                "three unknowns need three lags",
            )));
        }
        let f = Matrix2::from_fn(|i, j| f[(i, j)]);
        let (h, gain) = (RowVector2::new(h[0], h[1]), Vector2::new(gain[0], gain[1]));
        ChannelColumns::new(&f, &h, &gain, lags)
            .map(ChannelDesign)
            .map_err(|e| fail(e.into()))
    }

    /// A, shape (lags, 3): ``A @ (q1, q2, r)`` are the lag covariances of the model.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let columns = self.0.columns();
        matrix(
            py,
            &DMatrix::from_fn(self.0.lags(), 3, |i, j| columns[j][i]),
        )
    }

    /// Lag covariances for theta = (q1, q2, r), shape (lags,).
    fn covariances<'py>(&self, theta: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let py = theta.py();
        let theta = Argument::new("theta", theta).vector().map_err(fail(py))?;
        scalars(py, self.0.covariances(theta.into()))
    }

    /// (q1, q2, r), none negative, that come nearest to measured lag covariances C (lags,); all lags weigh alike.
    ///
    /// ``known``: three values that are taken as given, None for each that is unknown. Returns shape (3,); raises IdentificationError where the lags cannot
    /// tell the unknowns apart.
    #[pyo3(signature = (C, known=None))]
    #[allow(non_snake_case)]
    fn solve<'py>(
        &self,
        C: &Bound<'py, PyAny>,
        known: Option<(Option<f64>, Option<f64>, Option<f64>)>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let py = C.py();
        let fail = fail(py);
        let covariances = Argument::new("C", C)
            .column(Some(self.0.lags()))
            .map_err(fail)?;
        let found = self
            .0
            .solve(&covariances, known.map_or([None; 3], Into::into))
            .map_err(|e| fail(e.into()))?;
        scalars(py, found)
    }

    #[classmethod]
    fn _from_state(_class: &Bound<'_, PyType>, state: &[u8]) -> PyResult<Self> {
        pickle::load::<Self, _>(state).map(ChannelDesign)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        pickle::reduce(slf, &slf.get().0)
    }
}
