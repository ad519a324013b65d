//! What is stated of the errors of fixes.

use crate::arrays::Argument;
use crate::failure::Failure;
use insnav_core::sample::is_covariance;
use insnav_core::time::Time;
use nalgebra::{Matrix3, Vector3};

/// What a row states of its uncertainty.
#[derive(Clone, Copy)]
pub(crate) enum Stated {
    Nothing,
    Sigma(Vector3<f64>),
    Covariance(Matrix3<f64>),
}

impl Stated {
    /// `None` when something in it is not known (NaN).
    pub(super) fn covariance(self) -> Option<Matrix3<f64>> {
        let covariance = match self {
            Stated::Nothing => return None,
            Stated::Sigma(s) => Matrix3::from_diagonal(&s.component_mul(&s)),
            Stated::Covariance(p) => p,
        };
        covariance
            .iter()
            .all(|x| x.is_finite())
            .then_some(covariance)
    }
}

impl Stated {
    /// Refuses what cannot be: a standard deviation or a variance below zero, in any direction. `row`: of many, with its stamp.
    pub(crate) fn possible(self, name: &str, row: Option<(usize, Time)>) -> Result<Self, Failure> {
        if let Stated::Covariance(p) = self
            && p.iter().all(|x| x.is_finite())
            && p.diagonal().iter().all(|variance| *variance >= 0.0)
            && !is_covariance(&p)
        {
            return Err(no_covariance(name, row, &p));
        }
        let (least, expected) = match self {
            Stated::Nothing => return Ok(self),
            Stated::Sigma(s) => (s, "standard deviations that are not negative"),
            Stated::Covariance(p) => (p.diagonal(), "variances that are not negative"),
        };
        let Some(negative) = least.iter().find(|s| **s < 0.0) else {
            return Ok(self);
        };
        let place = row.map_or_else(String::new, |(row, _)| format!("[{row}]"));
        Err(at_row(
            Failure::new(
                "bad_value",
                format!("{name}{place}: {negative}, expected {expected}"),
                "give NaN where it is not known",
            )
            .about(name, negative.to_string(), expected),
            row,
        ))
    }
}

/// What is wrong with a matrix whose variances are none below zero.
fn no_covariance(name: &str, row: Option<(usize, Time)>, p: &Matrix3<f64>) -> Failure {
    let place = row.map_or_else(String::new, |(row, time)| format!("[{row}] at {time}"));
    let symmetric = (p - p.transpose()).amax() <= 1e-6 * p.amax();
    let received = if symmetric {
        let least = p.symmetric_eigenvalues().min();
        format!("a matrix in which a direction has the variance {least:.3e}")
    } else {
        "a matrix that is not symmetric".to_owned()
    };
    let expected = "a covariance: symmetric, correlations between -1 and 1";
    let remedy =
        "give variances on the diagonal and covariances beside it, or NaN where it is not known";
    let message = format!("{name}{place}: {received}, expected {expected}");
    let failure = Failure::new("not_a_covariance", message, remedy);
    at_row(failure.about(name, received, expected), row)
}

fn at_row(failure: Failure, row: Option<(usize, Time)>) -> Failure {
    match row {
        Some((_, time)) => failure.at(time),
        None => failure,
    }
}

/// Standard deviations (n, 3), (3,) or one number, covariances (n, 3, 3) or (3, 3), or nothing for every row, of which `times` are the stamps.
pub(super) fn stated(
    column: Option<&Argument<'_>>,
    times: &[Time],
) -> Result<Vec<Stated>, Failure> {
    let rows = times.len();
    let Some(column) = column else {
        return Ok(vec![Stated::Nothing; rows]);
    };
    let array = column.numbers()?;
    let values = array.values();
    let covariance = |row: &[f64]| Stated::Covariance(Matrix3::from_row_slice(row));
    let sigma = |row: &[f64]| Stated::Sigma(Vector3::from_column_slice(row));
    match array.shape() {
        [] => by_row(column, times, vec![Stated::Sigma(Vector3::repeat(values[0])); rows]),
        [3] => by_row(column, times, vec![sigma(values); rows]),
        // Of three rows these are their standard deviations.
        [n, 3] if *n == rows => by_row(column, times, values.chunks_exact(3).map(sigma)),
        [3, 3] => by_row(column, times, vec![covariance(values); rows]),
        [n, 3, 3] if *n == rows => by_row(column, times, values.chunks_exact(9).map(covariance)),
        other => Err(column.wrong_shape(
            other,
            &format!(
                "standard deviations ({rows}, 3), (3,) or one number, or covariances ({rows}, 3, 3) or (3, 3)"
            ),
            "one row per stamp, or one for all",
        )),
    }
}

/// All of them, unless one cannot be, which is named with its row.
fn by_row(
    column: &Argument<'_>,
    times: &[Time],
    stated: impl IntoIterator<Item = Stated>,
) -> Result<Vec<Stated>, Failure> {
    stated
        .into_iter()
        .zip(times)
        .enumerate()
        .map(|(row, (stated, time))| stated.possible(&column.name, Some((row, *time))))
        .collect()
}
