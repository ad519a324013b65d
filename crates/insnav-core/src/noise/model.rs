//! A linear time-invariant model, its stationary filter, and the innovations of that filter.

use super::Refusal;
use nalgebra::{Cholesky, DMatrix};
use std::format;
use std::vec::Vec;

/// Doublings after which an iteration that has not come to its end never will: 2⁵⁰ steps.
const MOST_DOUBLINGS: usize = 50;

/// x₊ = F x + G w, y = H x + v with white w and v.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearModel {
    /// Transition over one step, n × n.
    pub f: DMatrix<f64>,
    /// Where the process noise enters, n × g.
    pub g: DMatrix<f64>,
    /// What is measured, p × n.
    pub h: DMatrix<f64>,
}

impl LinearModel {
    /// Number of states, n.
    pub fn states(&self) -> usize {
        self.f.nrows()
    }

    /// Number of components of the measurement, p.
    pub fn channels(&self) -> usize {
        self.h.nrows()
    }

    /// That the matrices fit together and are finite.
    ///
    /// # Errors
    /// [`Refusal::Shape`], [`Refusal::NotFinite`].
    pub fn check(&self) -> Result<(), Refusal> {
        let n = self.f.nrows();
        shape("F", &self.f, n, n)?;
        shape("G", &self.g, n, self.g.ncols())?;
        shape("H", &self.h, self.h.nrows(), n)?;
        if n == 0 || self.channels() == 0 {
            return Err(Refusal::Shape {
                what: "model",
                found: format!("{n} states, {} measurements", self.channels()),
                expected: "at least one of each".into(),
            });
        }
        Ok(())
    }

    /// F − F L H, which moves the error of a filter with gain L from one prediction to the next.
    pub fn closed_loop(&self, gain: &DMatrix<f64>) -> DMatrix<f64> {
        &self.f - &self.f * gain * &self.h
    }

    /// Gain and predicted covariance of the stationary Kalman filter with the noise Q (g × g) and R (p × p).
    ///
    /// By the structure-preserving doubling algorithm (\[Chu04\]), whose k-th step is the Riccati equation after 2ᵏ samples.
    ///
    /// # Errors
    /// [`Refusal::NoStationaryFilter`] when R is not positive definite or the iteration does not settle,
    /// [`Refusal::Unstable`] when the loop with the gain found is not stable (a state without noise that does not decay).
    pub fn stationary_filter(
        &self,
        q: &DMatrix<f64>,
        r: &DMatrix<f64>,
    ) -> Result<StationaryFilter, Refusal> {
        let n = self.states();
        let r_inverse = Cholesky::new(r.clone())
            .ok_or(Refusal::NoStationaryFilter {
                reason: "R is not positive definite",
            })?
            .inverse();
        let mut a = self.f.transpose();
        let mut g = self.h.transpose() * r_inverse * &self.h;
        let mut p = &self.g * q * self.g.transpose();
        let mut settled = false;
        for _ in 0..MOST_DOUBLINGS {
            let lu = (DMatrix::identity(n, n) + &g * &p).lu();
            let (Some(wa), Some(wg)) = (lu.solve(&a), lu.solve(&g)) else {
                break;
            };
            let dp = a.transpose() * &p * &wa;
            let dg = &a * wg * a.transpose();
            a = &a * wa;
            g = symmetric(g + dg);
            let change = dp.amax();
            p = symmetric(p + dp);
            if !p.iter().all(|v| v.is_finite()) {
                break;
            }
            // The step after the next would change less than the rounding.
            if change <= 1e-14 * p.amax() {
                settled = true;
                break;
            }
        }
        if !settled {
            return Err(Refusal::NoStationaryFilter {
                reason: "the Riccati equation does not settle: a state without noise that does not decay, or that no measurement shows",
            });
        }
        let innovation = &self.h * &p * self.h.transpose() + r;
        let gain = Cholesky::new(symmetric(innovation))
            .ok_or(Refusal::NoStationaryFilter {
                reason: "the innovation covariance is not positive definite",
            })?
            .solve(&(&self.h * &p))
            .transpose();
        powers_until_gone(&self.closed_loop(&gain))?;
        Ok(StationaryFilter { gain, predicted: p })
    }
}

/// The stationary Kalman filter of a model.
#[derive(Clone, Debug, PartialEq)]
pub struct StationaryFilter {
    /// L (n × p), which corrects the predicted state.
    pub gain: DMatrix<f64>,
    /// Covariance of the predicted state.
    pub predicted: DMatrix<f64>,
}

pub(super) fn symmetric(m: DMatrix<f64>) -> DMatrix<f64> {
    (&m + m.transpose()) * 0.5
}

pub(super) fn shape(
    what: &'static str,
    matrix: &DMatrix<f64>,
    rows: usize,
    columns: usize,
) -> Result<(), Refusal> {
    if matrix.shape() != (rows, columns) {
        return Err(Refusal::Shape {
            what,
            found: format!("{} x {}", matrix.nrows(), matrix.ncols()),
            expected: format!("{rows} x {columns}"),
        });
    }
    if matrix.iter().any(|v| !v.is_finite()) {
        return Err(Refusal::NotFinite { what });
    }
    Ok(())
}

/// A, A², A⁴, A⁸ … until the next one's share in a Lyapunov sum would be lost in rounding.
pub(super) fn powers_until_gone(a: &DMatrix<f64>) -> Result<Vec<DMatrix<f64>>, Refusal> {
    let mut powers = vec![a.clone()];
    loop {
        let last = &powers[powers.len() - 1];
        let size = last.norm();
        // Of the sum of Aᵏ S Aᵏᵀ, what comes after is less than ‖A‖² of what is there.
        if size * size < 1e-17 {
            return Ok(powers);
        }
        if powers.len() > MOST_DOUBLINGS || !size.is_finite() || size > 1e100 {
            // Gelfand: ρ = lim ‖Aᵏ‖^(1/k).
            let steps = 2f64.powi(powers.len() as i32 - 1);
            return Err(Refusal::Unstable {
                spectral_radius: if size.is_finite() {
                    size.powf(1.0 / steps)
                } else {
                    powers[0]
                        .complex_eigenvalues()
                        .iter()
                        .map(|l| l.norm())
                        .fold(0.0, f64::max)
                },
            });
        }
        powers.push(last * last);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stationary_filter_is_the_end_of_the_recursion() {
        let model = LinearModel {
            f: DMatrix::from_row_slice(2, 2, &[1.0, -0.1, 0.0, 0.99]),
            g: DMatrix::identity(2, 2),
            h: DMatrix::from_row_slice(1, 2, &[1.0, 0.0]),
        };
        let q = DMatrix::from_diagonal(&nalgebra::DVector::from_vec(vec![1e-3, 1e-5]));
        let r = DMatrix::from_element(1, 1, 0.5);
        let filter = model.stationary_filter(&q, &r).expect("stable");
        let mut p = DMatrix::identity(2, 2);
        for _ in 0..20_000 {
            let s = (&model.h * &p * model.h.transpose() + &r)[0];
            let gain = &p * model.h.transpose() / s;
            let updated = &p - &gain * &model.h * &p;
            p = symmetric(&model.f * updated * model.f.transpose() + &q);
        }
        // Twenty thousand rounded steps.
        assert!((&filter.predicted - &p).amax() < 1e-12 * p.amax());
    }

    #[test]
    fn no_filter_where_nothing_settles() {
        let walk = |q: f64, h: f64| {
            LinearModel {
                f: DMatrix::identity(1, 1),
                g: DMatrix::identity(1, 1),
                h: DMatrix::from_element(1, 1, h),
            }
            .stationary_filter(&DMatrix::from_element(1, 1, q), &DMatrix::identity(1, 1))
        };
        assert!(walk(1.0, 1.0).is_ok());
        // A constant is known ever better: no stationary gain. A walk that nothing shows grows for ever.
        assert!(walk(0.0, 1.0).is_err());
        assert!(walk(1.0, 0.0).is_err());
    }

    #[test]
    fn unstable_loops_are_told_with_their_radius() {
        let a = DMatrix::from_row_slice(2, 2, &[1.02, 5.0, 0.0, 0.3]);
        let Err(Refusal::Unstable { spectral_radius }) = powers_until_gone(&a) else {
            panic!("unstable")
        };
        assert!((spectral_radius - 1.02).abs() < 0.01, "{spectral_radius}");
        assert!(powers_until_gone(&DMatrix::from_element(1, 1, 0.99999)).is_ok());
    }
}
