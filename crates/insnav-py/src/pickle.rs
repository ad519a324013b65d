//! State as bytes, for `pickle` and `copy`: bit for bit, NaN and infinities included.

use pyo3::PyClass;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyTuple};
use serde::Serialize;
use serde::de::DeserializeOwned;

const VERSION: &str = env!("CARGO_PKG_VERSION");

/// What `__reduce__` gives back: the class's own `_from_state`, and the state.
pub(crate) fn reduce<'py, T: PyClass>(
    slf: &Bound<'py, T>,
    state: &impl Serialize,
) -> PyResult<Bound<'py, PyTuple>> {
    let py = slf.py();
    let make = slf.as_any().get_type().getattr("_from_state")?;
    let arguments = PyTuple::new(py, [bytes::<T>(py, state)?])?;
    PyTuple::new(py, [make, arguments.into_any()])
}

/// The state, for those that have more to say: version, class and CRC-32 of the rest come first.
pub(crate) fn bytes<'py, C: PyClass>(
    py: Python<'py>,
    state: &impl Serialize,
) -> PyResult<Bound<'py, PyBytes>> {
    let wrong = |e: postcard::Error| PyValueError::new_err(e.to_string());
    let state = postcard::to_stdvec(state).map_err(wrong)?;
    let sum = crc32fast::hash(&state).to_le_bytes();
    let mut all = postcard::to_stdvec(&(VERSION, C::NAME, sum)).map_err(wrong)?;
    all.extend_from_slice(&state);
    Ok(PyBytes::new(py, &all))
}

/// The state of a `C` again. Bytes of another version or class are refused, since they mean something else there, and so are
/// bytes that are no longer those that were written: most of them would still be numbers.
pub(crate) fn load<C: PyClass, T: DeserializeOwned>(state: &[u8]) -> PyResult<T> {
    let wrong = |what: String| {
        PyValueError::new_err(format!(
            "no state of {} of insnav {VERSION}: {what}; pickles are for the version that made them",
            C::NAME
        ))
    };
    let broken = |e: postcard::Error| wrong(e.to_string());
    let (version, rest): (&str, &[u8]) = postcard::take_from_bytes(state).map_err(broken)?;
    if version != VERSION {
        return Err(wrong(format!("it is of {version:?}")));
    }
    let (class, rest): (&str, &[u8]) = postcard::take_from_bytes(rest).map_err(broken)?;
    if class != C::NAME {
        return Err(wrong(format!("it is of the class {class:?}")));
    }
    let (sum, rest): ([u8; 4], &[u8]) = postcard::take_from_bytes(rest).map_err(broken)?;
    if sum != crc32fast::hash(rest).to_le_bytes() {
        return Err(wrong("bytes were changed or are missing".to_owned()));
    }
    let (state, left) = postcard::take_from_bytes(rest).map_err(broken)?;
    if !left.is_empty() {
        return Err(wrong(format!("{} bytes are left", left.len())));
    }
    Ok(state)
}
