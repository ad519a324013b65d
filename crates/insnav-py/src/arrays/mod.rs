//! The only place where numpy arrays and the core's vectors meet.
//!
//! `Argument` is one on its way in: `times`, `vectors` and `matrices` read it, `counts` whole numbers. `made` has what goes out.

pub(crate) mod counts;
mod made;
mod matrices;
mod times;
mod vectors;

pub(crate) use made::{bools, matrices, matrix, rows, scalars, square_stack, table};
pub(crate) use times::{MOST_SECONDS, counted_from, too_far};

use crate::failure::Failure;
use numpy::{
    PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

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

    /// `numpy.asarray(object, dtype, order="C")`, which would read what is masked as if it were not.
    fn asarray(&self, dtype: Option<&str>) -> Result<Bound<'py, PyAny>, Failure> {
        self.unmasked()?;
        let convert = || {
            let py = self.object.py();
            let options = PyDict::new(py);
            options.set_item("dtype", dtype)?;
            options.set_item("order", "C")?;
            py.import("numpy")?
                .call_method("asarray", (&self.object,), Some(&options))
        };
        convert().map_err(|raised: PyErr| {
            Failure::raised(self.object.py(), raised, |e| {
                Failure::new(
                    "not_numbers",
                    format!("{}: cannot be read as numbers: {e}", self.name),
                    "give a numpy array, or lists that numpy.asarray takes",
                )
                .about(&self.name, self.type_name(), "numbers")
            })
        })
    }

    /// Refuse an array with elements that are masked, and rows that are such arrays.
    fn unmasked(&self) -> Result<(), Failure> {
        let is_plain = |object: &Bound<'py, PyAny>| {
            object.is_exact_instance_of::<PyUntypedArray>()
                || !object.is_instance_of::<PyUntypedArray>()
        };
        let masked = |object: &Bound<'py, PyAny>| -> PyResult<Option<String>> {
            let numpy = object.py().import("numpy.ma")?;
            if !numpy.call_method1("is_masked", (object,))?.is_truthy()? {
                return Ok(None);
            }
            let mask = numpy.call_method1("getmaskarray", (object,))?;
            let places = mask.call_method0("nonzero")?;
            let first: Vec<usize> = places
                .try_iter()?
                .map(|axis| axis?.get_item(0)?.extract())
                .collect::<PyResult<_>>()?;
            let first: Vec<String> = first.iter().map(usize::to_string).collect();
            let count: usize = mask.call_method0("sum")?.extract()?;
            let plural = if count == 1 { "" } else { "s" };
            Ok(Some(format!(
                "{count} masked element{plural}, the first at [{}]",
                first.join(", ")
            )))
        };
        let found = if !is_plain(&self.object) {
            masked(&self.object)
        } else if let Ok(rows) = self.object.cast::<PyList>() {
            let mut rows = rows.iter().enumerate().filter(|(_, row)| !is_plain(row));
            rows.find_map(|(at, row)| {
                masked(&row)
                    .map(|found| found.map(|text| format!("in row {at} {text}")))
                    .transpose()
            })
            .transpose()
        } else {
            Ok(None)
        };
        match found {
            // What numpy cannot say of it is said where it is read.
            Ok(None) | Err(_) => Ok(()),
            Ok(Some(received)) => Err(Failure::argument(
                "masked",
                &self.name,
                received,
                "no mask",
                "drop those rows, or give `.filled(np.nan)` where NaN means that nothing was measured",
            )),
        }
    }

    fn type_name(&self) -> String {
        crate::inputs::type_name(&self.object)
    }

    fn wrong(&self, received: &[usize], expected: &str) -> Failure {
        self.wrong_shape(received, expected, "one row per stamp")
    }

    pub(crate) fn wrong_shape(&self, received: &[usize], expected: &str, remedy: &str) -> Failure {
        let received = format!("shape {}", shape_text(received));
        Failure::argument("wrong_shape", &self.name, received, expected, remedy)
    }

    pub(crate) fn not_finite(&self, row: Option<usize>, remedy: &str) -> Failure {
        let place = row.map_or_else(String::new, |row| format!("[{row}]"));
        let message = format!("{}{place}: is not finite", self.name);
        Failure::new("not_finite", message, remedy).about(&self.name, "not finite", "finite")
    }

    fn floats(&self) -> Result<PyReadonlyArrayDyn<'py, f64>, Failure> {
        let array = self.asarray(Some("float64"))?;
        let array = array
            .cast::<PyArrayDyn<f64>>()
            .map_err(|e| Failure::new("not_numbers", format!("{}: {e}", self.name), ""))?;
        Ok(array.readonly())
    }

    /// Numbers of any shape, row by row; not copied where they lie so already.
    pub(crate) fn numbers(&self) -> Result<Floats<'py>, Failure> {
        let array = self.floats()?;
        match array.as_slice() {
            Ok(_) => Ok(Floats(array)),
            Err(e) => Err(Failure::new(
                "not_numbers",
                format!("{}: {e}", self.name),
                "give a numpy array, or lists that numpy.asarray takes",
            )),
        }
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

    /// Exactly this shape: the numbers row by row, whatever they are.
    pub(crate) fn shaped(&self, shape: &[usize]) -> Result<Vec<f64>, Failure> {
        let array = self.floats()?;
        if array.shape() != shape {
            return Err(self.wrong(array.shape(), &shape_text(shape)));
        }
        Ok(elements(&array))
    }

    /// Shape (n,): whole numbers, exactly.
    pub(crate) fn integers(&self) -> Result<Vec<i64>, Failure> {
        let array = self.asarray(Some("int64"))?;
        let array = array
            .cast::<PyArray1<i64>>()
            .map_err(|_| self.wrong(&shape_of(&array), "(n,)"))?
            .readonly();
        Ok(array.as_array().iter().copied().collect())
    }
}

/// Numbers as they lie in memory, row by row.
pub(crate) struct Floats<'py>(PyReadonlyArrayDyn<'py, f64>);

impl Floats<'_> {
    pub(crate) fn shape(&self) -> &[usize] {
        self.0.shape()
    }

    pub(crate) fn values(&self) -> &[f64] {
        // That there is one was seen when it was made.
        self.0.as_slice().unwrap_or_default()
    }
}

fn elements(array: &PyReadonlyArrayDyn<'_, f64>) -> Vec<f64> {
    // `asarray` has made it contiguous; one copy, so that other threads may change the array meanwhile.
    match array.as_slice() {
        Ok(slice) => slice.to_vec(),
        Err(_) => array.as_array().iter().copied().collect(),
    }
}

fn shape_of(array: &Bound<'_, PyAny>) -> Vec<usize> {
    array
        .cast::<PyUntypedArray>()
        .map_or_else(|_| Vec::new(), |a| a.shape().to_vec())
}

/// As Python writes a tuple.
pub(crate) fn shape_text(shape: &[usize]) -> String {
    match shape {
        [n] => format!("({n},)"),
        _ => {
            let inner: Vec<String> = shape.iter().map(usize::to_string).collect();
            format!("({})", inner.join(", "))
        }
    }
}
