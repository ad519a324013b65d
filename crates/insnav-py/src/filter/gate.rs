//! `insnav.filter.Gate`.

use crate::arrays::{Argument, counts};
use crate::failure::Failure;
use crate::pickle;
use insnav_core::filter;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

/// Is a residual compatible with its prediction? A chi-square gate that remembers what it has refused.
///
/// Parameters
/// ----------
/// limit : (float, float, float), optional
///     Largest NIS that is accepted, by degrees of freedom 1, 2, 3. Without it the quantiles at 1 - 1e-4 ([Abramowitz64] 26.4).
/// patience : int, default 10
///     Refusals in a row after which measurements are used with their covariance enlarged until they fit.
///
/// Examples
/// --------
/// >>> from insnav.filter import Gate
/// >>> Gate().limit[0]
/// 15.1367
#[pyclass(module = "insnav.filter")]
pub(crate) struct Gate(pub(super) filter::Gate);

impl Argument<'_> {
    /// Shape (3,): what a squared residual may be at most.
    fn three_limits(&self) -> Result<[f64; 3], Failure> {
        let array = self.numbers()?;
        let ([3], &[a, b, c]) = (array.shape(), array.values()) else {
            return Err(self.wrong_shape(
                array.shape(),
                "(3,)",
                "one limit each for 1, 2 and 3 degrees of freedom",
            ));
        };
        if [a, b, c].iter().all(|x| *x >= 0.0) {
            return Ok([a, b, c]);
        }
        Err(Failure::argument(
            "bad_value",
            &self.name,
            format!("{:?}", array.values()),
            "three numbers that are not negative",
            "Gate.closed() lets nothing through",
        ))
    }
}

#[pymethods]
impl Gate {
    #[new]
    #[pyo3(signature = (limit=None, *, patience=10))]
    fn new(
        py: Python<'_>,
        limit: Option<&Bound<'_, PyAny>>,
        #[pyo3(from_py_with = counts::patience)] patience: u32,
    ) -> PyResult<Self> {
        let mut gate = filter::Gate::default();
        if let Some(limit) = limit {
            let limits = Argument::new("limit", limit)
                .three_limits()
                .map_err(|e| e.into_py_err(py))?;
            gate.limit = limits;
        }
        gate.patience = patience;
        Ok(Gate(gate))
    }

    /// A gate that lets everything through.
    #[staticmethod]
    fn open() -> Self {
        Gate(filter::Gate::open())
    }

    /// A gate that lets nothing through: to look at a measurement without using it.
    #[staticmethod]
    fn closed() -> Self {
        Gate(filter::Gate::closed())
    }

    /// A gate that enlarges the covariance of whatever does not fit.
    #[staticmethod]
    fn lenient() -> Self {
        Gate(filter::Gate::lenient())
    }

    /// A gate that never gives way.
    #[staticmethod]
    fn strict() -> Self {
        Gate(filter::Gate::strict())
    }

    /// Largest NIS that is accepted, by degrees of freedom 1, 2, 3.
    #[getter]
    fn limit(&self) -> (f64, f64, f64) {
        self.0.limit.into()
    }

    /// Refusals in a row after which measurements are used with an enlarged covariance.
    #[getter]
    fn patience(&self) -> u32 {
        self.0.patience
    }

    fn __repr__(&self) -> String {
        format!(
            "<insnav.filter.Gate: limit {:?}, patience {}>",
            self.0.limit, self.0.patience
        )
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        pickle::reduce(slf, &slf.try_borrow()?.0)
    }

    #[staticmethod]
    fn _from_state(state: &[u8]) -> PyResult<Self> {
        pickle::load::<Self, _>(state).map(Gate)
    }
}
