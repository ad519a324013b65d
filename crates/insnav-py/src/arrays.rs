//! The only place where numpy arrays and the core's vectors meet.

use crate::failure::Failure;
use insnav_core::time::Time;
use nalgebra::{DMatrix, Vector3};
use numpy::{
    PyArray1, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// An argument on its way in: what it is called in messages, and the object.
pub(crate) struct Argument<'py> {
    pub(crate) name: String,
    pub(crate) object: Bound<'py, PyAny>,
}

impl<'py> Argument<'py> {
    pub(crate) fn new(name: &str, object: &Bound<'py, PyAny>) -> Self {
        Argument {
            name: name.to_owned(),
            object: object.clone(),
        }
    }

    /// `numpy.asarray(object, dtype, order="C")`.
    fn asarray(&self, dtype: Option<&str>) -> Result<Bound<'py, PyAny>, Failure> {
        let convert = || {
            let py = self.object.py();
            let options = PyDict::new(py);
            options.set_item("dtype", dtype)?;
            options.set_item("order", "C")?;
            py.import("numpy")?
                .call_method("asarray", (&self.object,), Some(&options))
        };
        convert().map_err(|e: PyErr| {
            Failure::new(
                "not_numbers",
                format!("{}: cannot be read as numbers: {e}", self.name),
                "give a numpy array, or lists that numpy.asarray takes",
            )
        })
    }

    fn wrong(&self, received: &[usize], expected: &str) -> Failure {
        self.wrong_shape(received, expected, "one row per stamp")
    }

    fn wrong_shape(&self, received: &[usize], expected: &str, remedy: &str) -> Failure {
        Failure::new(
            "wrong_shape",
            format!(
                "{}: shape {}, expected {expected}",
                self.name,
                shape_text(received)
            ),
            remedy,
        )
    }

    fn floats(&self) -> Result<PyReadonlyArrayDyn<'py, f64>, Failure> {
        let array = self.asarray(Some("float64"))?;
        let array = array
            .cast::<PyArrayDyn<f64>>()
            .map_err(|e| Failure::new("not_numbers", format!("{}: {e}", self.name), ""))?;
        Ok(array.readonly())
    }

    /// Shape (n,): stamps, as seconds or as `datetime64`, in an order that does not go backward.
    pub(crate) fn times(&self) -> Result<Vec<Time>, Failure> {
        let array = self.asarray(None)?;
        let is_date = array
            .cast::<PyUntypedArray>()
            .is_ok_and(|a| a.dtype().kind() == b'M');
        let times = if is_date {
            self.dates(&array)?
        } else {
            self.column(None)?
                .iter()
                .map(|&s| s.is_finite().then(|| Time::from_seconds(s)))
                .collect()
        };
        let mut checked: Vec<Time> = Vec::with_capacity(times.len());
        for (row, time) in times.into_iter().enumerate() {
            let time = time.ok_or_else(|| {
                Failure::new(
                    "not_finite",
                    format!("{}[{row}]: no finite time", self.name),
                    "drop the rows without a stamp",
                )
            })?;
            if let Some(&previous) = checked.last()
                && time < previous
            {
                return Err(Failure::new(
                    "backward_stamps",
                    format!(
                        "{}[{row}] = {time} is before {previous} in the row above",
                        self.name
                    ),
                    "sort the rows by time",
                ));
            }
            checked.push(time);
        }
        Ok(checked)
    }

    /// Nanoseconds, exactly; `None` for not-a-time.
    fn dates(&self, array: &Bound<'py, PyAny>) -> Result<Vec<Option<Time>>, Failure> {
        let nanos = || {
            array
                .call_method1("astype", ("datetime64[ns]",))?
                .call_method1("astype", ("int64",))
        };
        let failed = |e: String| {
            Failure::new(
                "not_numbers",
                format!("{}: cannot be read as times: {e}", self.name),
                "give seconds, or datetime64[ns]",
            )
        };
        let nanos = nanos().map_err(|e: PyErr| failed(e.to_string()))?;
        let nanos = nanos
            .cast::<PyArray1<i64>>()
            .map_err(|_| self.wrong(&shape_of(array), "(n,)"))?
            .readonly();
        let nanos = nanos.as_slice().map_err(|e| failed(e.to_string()))?;
        Ok(nanos
            .iter()
            .map(|&t| (t != i64::MIN).then_some(Time(t)))
            .collect())
    }

    /// Shape (n,): numbers. `rows`: what n must be.
    pub(crate) fn column(&self, rows: Option<usize>) -> Result<Vec<f64>, Failure> {
        let array = self.floats()?;
        match array.shape() {
            [n] if rows.is_none_or(|rows| rows == *n) => Ok(elements(&array)),
            other => Err(self.wrong(
                other,
                &rows.map_or("(n,)".to_owned(), |n| format!("({n},)")),
            )),
        }
    }

    /// Shape (n, 3): vectors, one per stamp.
    pub(crate) fn vectors(&self, rows: usize) -> Result<Vec<Vector3<f64>>, Failure> {
        let array = self.floats()?;
        match array.shape() {
            [n, 3] if *n == rows => Ok(rows_of_three(&array)),
            other => Err(self.wrong(other, &format!("({rows}, 3)"))),
        }
    }

    /// Shape (n, 3) or (3,): vectors, one per stamp or one for all.
    pub(crate) fn vectors_or_one(&self, rows: usize) -> Result<Vec<Vector3<f64>>, Failure> {
        let array = self.floats()?;
        match array.shape() {
            [3] if rows != 0 => Ok(vec![rows_of_three(&array)[0]; rows]),
            [n, 3] if *n == rows => Ok(rows_of_three(&array)),
            other => Err(self.wrong(other, &format!("({rows}, 3) or (3,)"))),
        }
    }

    /// Shape (n, m): a matrix. `None`: any size but zero.
    pub(crate) fn matrix(
        &self,
        rows: Option<usize>,
        columns: Option<usize>,
    ) -> Result<DMatrix<f64>, Failure> {
        let mut stack = self.matrices(None, rows, columns, false)?;
        Ok(stack.remove(0))
    }

    /// Shape (k, n, m): as many matrices, or shape (n, m): the same one as often. `None`: any size but zero.
    pub(crate) fn matrix_or_stack(
        &self,
        count: usize,
        rows: Option<usize>,
        columns: Option<usize>,
    ) -> Result<Vec<DMatrix<f64>>, Failure> {
        let mut stack = self.matrices(Some(count), rows, columns, true)?;
        if stack.len() == 1 && count != 1 {
            let one = stack.remove(0);
            return Ok(vec![one; count]);
        }
        Ok(stack)
    }

    /// Shape (k, n, m), any k but zero.
    pub(crate) fn stack(&self, rows: usize, columns: usize) -> Result<Vec<DMatrix<f64>>, Failure> {
        self.matrices(Some(0), Some(rows), Some(columns), false)
    }

    /// `count`: `None` for a matrix alone, 0 for any number of them; `alone`: or one for all.
    fn matrices(
        &self,
        count: Option<usize>,
        rows: Option<usize>,
        columns: Option<usize>,
        alone: bool,
    ) -> Result<Vec<DMatrix<f64>>, Failure> {
        let array = self.floats()?;
        let fits = |have: usize, want: Option<usize>| have > 0 && want.is_none_or(|w| w == have);
        let values = elements(&array);
        let (n, m) = match (array.shape(), count) {
            (&[n, m], None) if fits(n, rows) && fits(m, columns) => (n, m),
            (&[n, m], Some(_)) if alone && fits(n, rows) && fits(m, columns) => (n, m),
            (&[k, n, m], Some(count))
                if k > 0 && (count == 0 || k == count) && fits(n, rows) && fits(m, columns) =>
            {
                (n, m)
            }
            (other, _) => {
                let size = |letter: &str, want: Option<usize>| {
                    want.map_or(letter.to_owned(), |w| w.to_string())
                };
                let one = format!("{}, {}", size("n", rows), size("m", columns));
                let expected = match count {
                    None => format!("({one})"),
                    Some(0) => format!("(k, {one})"),
                    Some(count) if alone => format!("({one}) or ({count}, {one})"),
                    Some(count) => format!("({count}, {one})"),
                };
                return Err(self.wrong_shape(other, &expected, "sizes follow from F, G and H"));
            }
        };
        if let Some(at) = values.iter().position(|v| !v.is_finite()) {
            return Err(Failure::new(
                "not_finite",
                format!("{}: element {at} is {}", self.name, values[at]),
                "give finite numbers",
            ));
        }
        Ok(values
            .chunks_exact(n * m)
            .map(|one| DMatrix::from_row_slice(n, m, one))
            .collect())
    }

    /// Shape (n, p), or (n,) where p is 1: samples of p channels side by side, and p.
    pub(crate) fn channels(&self, channels: Option<usize>) -> Result<(Vec<f64>, usize), Failure> {
        let array = self.floats()?;
        let fits = |p: usize| p > 0 && channels.is_none_or(|want| want == p);
        match *array.shape() {
            [_] if fits(1) => Ok((elements(&array), 1)),
            [_, p] if fits(p) => Ok((elements(&array), p)),
            ref other => {
                let expected = match channels {
                    None => "(n, p), or (n,) of one channel".to_owned(),
                    Some(1) => "(n,) or (n, 1)".to_owned(),
                    Some(p) => format!("(n, {p})"),
                };
                Err(self.wrong_shape(
                    other,
                    &expected,
                    "one row per sample, one column per channel",
                ))
            }
        }
    }

    /// Shape (k, 2): from where to where, in rows of which there are `rows`.
    pub(crate) fn spans(&self, rows: usize) -> Result<Vec<[usize; 2]>, Failure> {
        let array = self.floats()?;
        if !matches!(array.shape(), [_, 2]) {
            return Err(self.wrong_shape(
                array.shape(),
                "(k, 2)",
                "for each run its first row and the one after its last",
            ));
        }
        let values = elements(&array);
        values
            .chunks_exact(2)
            .enumerate()
            .map(|(row, span)| {
                let whole = span.iter().all(|v| v.fract() == 0.0 && *v >= 0.0);
                let inside = span[0] <= span[1] && span[1] <= rows as f64;
                (whole && inside)
                    .then(|| [span[0] as usize, span[1] as usize])
                    .ok_or_else(|| {
                        Failure::new(
                            "bad_option",
                            format!(
                                "{}[{row}] = ({}, {}): no run of the {rows} samples",
                                self.name, span[0], span[1]
                            ),
                            "for each run its first row and the one after its last",
                        )
                    })
            })
            .collect()
    }

    /// Shape (n, p, p): the elements, the columns of each matrix one after the other.
    pub(crate) fn square_stack(&self, count: usize, size: usize) -> Result<Vec<f64>, Failure> {
        let stack = self.matrices(Some(count), Some(size), Some(size), false)?;
        Ok(stack.iter().flat_map(|m| m.as_slice().to_vec()).collect())
    }
}

fn elements(array: &PyReadonlyArrayDyn<'_, f64>) -> Vec<f64> {
    array.as_array().iter().copied().collect()
}

fn rows_of_three(array: &PyReadonlyArrayDyn<'_, f64>) -> Vec<Vector3<f64>> {
    elements(array)
        .chunks_exact(3)
        .map(Vector3::from_column_slice)
        .collect()
}

fn shape_of(array: &Bound<'_, PyAny>) -> Vec<usize> {
    array
        .cast::<PyUntypedArray>()
        .map_or_else(|_| Vec::new(), |a| a.shape().to_vec())
}

/// As Python writes a tuple.
fn shape_text(shape: &[usize]) -> String {
    match shape {
        [n] => format!("({n},)"),
        _ => {
            let inner: Vec<String> = shape.iter().map(usize::to_string).collect();
            format!("({})", inner.join(", "))
        }
    }
}

/// A new array of shape (n,).
pub(crate) fn scalars<'py, T: numpy::Element>(
    py: Python<'py>,
    values: impl IntoIterator<Item = T>,
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
