//! What measurements have in common: sigmas, covariances, instants.

use crate::arrays::{Argument, shape_text};
use crate::failure::Failure;
use nalgebra::{DMatrix, Matrix3, Vector3};
use pyo3::prelude::*;

/// One standard deviation for all axes or one each.
pub(super) fn sigmas(
    name: &str,
    object: &Bound<'_, PyAny>,
    may_be_zero: bool,
) -> Result<Vector3<f64>, Failure> {
    let numbers = Argument::new(name, object).numbers()?;
    let sigma = match (numbers.shape(), numbers.values()) {
        ([], &[s]) => Vector3::repeat(s),
        ([3], values) => Vector3::from_column_slice(values),
        (other, _) => {
            return Err(Failure::argument(
                "wrong_shape",
                name,
                format!("shape {}", shape_text(other)),
                "a number or (3,)",
                "",
            ));
        }
    };
    let rule = |s: &f64| s.is_finite() && (*s > 0.0 || (may_be_zero && *s == 0.0));
    if sigma.iter().all(rule) {
        return Ok(sigma);
    }
    let expected = if may_be_zero {
        "finite and not negative"
    } else {
        "finite and above 0"
    };
    let received = format!("{:?}", numbers.values());
    Err(Failure::argument("bad_value", name, received, expected, ""))
}

/// A positive number.
pub(super) fn positive(name: &str, value: f64) -> Result<f64, Failure> {
    if value.is_finite() && value > 0.0 {
        return Ok(value);
    }
    let expected = "finite and above 0";
    Err(Failure::argument(
        "bad_value",
        name,
        value.to_string(),
        expected,
        "",
    ))
}

/// A covariance, told as such or by its standard deviations.
pub(super) fn covariance(
    sigma: Option<&Bound<'_, PyAny>>,
    covariance: Option<&Bound<'_, PyAny>>,
) -> Result<Matrix3<f64>, Failure> {
    match (sigma, covariance) {
        (Some(sigma), None) => {
            let s = sigmas("sigma", sigma, false)?;
            Ok(Matrix3::from_diagonal(&s.component_mul(&s)))
        }
        (None, Some(given)) => {
            let r: Matrix3<f64> = Argument::new("covariance", given).fixed()?;
            is_covariance(
                "covariance",
                &DMatrix::from_iterator(3, 3, r.iter().copied()),
            )?;
            Ok(r)
        }
        (given, _) => Err(Failure::argument(
            "bad_option",
            "sigma, covariance",
            if given.is_some() { "both" } else { "none" },
            "one of the two",
            "",
        )),
    }
}

/// What a covariance may lack of being one, by rounding, at variances of 1.
const ROUNDING: f64 = 1e-9;

/// Symmetric, and no direction with a variance below zero (but for rounding).
pub(super) fn is_covariance(name: &str, given: &DMatrix<f64>) -> Result<(), Failure> {
    // States differ in size by orders of magnitude: rounding is judged at a diagonal of one.
    let sizes = given.diagonal().map(|v| match v.abs() {
        0.0 => 1.0,
        v => v.sqrt(),
    });
    let scaled = given.map_with_location(|i, j, v| v / (sizes[i] * sizes[j]));
    let symmetric = (&scaled - scaled.transpose()).amax() <= ROUNDING;
    let smallest = scaled.clone().symmetric_eigenvalues().min();
    if symmetric && smallest >= -ROUNDING {
        return Ok(());
    }
    let variance = given.diagonal().min();
    let received = match symmetric {
        false => "a matrix that is not symmetric".to_owned(),
        true if variance < 0.0 => format!("a variance of {variance:.3e}"),
        true => {
            format!("correlations that cannot be (eigenvalue {smallest:.3e} at variances of 1)")
        }
    };
    Err(Failure::argument(
        "not_a_covariance",
        name,
        received,
        "a symmetric matrix without negative variances",
        "squares of standard deviations on the diagonal",
    ))
}
