//! Arguments that count something: whole numbers that are not negative, refused by their names.

use crate::failure::Failure;
use pyo3::exceptions::PyOverflowError;
use pyo3::prelude::*;

/// A whole number that is not negative, of an argument by this name.
fn whole<'py, T>(name: &str, given: &Bound<'py, PyAny>) -> PyResult<T>
where
    T: for<'a> FromPyObject<'a, 'py>,
    for<'a> <T as FromPyObject<'a, 'py>>::Error: Into<PyErr>,
{
    let py = given.py();
    given.extract::<T>().map_err(|raised| {
        let raised: PyErr = raised.into();
        if !raised.is_instance_of::<PyOverflowError>(py) {
            return raised;
        }
        let received = given
            .repr()
            .map_or_else(|_| "something else".to_owned(), |text| text.to_string());
        let expected = "whole numbers that are not negative";
        Failure::argument("bad_option", name, received, expected, "").into_py_err(py)
    })
}

/// For `from_py_with`: one function an argument, which has its name.
macro_rules! counts {
    ($($name:ident: $number:ty),* $(,)?) => {$(
        pub(crate) fn $name(given: &Bound<'_, PyAny>) -> PyResult<$number> {
            whole(stringify!($name), given)
        }
    )*};
}

counts! {
    channels: usize,
    count: usize,
    lags: usize,
    patience: u32,
    reweights: usize,
    rounds: usize,
    runs: Option<u32>,
    samples: Option<Vec<usize>>,
    skip: usize,
    span: usize,
}
