//! How far Allan variances scatter, and their fit.

use super::cone::nonnegative;
use super::{AllanPoint, LARGEST_CHI2_PER_DOF, Refusal};
use nalgebra::{Cholesky, DMatrix, DVector};
use std::f64::consts::{LN_2, PI};
use std::vec::Vec;

/// Averaging times further apart than this hardly share what they see.
const LARGEST_RATIO: f64 = 24.0;
/// Points at which the shorter average is sampled in a sum over lags.
const POINTS: f64 = 8.0;
/// Lags beyond this multiple of the longer average add nothing: second differences of flicker noise are all but uncorrelated.
const REACH: f64 = 3.0;
/// Rounds of fit and weight.
const ROUNDS: usize = 5;
/// Averaging times nearer than this are as good as one: between two to a doubling there is nothing new, but a covariance that is
/// all but singular.
const LEAST_RATIO: f64 = 1.4;

/// A mixture of white noise, flicker noise and random walk of a rate, by N², B², K².
pub(super) struct Spectrum {
    squares: [f64; 3],
    step_s: f64,
}

impl Spectrum {
    pub(super) fn new(squares: [f64; 3], step_s: f64) -> Self {
        Spectrum { squares, step_s }
    }

    /// Allan variance at τ.
    pub(super) fn variance(&self, tau: f64) -> f64 {
        self.variances(tau).iter().sum()
    }

    /// What each of the three has in it.
    pub(super) fn variances(&self, tau: f64) -> [f64; 3] {
        let shapes = shapes(tau);
        core::array::from_fn(|i| shapes[i] * self.squares[i])
    }

    /// Generalised autocovariance of the integral: second differences of it are those of the noise (\[Greenhall03\]).
    fn structure(&self, t: f64) -> f64 {
        let t = t.abs();
        let [white, flicker, walk] = self.squares;
        let logarithm = if t > 0.0 && flicker > 0.0 {
            t.ln()
        } else {
            0.0
        };
        t * (-0.5 * white + t * (flicker / (2.0 * PI) * logarithm + t * walk / 12.0))
    }

    /// Covariance of two overlapping Allan variances of one record.
    ///
    /// Of Gaussian noise, cov = 2 Σ Σ R² / (n₁ n₂ · 2τ₁² · 2τ₂²), R the covariance of a second difference over τ₁ with one over τ₂.
    pub(super) fn covariance(&self, a: &AllanPoint, b: &AllanPoint) -> f64 {
        let (a, b) = if a.samples <= b.samples {
            (a, b)
        } else {
            (b, a)
        };
        if b.samples as f64 > LARGEST_RATIO * a.samples as f64 {
            return 0.0;
        }
        let stride = ((a.samples as f64 / POINTS) as usize).max(1);
        let (n1, n2) = (a.differences as f64, b.differences as f64);
        let most = (REACH * b.samples as f64).min(0.5 * (n1 + n2)) as usize;
        let weights = [1.0, -2.0, 1.0];
        let mut sum = 0.0;
        let mut lag = 0;
        while lag <= most {
            let u = lag as f64 * self.step_s;
            let mut r = 0.0;
            for (i, wi) in weights.iter().enumerate() {
                for (j, wj) in weights.iter().enumerate() {
                    let t = u + (i as f64 - 1.0) * a.tau_s - (j as f64 - 1.0) * b.tau_s;
                    r += wi * wj * self.structure(t);
                }
            }
            // Pairs of differences whose middles are this far apart, on either side.
            let pairs = n1.min(n2).min(0.5 * (n1 + n2) - lag as f64).max(0.0);
            let sides = if lag == 0 { 1.0 } else { 2.0 };
            sum += sides * pairs * r * r;
            lag += stride;
        }
        sum * stride as f64 * 2.0 / (n1 * n2 * 4.0 * (a.tau_s * b.tau_s).powi(2))
    }
}

/// Allan variance at τ for unit N², B², K².
fn shapes(tau: f64) -> [f64; 3] {
    [1.0 / tau, 2.0 * LN_2 / PI, tau / 3.0]
}

/// N², B², K², their standard errors, χ² and how many points it is the sum of.
pub(super) struct Squares {
    pub(super) values: [f64; 3],
    pub(super) errors: [f64; 3],
    pub(super) chi2: f64,
    pub(super) points: usize,
}

impl Squares {
    pub(super) fn dof(&self) -> usize {
        self.points - 3
    }

    pub(super) fn fits(&self) -> bool {
        self.chi2 <= LARGEST_CHI2_PER_DOF * self.dof() as f64
    }
}

/// Generalised least squares of the variances, each round with the covariance of the round before.
pub(super) fn fit(all: &[AllanPoint]) -> Result<Squares, Refusal> {
    let mut points: Vec<AllanPoint> = Vec::with_capacity(all.len());
    for point in all {
        let last = points.last().map_or(0.0, |p| p.tau_s);
        if point.tau_s >= LEAST_RATIO * last {
            points.push(*point);
        }
    }
    let n = points.len();
    if n < 5 {
        return Err(too_few(n));
    }
    let step_s = points[0].tau_s / points[0].samples as f64;
    let columns = DMatrix::from_fn(n, 3, |i, k| shapes(points[i].tau_s)[k]);
    let variances = DVector::from_fn(n, |i, _| points[i].deviation.powi(2));
    let mut squares = [0.0; 3];
    let mut errors = [0.0; 3];
    let mut chi2 = 0.0;
    for round in 0..=ROUNDS {
        let scatter = if round == 0 {
            // Before anything is known: as many degrees of freedom as averages that do not overlap.
            DMatrix::from_diagonal(&DVector::from_fn(n, |i, _| {
                2.0 * variances[i].powi(2) * points[i].samples as f64 / points[i].differences as f64
            }))
        } else {
            // What is not seen may still be there, and what is seen may be more: a variance that came out small by chance would
            // else be sure of itself, since its scatter is proportional to it.
            let possible = core::array::from_fn(|k| squares[k] + errors[k]);
            let spectrum = Spectrum::new(possible, step_s);
            let mut scatter = DMatrix::zeros(n, n);
            for i in 0..n {
                for j in 0..=i {
                    let value = spectrum.covariance(&points[i], &points[j]);
                    scatter[(i, j)] = value;
                    scatter[(j, i)] = value;
                }
            }
            scatter
        };
        let factor = definite(scatter)?;
        let lower = factor.l_dirty();
        let (Some(whitened), Some(right)) = (
            lower.solve_lower_triangular(&columns),
            lower.solve_lower_triangular(&variances),
        ) else {
            return Err(not_definite());
        };
        let lengths: Vec<f64> = whitened.column_iter().map(|c| c.norm()).collect();
        let scaled = DMatrix::from_fn(n, 3, |i, k| whitened[(i, k)] / lengths[k]);
        let normal = scaled.transpose() * &scaled;
        let solution = nonnegative(&normal, &(scaled.transpose() * &right))?;
        let inverse = Cholesky::new(normal).ok_or_else(not_definite)?.inverse();
        for k in 0..3 {
            squares[k] = solution[k] / lengths[k];
            errors[k] = inverse[(k, k)].sqrt() / lengths[k];
        }
        chi2 = (&scaled * &solution - &right).norm_squared();
    }
    Ok(Squares {
        values: squares,
        errors,
        chi2,
        points: n,
    })
}

pub(super) fn too_few(points: usize) -> Refusal {
    Refusal::Shape {
        what: "Allan deviations",
        found: std::format!("{points} averaging times"),
        expected: "at least five, half an octave apart, in rising order and all positive".into(),
    }
}

fn not_definite() -> Refusal {
    Refusal::NotPositiveDefinite {
        what: "covariance of the Allan variances",
        remedy: "give points of one record, each averaging time once",
    }
}

/// Factor of a covariance whose sums were cut short: less correlation until it is positive definite.
fn definite(mut scatter: DMatrix<f64>) -> Result<Cholesky<f64, nalgebra::Dyn>, Refusal> {
    for _ in 0..40 {
        if let Some(factor) = Cholesky::new(scatter.clone()) {
            return Ok(factor);
        }
        let diagonal = scatter.diagonal();
        scatter *= 0.98;
        scatter.set_diagonal(&diagonal);
    }
    Err(not_definite())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(samples: usize, record: usize) -> AllanPoint {
        AllanPoint {
            tau_s: samples as f64,
            samples,
            deviation: 1.0,
            differences: record + 1 - 2 * samples,
        }
    }

    /// Degrees of freedom in the limit of many samples, of \[Greenhall03\] and \[Riley08\]: of white frequency noise
    /// (3(N−1)/2m − 2(N−2)/N) 4m²/(4m²+5).
    #[test]
    fn degrees_of_freedom_of_white_noise() {
        let n = 10_000usize;
        for m in [1usize, 10, 100, 1000] {
            let white = Spectrum::new([1.0, 0.0, 0.0], 1.0);
            let at = point(m, n);
            let edf = 2.0 * white.variance(m as f64).powi(2) / white.covariance(&at, &at);
            let (nf, mf) = (n as f64, m as f64);
            let published = (1.5 * (nf - 1.0) / mf - 2.0 * (nf - 2.0) / nf) * 4.0 * mf * mf
                / (4.0 * mf * mf + 5.0);
            // An approximation in closed form, said to be good to a few percent.
            assert!(
                (edf / published - 1.0).abs() < 0.06,
                "{m}: {edf} {published}"
            );
        }
    }

    #[test]
    fn structure_gives_the_variance() {
        for squares in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
            let noise = Spectrum::new(squares, 1.0);
            for tau in [0.5, 3.0] {
                let second = -8.0 * noise.structure(tau) + 2.0 * noise.structure(2.0 * tau);
                assert!((second / (2.0 * tau * tau) - noise.variance(tau)).abs() < 1e-12);
            }
        }
    }
}
