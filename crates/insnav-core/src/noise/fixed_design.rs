//! Autocovariance least squares for sizes known beforehand.

use crate::error::{Error, Result};
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{SMatrix, SVector};

/// Doublings after which a loop counts as unstable: 2⁴⁰ steps.
const MOST_DOUBLINGS: usize = 40;
/// Pivot of the scaled normal matrix below which unknowns cannot be told apart.
const LEAST_PIVOT: f64 = 1e-12;

/// A matrix Bᵢ of an unknown factor, in the state's or the measurement's coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FixedUnknown<const N: usize, const P: usize> {
    /// Of the process noise: G Bᵢ Gᵀ, n × n.
    Process(SMatrix<f64, N, N>),
    /// Of the measurement noise, p × p.
    Measurement(SMatrix<f64, P, P>),
}

/// [`als_design`](super::als_design) with `N` states, `P` measurements and `K` unknowns: no allocation, no `std`.
///
/// The matrix A is never formed. All lags follow from one n × p share of each unknown, Cⱼ = H F̄ʲ⁻¹ Zᵢ, so that the normal
/// equations need only Σ F̄ʲᵀHᵀH F̄ʲ and Σ F̄ʲᵀHᵀ Ĉⱼ₊₁: of forty lags a tenth of the work.
#[derive(Clone, Debug, PartialEq)]
pub struct FixedDesign<const N: usize, const P: usize, const K: usize> {
    h: SMatrix<f64, P, N>,
    closed: SMatrix<f64, N, N>,
    at_once: [SMatrix<f64, P, P>; K],
    shares: [SMatrix<f64, N, P>; K],
}

impl<const N: usize, const P: usize, const K: usize> FixedDesign<N, P, K> {
    /// The design for a fixed gain, which corrects the predicted state.
    ///
    /// # Errors
    /// [`Error::NotObservable`] when F − F L H is not stable.
    pub fn new(
        f: &SMatrix<f64, N, N>,
        h: &SMatrix<f64, P, N>,
        gain: &SMatrix<f64, N, P>,
        unknowns: &[FixedUnknown<N, P>; K],
    ) -> Result<Self> {
        let fl = f * gain;
        let closed = f - fl * h;
        // Unknowns side by side: one instruction for several of them.
        let mut sums = [[[0.0; K]; N]; N];
        for (k, unknown) in unknowns.iter().enumerate() {
            let enters = match unknown {
                FixedUnknown::Process(q) => *q,
                FixedUnknown::Measurement(r) => fl * r * fl.transpose(),
            };
            for i in 0..N {
                for j in 0..N {
                    sums[i][j][k] = enters[(i, j)];
                }
            }
        }
        lyapunov(&closed, &mut sums)?;
        let mut at_once = [SMatrix::zeros(); K];
        let mut shares = [SMatrix::zeros(); K];
        for (k, unknown) in unknowns.iter().enumerate() {
            let covariance = SMatrix::<f64, N, N>::from_fn(|i, j| sums[i][j][k]);
            let across = covariance * h.transpose();
            at_once[k] = h * across;
            shares[k] = closed * across;
            if let FixedUnknown::Measurement(r) = unknown {
                at_once[k] += r;
                shares[k] -= fl * r;
            }
        }
        Ok(FixedDesign {
            h: *h,
            closed,
            at_once,
            shares,
        })
    }

    /// Cⱼ of the innovations for given factors.
    pub fn covariances<const J: usize>(&self, theta: &[f64; K]) -> [SMatrix<f64, P, P>; J] {
        let mut values = [SMatrix::zeros(); J];
        let mut share = SMatrix::zeros();
        for (k, factor) in theta.iter().enumerate() {
            values[0] += self.at_once[k] * *factor;
            share += self.shares[k] * *factor;
        }
        for value in &mut values[1..] {
            *value = self.h * share;
            share = self.closed * share;
        }
        values
    }

    /// The factors, none negative, that come nearest to measured lag covariances; all elements weigh alike.
    ///
    /// # Errors
    /// [`Error::NotObservable`] when the lags cannot tell the unknowns apart.
    pub fn solve<const J: usize>(&self, covariances: &[SMatrix<f64, P, P>; J]) -> Result<[f64; K]> {
        let mut gram = SMatrix::<f64, N, N>::zeros();
        let mut seen = SMatrix::<f64, N, P>::zeros();
        let mut observe = self.h;
        for measured in &covariances[1..] {
            let transposed = observe.transpose();
            gram += transposed * observe;
            seen += transposed * measured;
            observe *= self.closed;
        }
        let mut normal = SMatrix::<f64, K, K>::zeros();
        let mut right = SVector::<f64, K>::zeros();
        for i in 0..K {
            let turned = gram * self.shares[i];
            for j in 0..=i {
                let value = turned.dot(&self.shares[j]) + self.at_once[i].dot(&self.at_once[j]);
                normal[(i, j)] = value;
                normal[(j, i)] = value;
            }
            right[i] = seen.dot(&self.shares[i]) + covariances[0].dot(&self.at_once[i]);
        }
        let lengths = SVector::<f64, K>::from_fn(|i, _| normal[(i, i)].sqrt());
        let inverse = lengths.map(|length| 1.0 / length);
        let scaled = SMatrix::<f64, K, K>::from_fn(|i, j| normal[(i, j)] * inverse[i] * inverse[j]);
        let theta = nonnegative(&scaled, &right.component_mul(&inverse))?;
        Ok(core::array::from_fn(|i| theta[i] * inverse[i]))
    }
}

/// P = F̄ P F̄ᵀ + S for all S at once, in place: Smith's doubling, P ← P + A P Aᵀ, A ← A².
fn lyapunov<const N: usize, const K: usize>(
    closed: &SMatrix<f64, N, N>,
    sums: &mut [[[f64; K]; N]; N],
) -> Result<()> {
    let mut power = *closed;
    let mut left = [[[0.0; K]; N]; N];
    for _ in 0..MOST_DOUBLINGS {
        let size = power.norm_squared();
        if !size.is_finite() {
            break;
        }
        for_rows(&power, sums, &mut left);
        // What comes after is less than ‖A²‖² ≤ size² of what is there.
        if size * size < 1e-17 {
            return Ok(());
        }
        power *= power;
    }
    Err(Error::NotObservable {
        what: "noise",
        reason: "the closed loop F (I - L H) is not stable",
    })
}

/// P ← P + A P Aᵀ, by way of `left` = A P.
#[inline]
fn for_rows<const N: usize, const K: usize>(
    a: &SMatrix<f64, N, N>,
    sums: &mut [[[f64; K]; N]; N],
    left: &mut [[[f64; K]; N]; N],
) {
    for i in 0..N {
        let factor = a[(i, 0)];
        for j in 0..N {
            left[i][j] = sums[0][j].map(|value| factor * value);
        }
        for m in 1..N {
            let factor = a[(i, m)];
            for j in 0..N {
                for k in 0..K {
                    left[i][j][k] += factor * sums[m][j][k];
                }
            }
        }
    }
    for i in 0..N {
        for j in 0..=i {
            let mut value = sums[i][j];
            for m in 0..N {
                let factor = a[(j, m)];
                for k in 0..K {
                    value[k] += factor * left[i][m][k];
                }
            }
            sums[i][j] = value;
            sums[j][i] = value;
        }
    }
}

/// ½ θᵀNθ − rᵀθ least with θ ≥ 0, by active sets (\[LawsonHanson74\]); a bound unknown is a row of identity.
fn nonnegative<const K: usize>(
    normal: &SMatrix<f64, K, K>,
    right: &SVector<f64, K>,
) -> Result<SVector<f64, K>> {
    let singular = Error::NotObservable {
        what: "noise",
        reason: "the lags cannot tell all unknowns apart",
    };
    let mut free = [true; K];
    // Nearly always all are positive: begin with all of them free.
    let mut theta = solve_free(normal, right, &free).ok_or(singular)?;
    if theta.min() >= 0.0 {
        return Ok(theta);
    }
    free = [false; K];
    theta = SVector::zeros();
    let tolerance = 1e-13 * right.amax();
    for _ in 0..10 * K {
        let slope = right - normal * theta;
        let best = (0..K)
            .filter(|i| !free[*i] && slope[*i] > tolerance)
            .max_by(|a, b| slope[*a].total_cmp(&slope[*b]));
        let Some(best) = best else {
            return Ok(theta);
        };
        free[best] = true;
        loop {
            let target = solve_free(normal, right, &free).ok_or(singular)?;
            if (0..K).all(|i| !free[i] || target[i] > 0.0) {
                theta = target;
                break;
            }
            let mut limit = (1.0, best);
            for i in (0..K).filter(|i| free[*i] && target[*i] <= 0.0) {
                let way = theta[i] / (theta[i] - target[i]);
                if way <= limit.0 {
                    limit = (way, i);
                }
            }
            theta += (target - theta) * limit.0;
            theta[limit.1] = 0.0;
            free[limit.1] = false;
        }
    }
    Err(Error::NotObservable {
        what: "noise",
        reason: "non-negative least squares did not converge",
    })
}

fn solve_free<const K: usize>(
    normal: &SMatrix<f64, K, K>,
    right: &SVector<f64, K>,
    free: &[bool; K],
) -> Option<SVector<f64, K>> {
    // L D Lᵀ by columns, in place.
    let mut m = *normal;
    let mut x = *right;
    for i in (0..K).filter(|i| !free[*i]) {
        m.row_mut(i).fill(0.0);
        m.column_mut(i).fill(0.0);
        m[(i, i)] = 1.0;
        x[i] = 0.0;
    }
    for j in 0..K {
        let pivot = m[(j, j)];
        if pivot.is_nan() || pivot <= LEAST_PIVOT {
            return None;
        }
        for c in j + 1..K {
            let factor = m[(c, j)] / pivot;
            for r in c..K {
                m[(r, c)] -= m[(r, j)] * factor;
            }
        }
        let inverse = 1.0 / pivot;
        for r in j + 1..K {
            m[(r, j)] *= inverse;
            x[r] -= m[(r, j)] * x[j];
        }
    }
    for j in (0..K).rev() {
        x[j] /= m[(j, j)];
        for r in j + 1..K {
            x[j] -= m[(r, j)] * x[r];
        }
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix1, Matrix1x2, Matrix2, Matrix2x1};

    fn design() -> FixedDesign<2, 1, 3> {
        FixedDesign::new(
            &Matrix2::new(1.0, -0.032, 0.0, 0.99),
            &Matrix1x2::new(1.0, 0.0),
            &Matrix2x1::new(0.2, -0.1),
            &[
                FixedUnknown::Process(Matrix2::new(1.0, 0.0, 0.0, 0.0)),
                FixedUnknown::Process(Matrix2::new(0.0, 0.0, 0.0, 1.0)),
                FixedUnknown::Measurement(Matrix1::new(1.0)),
            ],
        )
        .expect("stable")
    }

    #[test]
    fn equals_the_closed_form_of_a_channel() {
        let channel = crate::noise::ChannelDesign::<40>::new(
            &Matrix2::new(1.0, -0.032, 0.0, 0.99),
            &Matrix1x2::new(1.0, 0.0),
            &Matrix2x1::new(0.2, -0.1),
        )
        .expect("stable");
        for theta in [[2e-3, 3e-4, 0.5], [1.0, 0.0, 0.0]] {
            let a = channel.covariances(theta);
            let b = design().covariances::<40>(&theta);
            assert!(
                a.iter()
                    .zip(&b)
                    .all(|(a, b)| (a - b[0]).abs() < 1e-12 * a.abs().max(1e-3))
            );
        }
    }

    #[test]
    fn exact_covariances_give_the_noise_back_and_bounds_hold() {
        let theta = [2e-3, 3e-4, 0.5];
        let found = design()
            .solve(&design().covariances::<40>(&theta))
            .expect("identified");
        assert!(
            found
                .iter()
                .zip(&theta)
                .all(|(a, b)| (a / b - 1.0).abs() < 1e-9),
            "{found:?}"
        );
        let beyond = design().covariances::<40>(&[-2e-3, 3e-4, 0.5]);
        let found = design().solve(&beyond).expect("identified");
        let channel = crate::noise::ChannelDesign::<40>::new(
            &Matrix2::new(1.0, -0.032, 0.0, 0.99),
            &Matrix1x2::new(1.0, 0.0),
            &Matrix2x1::new(0.2, -0.1),
        )
        .expect("stable")
        .solve(&beyond.map(|m| m[0]), [None; 3])
        .expect("identified");
        assert!(
            found
                .iter()
                .zip(&channel)
                .all(|(a, b)| (a - b).abs() < 1e-9),
            "{found:?} {channel:?}"
        );
    }

    #[test]
    fn unstable_loops_are_refused() {
        let unstable = FixedDesign::<1, 1, 1>::new(
            &Matrix1::new(1.0),
            &Matrix1::new(1.0),
            &Matrix1::new(0.0),
            &[FixedUnknown::Process(Matrix1::new(1.0))],
        );
        assert!(unstable.is_err());
    }
}
