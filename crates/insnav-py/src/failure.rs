//! Errors and warnings as Python sees them: a code for programs, a message, and a remedy for people.

use insnav_log::{Problem, Warning};
use pyo3::prelude::*;

/// What went wrong, before it becomes `insnav.InsnavError`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Failure(Problem);

impl Failure {
    pub(crate) fn new(
        code: &'static str,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Failure(Problem::new(code, message, remedy))
    }

    /// The Python exception. Its class is written in Python, so that it can be pickled and subclassed like any other.
    pub(crate) fn into_py_err(self, py: Python<'_>) -> PyErr {
        let Problem {
            code,
            message,
            remedy,
        } = self.0;
        let make = || {
            py.import("insnav._errors")?.getattr("InsnavError")?.call1((
                message,
                code.as_ref(),
                remedy,
            ))
        };
        match make() {
            Ok(exception) => PyErr::from_value(exception),
            Err(error) => error,
        }
    }
}

/// Tell the user by way of Python's own warnings, at the line that called.
pub(crate) fn warn(py: Python<'_>, warning: &Warning) -> PyResult<()> {
    let category = py.import("insnav._errors")?.getattr("InsnavWarning")?;
    let text = format!("{} ({})", warning.message, warning.remedy);
    py.import("warnings")?
        .call_method1("warn", (text, category))?;
    Ok(())
}

impl<E: Into<Problem>> From<E> for Failure {
    fn from(e: E) -> Self {
        Failure(e.into())
    }
}
