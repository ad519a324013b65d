//! Arguments that are matrices, alone or in stacks; all of their numbers are finite.

use super::{Argument, elements};
use crate::failure::Failure;
use nalgebra::{DMatrix, SMatrix};
use numpy::PyUntypedArrayMethods;

impl<'py> Argument<'py> {
    /// Shape (n, m): a matrix. `None`: any size but zero.
    pub(crate) fn matrix(
        &self,
        rows: Option<usize>,
        columns: Option<usize>,
    ) -> Result<DMatrix<f64>, Failure> {
        let mut stack = self.matrices(None, rows, columns, false)?;
        Ok(stack.remove(0))
    }

    /// Shape (N, N).
    pub(crate) fn fixed<const N: usize>(&self) -> Result<SMatrix<f64, N, N>, Failure> {
        let matrix = self.matrix(Some(N), Some(N))?;
        Ok(SMatrix::from_fn(|i, j| matrix[(i, j)]))
    }

    /// Shape (n, n), any n but zero.
    pub(crate) fn square(&self) -> Result<DMatrix<f64>, Failure> {
        let matrix = self.matrix(None, None)?;
        if matrix.is_square() {
            return Ok(matrix);
        }
        // Told with the size that would be.
        self.matrix(Some(matrix.nrows()), Some(matrix.nrows()))
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

    /// Shape (n, p, p): the elements, the columns of each matrix one after the other.
    pub(crate) fn square_stack(&self, count: usize, size: usize) -> Result<Vec<f64>, Failure> {
        let stack = self.matrices(Some(count), Some(size), Some(size), false)?;
        Ok(stack.iter().flat_map(|m| m.as_slice().to_vec()).collect())
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
            )
            .about(&self.name, values[at].to_string(), "finite numbers"));
        }
        Ok(values
            .chunks_exact(n * m)
            .map(|one| DMatrix::from_row_slice(n, m, one))
            .collect())
    }
}
