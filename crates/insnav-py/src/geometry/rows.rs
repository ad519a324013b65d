//! A function of one row, over arrays of rows.

use crate::arrays::{Argument, Floats, shape_text};
use crate::failure::{Failure, fail};
use crate::interrupt::Signals;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;

/// Rows of `width` numbers each, in any number of leading axes: none is one row alone.
pub(crate) struct Rows<'py> {
    name: String,
    array: Floats<'py>,
    /// Lengths of the leading axes.
    pub(crate) lead: Vec<usize>,
    width: usize,
}

impl<'py> Rows<'py> {
    /// `row`: the shape of one row, empty for a number.
    pub(crate) fn new(
        name: &str,
        object: &Bound<'py, PyAny>,
        row: &[usize],
    ) -> Result<Self, Failure> {
        let array = Argument::new(name, object).numbers()?;
        let shape = array.shape();
        let Some(lead) = shape.len().checked_sub(row.len()) else {
            return Err(wrong(name, shape, row));
        };
        if shape[lead..] != *row {
            return Err(wrong(name, shape, row));
        }
        Ok(Rows {
            name: name.to_owned(),
            lead: shape[..lead].to_vec(),
            array,
            width: row.iter().product(),
        })
    }

    /// Numbers.
    pub(crate) fn scalars(name: &str, object: &Bound<'py, PyAny>) -> Result<Self, Failure> {
        Rows::new(name, object, &[])
    }

    /// Vectors.
    pub(crate) fn vectors(name: &str, object: &Bound<'py, PyAny>) -> Result<Self, Failure> {
        Rows::new(name, object, &[3])
    }

    /// Attitudes, which need not be normalised but must have a direction.
    pub(crate) fn quaternions(name: &str, object: &Bound<'py, PyAny>) -> Result<Self, Failure> {
        let rows = Rows::new(name, object, &[4])?;
        rows.check(
            |q| q.iter().map(|x| x * x).sum::<f64>().sqrt().is_normal(),
            "quaternions (w, x, y, z) other than zero",
        )?;
        Ok(rows)
    }

    /// Refuse the first row that does not obey.
    pub(crate) fn check(
        &self,
        rule: impl Fn(&[f64]) -> bool,
        expected: &str,
    ) -> Result<(), Failure> {
        self.check_or(rule, expected, "")
    }

    /// Refuse the first row that does not obey, and say what to do about it.
    pub(crate) fn check_or(
        &self,
        rule: impl Fn(&[f64]) -> bool,
        expected: &str,
        remedy: &str,
    ) -> Result<(), Failure> {
        let values = self.array.values();
        let width = self.width.max(1);
        match values.chunks_exact(width).position(|row| !rule(row)) {
            None => Ok(()),
            Some(at) => {
                let row = &values[at * width..(at + 1) * width];
                let received = match row {
                    [x] => x.to_string(),
                    row => format!("{row:?}"),
                };
                let place = match self.lead.len() {
                    0 => String::new(),
                    _ => format!(" in row {at}"),
                };
                let received = format!("{received}{place}");
                Err(Failure::argument(
                    "bad_value",
                    &self.name,
                    received,
                    expected,
                    remedy,
                ))
            }
        }
    }

    pub(crate) fn finite(&self) -> Result<(), Failure> {
        self.check(|row| row.iter().all(|x| x.is_finite()), "finite numbers")
    }

    /// Rows one after the other.
    pub(crate) fn values(&self) -> &[f64] {
        self.array.values()
    }

    fn count(&self) -> usize {
        self.lead.iter().product()
    }
}

fn wrong(name: &str, received: &[usize], row: &[usize]) -> Failure {
    let one = shape_text(row);
    let many = match row {
        [] => "(n,)".to_owned(),
        row => {
            let inner: Vec<String> = row.iter().map(usize::to_string).collect();
            format!("(n, {})", inner.join(", "))
        }
    };
    let expected = if row.is_empty() {
        "a number or (n,)".to_owned()
    } else {
        format!("{many} or {one}")
    };
    Failure::argument(
        "wrong_shape",
        name,
        format!("shape {}", shape_text(received)),
        expected,
        "one row each, or one alone; more axes may lead",
    )
}

/// The leading axes that all have in common; what is alone goes with every row.
pub(crate) fn common_lead(rows: &[&Rows<'_>]) -> Result<Vec<usize>, Failure> {
    let mut common: Option<&Rows<'_>> = None;
    for rows in rows.iter().filter(|rows| !rows.lead.is_empty()) {
        match common {
            None => common = Some(rows),
            Some(first) if first.lead == rows.lead => {}
            Some(first) => {
                return Err(Failure::argument(
                    "wrong_shape",
                    &rows.name,
                    format!("{} rows", shape_text(&rows.lead)),
                    format!(
                        "{} rows as in `{}`, or one alone",
                        shape_text(&first.lead),
                        first.name
                    ),
                    "",
                ));
            }
        }
    }
    Ok(common.map_or_else(Vec::new, |rows| rows.lead.clone()))
}

/// Between two looks for signals: some tens of microseconds.
const ROWS_AT_ONCE: usize = 1024;

/// `f` over the rows of all arguments, with other Python threads running. `shape`: that of one result.
pub(crate) fn over<'py, const N: usize, const OUT: usize>(
    py: Python<'py>,
    rows: [&Rows<'py>; N],
    shape: &[usize],
    f: impl Fn([&[f64]; N]) -> [f64; OUT] + Sync + Send,
) -> PyResult<Bound<'py, PyAny>> {
    debug_assert_eq!(shape.iter().product::<usize>(), OUT);
    let lead = common_lead(&rows).map_err(fail(py))?;
    let count: usize = lead.iter().product();
    let inputs: [(&[f64], usize); N] = rows.map(|r| {
        let step = if r.lead.is_empty() { 0 } else { r.width };
        debug_assert!(r.lead.is_empty() || r.count() == count);
        (r.values(), step)
    });
    let widths = rows.map(|r| r.width);
    let values = py.detach(|| -> PyResult<_> {
        let mut values = Vec::with_capacity(count * OUT);
        let mut signals = Signals::of_long_rounds();
        for begin in (0..count).step_by(ROWS_AT_ONCE) {
            signals.look()?;
            for i in begin..count.min(begin + ROWS_AT_ONCE) {
                let row: [&[f64]; N] = std::array::from_fn(|k| {
                    let (all, step) = inputs[k];
                    &all[i * step..i * step + widths[k]]
                });
                values.extend_from_slice(&f(row));
            }
        }
        Ok(values)
    })?;
    shaped(py, values, &lead, shape)
}

/// An array of the leading axes and the shape of one row; a number where there are none.
pub(crate) fn shaped<'py>(
    py: Python<'py>,
    values: Vec<f64>,
    lead: &[usize],
    row: &[usize],
) -> PyResult<Bound<'py, PyAny>> {
    if lead.is_empty() && row.is_empty() {
        return values[0].into_bound_py_any(py);
    }
    let shape: Vec<usize> = lead.iter().chain(row).copied().collect();
    PyArray1::from_vec(py, values)
        .reshape(shape)?
        .into_bound_py_any(py)
}

pub(crate) fn vector(row: &[f64]) -> Vector3<f64> {
    Vector3::from_column_slice(row)
}

/// Normalised where it is not, to the last digit as it stands where it is.
pub(crate) fn quaternion(row: &[f64]) -> UnitQuaternion<f64> {
    let q = Quaternion::new(row[0], row[1], row[2], row[3]);
    // What normalising would change is less than rounding.
    if (q.norm_squared() - 1.0).abs() <= 4.0 * f64::EPSILON {
        UnitQuaternion::new_unchecked(q)
    } else {
        UnitQuaternion::new_normalize(q)
    }
}

pub(crate) fn wxyz(q: &UnitQuaternion<f64>) -> [f64; 4] {
    [q.w, q.i, q.j, q.k]
}

/// Row by row, as numpy has it.
pub(crate) fn by_rows(m: &Matrix3<f64>) -> [f64; 9] {
    std::array::from_fn(|i| m[(i / 3, i % 3)])
}
