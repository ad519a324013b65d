//! New arrays.

use nalgebra::DMatrix;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;

/// A new array of shape (n,).
pub(crate) fn scalars<'py, T: numpy::Element>(
    py: Python<'py>,
    values: impl IntoIterator<Item = T>,
) -> PyResult<Bound<'py, PyAny>> {
    PyArray1::from_iter(py, values).into_bound_py_any(py)
}

/// A new array of booleans of shape (n,).
pub(crate) fn bools<'py>(
    py: Python<'py>,
    values: impl IntoIterator<Item = bool>,
) -> PyResult<Bound<'py, PyAny>> {
    PyArray1::from_iter(py, values).into_bound_py_any(py)
}

/// A new array of shape (n, N).
pub(crate) fn rows<'py, const N: usize>(
    py: Python<'py>,
    values: impl ExactSizeIterator<Item = [f64; N]>,
) -> PyResult<Bound<'py, PyAny>> {
    let shape = [values.len(), N];
    PyArray1::from_vec(py, values.flatten().collect())
        .reshape(shape)?
        .into_bound_py_any(py)
}

/// A new array of shape (n, width), which takes the numbers as they lie.
pub(crate) fn table(py: Python<'_>, values: Vec<f64>, width: usize) -> PyResult<Bound<'_, PyAny>> {
    let shape = [values.len() / width, width];
    PyArray1::from_vec(py, values)
        .reshape(shape)?
        .into_bound_py_any(py)
}

/// A new array of shape (n, 3, 3).
pub(crate) fn matrices<'py>(
    py: Python<'py>,
    values: impl ExactSizeIterator<Item = [[f64; 3]; 3]>,
) -> PyResult<Bound<'py, PyAny>> {
    let shape = [values.len(), 3, 3];
    PyArray1::from_vec(py, values.flatten().flatten().collect())
        .reshape(shape)?
        .into_bound_py_any(py)
}

/// A new array of shape (n, m).
pub(crate) fn matrix<'py>(py: Python<'py>, matrix: &DMatrix<f64>) -> PyResult<Bound<'py, PyAny>> {
    PyArray1::from_vec(py, matrix.transpose().as_slice().to_vec())
        .reshape([matrix.nrows(), matrix.ncols()])?
        .into_bound_py_any(py)
}

/// A new array of shape (n, p, p), of values with the columns of each matrix one after the other.
pub(crate) fn square_stack<'py>(
    py: Python<'py>,
    values: &[f64],
    size: usize,
) -> PyResult<Bound<'py, PyAny>> {
    let by_rows: Vec<f64> = values
        .chunks_exact(size * size)
        .flat_map(|one| (0..size * size).map(|i| one[i % size * size + i / size]))
        .collect();
    PyArray1::from_vec(py, by_rows)
        .reshape([values.len() / (size * size), size, size])?
        .into_bound_py_any(py)
}
