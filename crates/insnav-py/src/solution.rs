//! A solution in memory → `insnav.Solution`, whose class is written in Python: it holds columns and does nothing else.

use crate::epochs::EpochColumns;
use crate::updates::updates;
use insnav_core::time::Time;
use insnav_log::UpdateRow;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Columns of epochs and measurements, with what the run has to tell; seconds count from `origin`.
pub(crate) fn solution<'py>(
    py: Python<'py>,
    epochs: EpochColumns,
    measured: &[UpdateRow],
    origin: Time,
    summary: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyAny>> {
    let columns = epochs.into_python(py, origin)?;
    columns.set_item("t0_ns", origin.0)?;
    columns.set_item("updates", updates(py, measured, origin)?)?;
    columns.set_item("summary", summary)?;
    py.import("insnav._solution")?
        .getattr("Solution")?
        .call((), Some(&columns))
}
