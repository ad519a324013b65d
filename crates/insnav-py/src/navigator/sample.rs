//! The arguments of one step → a sample, without an allocation where they are numbers, arrays, tuples or lists.

use crate::arrays::{Argument, MOST_SECONDS, counted_from};
use crate::failure::Failure;
use crate::inputs::Stated;
use insnav_core::time::Time;
use nalgebra::{Matrix3, Vector3};
use numpy::{PyArray1, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyFloat, PyList, PyTuple};

/// Seconds from `zero`, or a `datetime64`, which is an instant already.
#[inline]
pub(super) fn time(object: &Bound<'_, PyAny>, zero: Time) -> Result<Time, Failure> {
    let later = |t: Time| counted_from(zero, "time_s", t);
    match object.cast::<PyFloat>() {
        Ok(seconds) if seconds.value().abs() <= MOST_SECONDS => {
            later(Time::from_seconds(seconds.value()))
        }
        _ => {
            let argument = Argument::new("time_s", object);
            let dates = argument.is_dates()?;
            let time = argument.instant()?;
            if dates { Ok(time) } else { later(time) }
        }
    }
}

/// Three numbers; what they are is judged by the navigator.
#[inline]
pub(crate) fn three(name: &str, object: &Bound<'_, PyAny>) -> Result<Vector3<f64>, Failure> {
    // A subclass may have a mask.
    if object.is_exact_instance_of::<PyUntypedArray>()
        && let Ok(array) = object.cast::<PyArray1<f64>>()
    {
        if array.len() == 3
            && let (Some(x), Some(y), Some(z)) =
                (array.get_owned(0), array.get_owned(1), array.get_owned(2))
        {
            return Ok(Vector3::new(x, y, z));
        }
    } else if let Ok(tuple) = object.cast::<PyTuple>() {
        if let Ok((x, y, z)) = tuple.extract::<(f64, f64, f64)>() {
            return Ok(Vector3::new(x, y, z));
        }
    } else if let Ok(list) = object.cast::<PyList>()
        && list.len() == 3
    {
        let item = |i: usize| list.get_item(i).and_then(|x| x.extract::<f64>());
        if let (Ok(x), Ok(y), Ok(z)) = (item(0), item(1), item(2)) {
            return Ok(Vector3::new(x, y, z));
        }
    }
    let values = Argument::new(name, object).column(Some(3))?;
    Ok(Vector3::from_column_slice(&values))
}

/// What is said of the errors: three standard deviations, one for all three, a covariance, or nothing.
pub(crate) fn stated(name: &str, object: Option<&Bound<'_, PyAny>>) -> Result<Stated, Failure> {
    let Some(object) = object else {
        return Ok(Stated::Nothing);
    };
    if let Ok(sigma) = object.extract::<f64>() {
        return Stated::Sigma(Vector3::repeat(sigma)).possible(name, None);
    }
    let argument = Argument::new(name, object);
    let numbers = argument.numbers()?;
    let stated = match numbers.shape() {
        [3, 3] => Stated::Covariance(Matrix3::from_row_slice(numbers.values())),
        _ => Stated::Sigma(three(name, object)?),
    };
    stated.possible(name, None)
}
