//! What the filter told of its measurements → `insnav.Updates`.

use crate::arrays::{rows, scalars};
use insnav_core::filter::Verdict;
use insnav_core::time::Time;
use insnav_log::UpdateRow;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// One row a measurement; seconds count from `origin`.
pub(crate) fn updates<'py>(
    py: Python<'py>,
    updates: &[UpdateRow],
    origin: Time,
) -> PyResult<Bound<'py, PyAny>> {
    let columns = PyDict::new(py);
    let seconds = updates.iter().map(|u| u.time.since(origin));
    columns.set_item("time_s", scalars(py, seconds)?)?;
    // There are few kinds of them.
    let mut names: Vec<&str> = Vec::new();
    let mut numbers = Vec::with_capacity(updates.len());
    for update in updates {
        let known = names.iter().position(|n| *n == update.measurement);
        numbers.push(known.unwrap_or(names.len()) as i64);
        if known.is_none() {
            names.push(&update.measurement);
        }
    }
    columns.set_item("measurement", words(py, &names, numbers)?)?;
    columns.set_item("dof", scalars(py, updates.iter().map(|u| u.dof as i64))?)?;
    columns.set_item("residual", rows(py, updates.iter().map(|u| u.residual))?)?;
    columns.set_item("sigma", rows(py, updates.iter().map(|u| u.sigma))?)?;
    columns.set_item("nis", scalars(py, updates.iter().map(|u| u.nis))?)?;
    let verdicts = updates.iter().map(|u| match u.verdict {
        Verdict::Accepted => 0,
        Verdict::Inflated => 1,
        Verdict::Rejected => 2,
        Verdict::Reset => 3,
        Verdict::Frozen => 4,
    });
    let known = ["accepted", "inflated", "rejected", "reset", "frozen"];
    columns.set_item("verdict", words(py, &known, verdicts)?)?;
    py.import("insnav._solution")?
        .getattr("Updates")?
        .call((), Some(&columns))
}

/// A column of few words by their numbers, as numpy's strings of fixed width.
fn words<'py>(
    py: Python<'py>,
    known: &[&str],
    numbers: impl IntoIterator<Item = i64>,
) -> PyResult<Bound<'py, PyAny>> {
    let options = PyDict::new(py);
    // Of no words numpy would make numbers.
    options.set_item("dtype", "str")?;
    py.import("numpy")?
        .call_method("array", (known.to_vec(),), Some(&options))?
        .call_method1("take", (scalars(py, numbers)?,))
}
