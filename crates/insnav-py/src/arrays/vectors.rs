//! Arguments that are vectors, channels or pairs, one a row.

use super::{Argument, elements};
use crate::failure::Failure;
use nalgebra::Vector3;
use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};

impl<'py> Argument<'py> {
    /// Shape (n, 3): vectors, one per stamp.
    pub(crate) fn vectors(&self, rows: usize) -> Result<Vec<Vector3<f64>>, Failure> {
        let array = self.floats()?;
        match array.shape() {
            [n, 3] if *n == rows => Ok(rows_of_three(&array)),
            other => Err(self.wrong(other, &format!("({rows}, 3)"))),
        }
    }

    /// Shape (n, 3): vectors, one per stamp, all of them finite.
    pub(crate) fn finite_vectors(&self, rows: usize) -> Result<Vec<Vector3<f64>>, Failure> {
        let vectors = self.vectors(rows)?;
        let finite = |v: &Vector3<f64>| v.iter().all(|x| x.is_finite());
        match vectors.iter().position(|v| !finite(v)) {
            None => Ok(vectors),
            row => Err(self.not_finite(row, "drop the rows without a measurement")),
        }
    }

    /// Shape (n, 3): any number of vectors, all of them finite.
    pub(crate) fn finite_rows(&self) -> Result<Vec<Vector3<f64>>, Failure> {
        let array = self.floats()?;
        match *array.shape() {
            [n, 3] => self.finite_vectors(n),
            ref other => Err(self.wrong(other, "(n, 3)")),
        }
    }

    /// Shape (3,): one vector of finite numbers.
    pub(crate) fn vector(&self) -> Result<Vector3<f64>, Failure> {
        let array = self.floats()?;
        let [3] = array.shape() else {
            return Err(self.wrong_shape(array.shape(), "(3,)", "three numbers"));
        };
        let vector = rows_of_three(&array)[0];
        if vector.iter().all(|x| x.is_finite()) {
            return Ok(vector);
        }
        Err(self.not_finite(None, "three finite numbers"))
    }

    /// Shape (n, 3) or (3,): vectors, and whether it is one alone.
    pub(crate) fn vectors_alone_or_not(&self) -> Result<(Vec<Vector3<f64>>, bool), Failure> {
        let array = self.floats()?;
        match array.shape() {
            [3] => Ok((rows_of_three(&array), true)),
            [_, 3] => Ok((rows_of_three(&array), false)),
            other => Err(self.wrong_shape(other, "(n, 3) or (3,)", "one vector a row")),
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

    /// Shape (k, 2): finite begins and ends.
    pub(crate) fn pairs(&self) -> Result<Vec<[f64; 2]>, Failure> {
        let array = self.floats()?;
        if !matches!(array.shape(), [_, 2]) {
            return Err(self.wrong_shape(array.shape(), "(k, 2)", "a begin and an end a row"));
        }
        let values = elements(&array);
        let pairs: Vec<[f64; 2]> = values.chunks_exact(2).map(|p| [p[0], p[1]]).collect();
        match pairs.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            None => Ok(pairs),
            row => Err(self.not_finite(row, "give begin and end of each")),
        }
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
                        .about(
                            &self.name,
                            format!("({}, {})", span[0], span[1]),
                            format!("two rows of {rows}"),
                        )
                    })
            })
            .collect()
    }
}

fn rows_of_three(array: &PyReadonlyArrayDyn<'_, f64>) -> Vec<Vector3<f64>> {
    let vector = |row: &[f64]| Vector3::new(row[0], row[1], row[2]);
    match array.as_slice() {
        Ok(slice) => slice.chunks_exact(3).map(vector).collect(),
        Err(_) => elements(array).chunks_exact(3).map(vector).collect(),
    }
}
