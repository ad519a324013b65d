//! Matrices of any size as serde has them: rows, columns, and the elements by column.

use nalgebra::DMatrix;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::vec::Vec;

/// One of them.
#[derive(Serialize, Deserialize)]
struct Stored {
    rows: usize,
    columns: usize,
    values: Vec<f64>,
}

impl Stored {
    fn of(m: &DMatrix<f64>) -> Self {
        Stored {
            rows: m.nrows(),
            columns: m.ncols(),
            values: m.as_slice().to_vec(),
        }
    }

    /// `None` where the numbers do not fit together.
    fn matrix(self) -> Option<DMatrix<f64>> {
        let fits = self.rows.checked_mul(self.columns) == Some(self.values.len());
        fits.then(|| DMatrix::from_vec(self.rows, self.columns, self.values))
    }
}

const WRONG: &str = "a matrix with another number of elements than rows times columns";

pub(super) fn serialize<S: Serializer>(m: &DMatrix<f64>, s: S) -> Result<S::Ok, S::Error> {
    Stored::of(m).serialize(s)
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<DMatrix<f64>, D::Error> {
    let stored = Stored::deserialize(d)?;
    stored.matrix().ok_or_else(|| D::Error::custom(WRONG))
}

/// A list of them.
pub(super) mod list {
    use super::{
        DMatrix, Deserialize, Deserializer, Error, Serialize, Serializer, Stored, Vec, WRONG,
    };

    pub(in crate::noise) fn serialize<S: Serializer>(
        all: &[DMatrix<f64>],
        s: S,
    ) -> Result<S::Ok, S::Error> {
        let stored: Vec<Stored> = all.iter().map(Stored::of).collect();
        stored.serialize(s)
    }

    pub(in crate::noise) fn deserialize<'de, D: Deserializer<'de>>(
        d: D,
    ) -> Result<Vec<DMatrix<f64>>, D::Error> {
        let stored = Vec::<Stored>::deserialize(d)?;
        let matrices: Option<Vec<_>> = stored.into_iter().map(Stored::matrix).collect();
        matrices.ok_or_else(|| D::Error::custom(WRONG))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Serialize, Deserialize)]
    struct Both {
        #[serde(with = "super")]
        one: DMatrix<f64>,
        #[serde(with = "super::list")]
        many: Vec<DMatrix<f64>>,
    }

    #[test]
    fn what_is_read_is_what_was_written() {
        let one = DMatrix::from_fn(2, 3, |i, j| (i as f64).mul_add(0.1, -(j as f64)));
        let both = Both {
            many: std::vec![one.clone(), DMatrix::zeros(0, 4)],
            one,
        };
        let text = serde_json::to_string(&both).expect("numbers");
        let back: Both = serde_json::from_str(&text).expect("the same");
        assert_eq!(back.one, both.one);
        assert_eq!(back.many, both.many);
        let fewer = text.replace("\"columns\":3", "\"columns\":2");
        assert!(serde_json::from_str::<Both>(&fewer).is_err());
    }
}
