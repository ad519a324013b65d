//! Errors as Python sees them: one class, with a code for programs and a remedy for people.

use pyo3::prelude::*;

/// What went wrong, before it becomes `insnav.InsnavError`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Failure {
    pub(crate) code: &'static str,
    pub(crate) message: String,
    pub(crate) remedy: String,
}

impl Failure {
    pub(crate) fn new(
        code: &'static str,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Failure {
            code,
            message: message.into(),
            remedy: remedy.into(),
        }
    }

    /// The Python exception. Its class is written in Python, so that it can be pickled and subclassed like any other.
    pub(crate) fn into_py_err(self, py: Python<'_>) -> PyErr {
        let raise = || {
            py.import("insnav._errors")?.getattr("InsnavError")?.call1((
                self.message,
                self.code,
                self.remedy,
            ))
        };
        match raise() {
            Ok(exception) => PyErr::from_value(exception),
            Err(error) => error,
        }
    }
}
