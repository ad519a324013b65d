//! What is stated of the errors of fixes.

use crate::arrays::Argument;
use crate::failure::Failure;
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
    /// Refuses what cannot be: a standard deviation or a variance below zero. `row`: of many.
    pub(crate) fn not_negative(self, name: &str, row: Option<usize>) -> Result<Self, Failure> {
        let (least, expected) = match self {
            Stated::Nothing => return Ok(self),
            Stated::Sigma(s) => (s, "standard deviations that are not negative"),
            Stated::Covariance(p) => (p.diagonal(), "variances that are not negative"),
        };
        let Some(negative) = least.iter().find(|s| **s < 0.0) else {
            return Ok(self);
        };
        let place = row.map_or_else(String::new, |row| format!("[{row}]"));
        Err(Failure::new(
            "bad_value",
            format!("{name}{place}: {negative}, expected {expected}"),
            "give NaN where it is not known",
        )
        .about(name, negative.to_string(), expected))
    }
}

/// Standard deviations (n, 3) or (3,), covariances (n, 3, 3), or nothing for every row.
pub(super) fn stated(column: Option<&Argument<'_>>, rows: usize) -> Result<Vec<Stated>, Failure> {
    let Some(column) = column else {
        return Ok(vec![Stated::Nothing; rows]);
    };
    if column.dimensions()? == 3 {
        let values = column.shaped(&[rows, 3, 3])?;
        let one = |row: &[f64]| Stated::Covariance(Matrix3::from_row_slice(row));
        return by_row(column, values.chunks_exact(9).map(one));
    }
    let sigmas = column.vectors_or_one(rows)?;
    by_row(column, sigmas.into_iter().map(Stated::Sigma))
}

/// All of them, unless one cannot be, which is named with its row.
fn by_row(
    column: &Argument<'_>,
    stated: impl Iterator<Item = Stated>,
) -> Result<Vec<Stated>, Failure> {
    stated
        .enumerate()
        .map(|(row, stated)| stated.not_negative(&column.name, Some(row)))
        .collect()
}
