//! Products of innovations against what the model predicts for each, summed up in a size that does not grow.

use super::NoiseUnknown;
use crate::noise::Refusal;
use crate::noise::cone::nonnegative;
use crate::time::Time;
use nalgebra::{Cholesky, DMatrix, DVector};
use std::vec::Vec;

const K: usize = NoiseUnknown::COUNT;
/// Lags, in innovations, are put together for the test of fit from these on: misfit is smooth, and a sum over many lags shows what
/// none of them would alone.
const BINS: [usize; 8] = [0, 1, 2, 3, 5, 9, 17, 33];
/// So long is a piece whose scatter tells standard errors when the products are not as independent as they should be, s.
const PIECE: f64 = 30.0;
/// Fewer pieces tell no scatter.
const FEWEST_PIECES: usize = 10;
/// Rows of the test: two kinds now, two kinds before, horizontal and vertical.
const ROWS: usize = 8 * BINS.len();

/// Which two innovations a product is of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    /// The later one: whether it is a velocity.
    pub(crate) now: bool,
    /// The earlier one.
    pub(crate) then: bool,
    /// How many innovations lie between them, plus one; 0: the same.
    pub(crate) lag: usize,
    /// Components of both.
    pub(crate) size: usize,
}

/// One product of normalised innovations with its prediction: by unknown, and the known part.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Product {
    pub(crate) measured: [[f64; 3]; 3],
    pub(crate) shares: [[[f64; 3]; 3]; K],
    pub(crate) known: [[f64; 3]; 3],
}

#[derive(Clone, Copy, Debug, Default)]
struct Normal {
    matrix: [[f64; K]; K],
    right: [f64; K],
}

/// One number of the test of fit: Σ of products along the diagonal.
#[derive(Clone, Copy, Debug, Default)]
struct Row {
    measured: f64,
    known: f64,
    shares: [f64; K],
    variance: f64,
}

/// What the innovations of a run say of the noise.
#[derive(Clone, Debug)]
pub struct InnovationSums {
    total: Normal,
    piece: Normal,
    piece_begin: Option<Time>,
    pieces: Vec<Normal>,
    rows: [Row; ROWS],
    counts: [usize; 2],
}

impl Default for InnovationSums {
    fn default() -> Self {
        InnovationSums {
            total: Normal::default(),
            piece: Normal::default(),
            piece_begin: None,
            pieces: Vec::new(),
            rows: [Row::default(); ROWS],
            counts: [0; 2],
        }
    }
}

/// Noise that makes the sums fit, each variance in units of what the filter took it for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseSolution {
    /// Variances, over those of the run.
    pub theta: [f64; NoiseUnknown::COUNT],
    /// Their standard errors; 0 for what was given.
    pub standard_errors: [f64; NoiseUnknown::COUNT],
    /// Misfit of the lag covariances.
    pub chi2: f64,
    /// Number of lag covariances less unknowns.
    pub dof: usize,
}

/// Σ of products of normalised innovations of one kind, component by component, from one lag to the next that is listed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LagSum {
    /// What the later innovation is of.
    pub now: NoiseUnknown,
    /// The earlier one.
    pub then: NoiseUnknown,
    /// Down components; else north and east.
    pub vertical: bool,
    /// First of the lags, in innovations of either kind.
    pub first_lag: usize,
    /// As measured.
    pub measured: f64,
    /// As predicted.
    pub predicted: f64,
    /// Variance for white innovations: the number of products, twice that for squares.
    pub variance: f64,
}

impl InnovationSums {
    /// How many innovations of positions and of velocities went in.
    pub fn counts(&self) -> [usize; 2] {
        self.counts
    }

    /// Whether anything was seen that depends on an unknown.
    pub fn shows(&self, unknown: NoiseUnknown) -> bool {
        let i = unknown as usize;
        self.total.matrix[i][i] > 0.0
    }

    pub(crate) fn begin(&mut self, time: Time, velocity: bool) {
        self.counts[usize::from(velocity)] += 1;
        let begin = *self.piece_begin.get_or_insert(time);
        if !(0.0..PIECE).contains(&time.since(begin)) {
            self.pieces.push(core::mem::take(&mut self.piece));
            self.piece_begin = Some(time);
        }
    }

    pub(crate) fn add(&mut self, pair: &Pair, product: &Product) {
        // A square has twice the variance of a product of two.
        let weight = if pair.lag == 0 { 0.5 } else { 1.0 };
        let mut residual = product.measured;
        for (row, known) in residual.iter_mut().zip(&product.known) {
            for (x, known) in row.iter_mut().zip(known) {
                *x -= known;
            }
        }
        let dot = |a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]| -> f64 {
            a.iter()
                .flatten()
                .zip(b.iter().flatten())
                .map(|(a, b)| a * b)
                .sum()
        };
        for i in 0..K {
            for j in 0..=i {
                let x = weight * dot(&product.shares[i], &product.shares[j]);
                self.piece.matrix[i][j] += x;
                self.total.matrix[i][j] += x;
            }
            let x = weight * dot(&product.shares[i], &residual);
            self.piece.right[i] += x;
            self.total.right[i] += x;
        }
        let bin = BINS
            .iter()
            .rposition(|first| *first <= pair.lag)
            .unwrap_or(0);
        let kind = 2 * usize::from(pair.now) + usize::from(pair.then);
        for axis in 0..pair.size {
            let row = &mut self.rows[(2 * kind + axis / 2) * BINS.len() + bin];
            row.measured += product.measured[axis][axis];
            row.known += product.known[axis][axis];
            row.variance += if pair.lag == 0 { 2.0 } else { 1.0 };
            for (sum, share) in row.shares.iter_mut().zip(&product.shares) {
                *sum += share[axis][axis];
            }
        }
    }

    /// Solve for what is not given, variances in units of those of the run, none negative.
    ///
    /// Standard errors are the larger of what independent products would have and of what the scatter of half-minutes shows.
    ///
    /// # Errors
    /// [`Refusal::TooShort`] without innovations; [`Refusal::NotPositiveDefinite`] when unknowns cannot be told apart.
    pub fn solve(
        &self,
        given: &[Option<f64>; NoiseUnknown::COUNT],
    ) -> Result<NoiseSolution, Refusal> {
        let free: Vec<usize> = (0..K)
            .filter(|i| given[*i].is_none() && self.total.matrix[*i][*i] > 0.0)
            .collect();
        let count = self.counts.iter().sum();
        if free.is_empty() {
            return Err(Refusal::TooShort {
                lag: 0,
                count,
                independent: count as f64,
                least: 1.0,
            });
        }
        let known: [f64; K] = core::array::from_fn(|i| given[i].unwrap_or(0.0));
        let scale: Vec<f64> = free
            .iter()
            .map(|i| self.total.matrix[*i][*i].sqrt().recip())
            .collect();
        let normal = DMatrix::from_fn(free.len(), free.len(), |a, b| {
            self.total.at(free[a], free[b]) * scale[a] * scale[b]
        });
        let right = DVector::from_fn(free.len(), |a, _| {
            self.total.right_less(free[a], &known) * scale[a]
        });
        let solution = nonnegative(&normal, &right)?;
        let mut theta = known;
        for (a, i) in free.iter().enumerate() {
            theta[*i] = solution[a] * scale[a];
        }
        let inverse = Cholesky::new(normal)
            .ok_or(Refusal::NotPositiveDefinite {
                what: "normal matrix",
                remedy: "some unknowns cannot be told apart; give one of them",
            })?
            .inverse();
        let scatter = self.scatter(&free, &scale, &theta);
        let robust = scatter.map(|s| &inverse * s * &inverse);
        let mut standard_errors = [0.0; K];
        for (a, i) in free.iter().enumerate() {
            let shown = robust.as_ref().map_or(0.0, |v| v[(a, a)]);
            standard_errors[*i] = scale[a] * inverse[(a, a)].max(shown).sqrt();
        }
        let lags = self.lag_sums(&theta);
        let rows = lags.len();
        let chi2 = lags.iter().map(|row| row.misfit().powi(2)).sum();
        Ok(NoiseSolution {
            theta,
            standard_errors,
            chi2,
            dof: usize::saturating_sub(rows, free.len()).max(1),
        })
    }

    /// Covariance of the right side by the scatter of the pieces, scaled as the normal matrix.
    fn scatter(&self, free: &[usize], scale: &[f64], theta: &[f64; K]) -> Option<DMatrix<f64>> {
        if self.pieces.len() < FEWEST_PIECES {
            return None;
        }
        let k = free.len();
        let mut sum = DMatrix::zeros(k, k);
        for piece in self.pieces.iter().chain([&self.piece]) {
            let left = DVector::from_fn(k, |a, _| piece.right_less(free[a], theta) * scale[a]);
            sum += &left * left.transpose();
        }
        Some(sum)
    }

    /// Sums of products by lag as they were measured and as they are predicted: what the test of fit is made of. `theta` as in
    /// [`NoiseSolution`]; all ones are what the filter believed, whose innovations are white where its gains were optimal for it.
    pub fn lag_sums(&self, theta: &[f64; NoiseUnknown::COUNT]) -> Vec<LagSum> {
        (0..ROWS)
            .map(|i| (i, &self.rows[i]))
            .filter(|(_, row)| row.variance > 0.0)
            .map(|(i, row)| {
                let kind = i / BINS.len();
                let shares: f64 = row.shares.iter().zip(theta).map(|(a, t)| a * t).sum();
                LagSum {
                    now: kind_of(kind / 4),
                    then: kind_of(kind / 2 % 2),
                    vertical: kind % 2 == 1,
                    first_lag: BINS[i % BINS.len()],
                    measured: row.measured,
                    predicted: row.known + shares,
                    variance: row.variance,
                }
            })
            .collect()
    }
}

fn kind_of(velocity: usize) -> NoiseUnknown {
    if velocity == 1 {
        NoiseUnknown::Velocity
    } else {
        NoiseUnknown::Position
    }
}

impl LagSum {
    /// Measured less predicted, in sigmas of products of white noise.
    pub fn misfit(&self) -> f64 {
        (self.measured - self.predicted) / self.variance.sqrt()
    }
}

impl Normal {
    fn at(&self, i: usize, j: usize) -> f64 {
        self.matrix[i.max(j)][i.min(j)]
    }

    fn right_less(&self, i: usize, theta: &[f64; K]) -> f64 {
        let known: f64 = (0..K).map(|j| self.at(i, j) * theta[j]).sum();
        self.right[i] - known
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn product(i: usize, theta: &[f64; K]) -> Product {
        let value = |k: usize, a: usize, b: usize| {
            // Of different frequencies, so that no share is a sum of others.
            let x = ((i + 1) * (k + 2) + 3 * a * b + a + b) as f64;
            (x * 0.7).sin() + if a == b { 1.5 } else { 0.0 }
        };
        let matrix = |k: usize| core::array::from_fn(|a| core::array::from_fn(|b| value(k, a, b)));
        let shares: [[[f64; 3]; 3]; K] = core::array::from_fn(matrix);
        let known: [[f64; 3]; 3] = matrix(K);
        let measured = core::array::from_fn(|a| {
            core::array::from_fn(|b| {
                known[a][b] + (0..K).map(|k| theta[k] * shares[k][a][b]).sum::<f64>()
            })
        });
        Product {
            measured,
            shares,
            known,
        }
    }

    fn sums(theta: &[f64; K]) -> InnovationSums {
        let mut sums = InnovationSums::default();
        for i in 0..200 {
            sums.begin(Time(i as i64 * 1_000_000_000), i % 2 == 1);
            let pair = Pair {
                now: i % 2 == 1,
                then: i % 3 == 1,
                lag: i % 50,
                size: 3,
            };
            sums.add(&pair, &product(i, theta));
        }
        sums
    }

    #[test]
    fn what_the_products_are_made_of_comes_back() {
        let theta = [0.3, 2.0, 1.0, 7.0];
        let sums = sums(&theta);
        let solution = sums.solve(&[None; K]).expect("independent shares");
        for (found, theta) in solution.theta.iter().zip(theta) {
            // Rounding times the condition of the normal matrix.
            assert!((found / theta - 1.0).abs() < 1e-9, "{found} {theta}");
        }
        assert!(solution.chi2 < 1e-12, "{}", solution.chi2);
        // What is given moves to the right.
        let solution = sums
            .solve(&[None, Some(2.0), None, None])
            .expect("independent shares");
        assert!((solution.theta[3] / 7.0 - 1.0).abs() < 1e-9);
        assert_eq!(solution.standard_errors[1], 0.0);
        let wrong = sums
            .solve(&[None, Some(3.0), None, None])
            .expect("independent shares");
        assert!(wrong.chi2 > 1.0, "{}", wrong.chi2);
    }

    #[test]
    fn without_innovations_there_is_nothing_to_solve() {
        assert!(matches!(
            InnovationSums::default().solve(&[None; K]),
            Err(Refusal::TooShort { count: 0, .. })
        ));
    }
}
