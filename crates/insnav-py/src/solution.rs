//! A solution in memory → `insnav.Solution`, whose class is written in Python: it holds columns and does nothing else.

use crate::epochs::EpochColumns;
use crate::updates::updates;
use crate::withheld::withheld;
use insnav_core::sample::GnssPosition;
use insnav_core::time::Time;
use insnav_log::UpdateRow;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Columns of epochs, measurements and withheld fixes, with what the run has to tell; seconds count from `origin`.
pub(crate) fn solution<'py>(
    py: Python<'py>,
    epochs: EpochColumns,
    measured: &[UpdateRow],
    kept_from_it: &[GnssPosition],
    origin: Time,
    summary: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyAny>> {
    let columns = epochs.into_python(py, origin)?;
    columns.set_item("t0_ns", origin.0)?;
    columns.set_item("updates", updates(py, measured, origin)?)?;
    columns.set_item("summary", summary)?;
    columns.set_item("withheld", withheld(py, kept_from_it, origin)?)?;
    py.import("insnav._solution")?
        .getattr("Solution")?
        .call((), Some(&columns))
}
