//! Least squares whose unknowns are variances: none negative, or whole covariances positive semidefinite.

use super::Refusal;
use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};
use std::vec::Vec;

/// Newton steps for one sharpness of the barrier; a few are the rule.
const MOST_STEPS: usize = 60;
/// Newton decrement at which the centre is reached: of an objective in units of the sharpness it is nothing, and well above
/// the rounding of the merit.
const CENTRED: f64 = 1e-2;

/// The θ ≥ 0 that makes ½ θᵀNθ − rᵀθ least, by the active sets of \[LawsonHanson74\].
pub(super) fn nonnegative(
    normal: &DMatrix<f64>,
    right: &DVector<f64>,
) -> Result<DVector<f64>, Refusal> {
    let k = right.len();
    let mut theta = DVector::zeros(k);
    let mut free: Vec<usize> = Vec::new();
    let tolerance = 1e-13 * right.amax();
    for _ in 0..=10 * k {
        let slope = right - normal * &theta;
        let best = (0..k)
            .filter(|i| !free.contains(i) && slope[*i] > tolerance)
            .max_by(|a, b| slope[*a].total_cmp(&slope[*b]));
        let Some(best) = best else {
            return Ok(theta);
        };
        free.push(best);
        loop {
            let target = solve_among(normal, right, &free)?;
            // How far towards it before one of them is zero.
            let limit = free
                .iter()
                .filter(|i| target[**i] <= 0.0)
                .map(|i| theta[*i] / (theta[*i] - target[*i]))
                .fold(1.0, f64::min);
            if free.iter().all(|i| target[*i] > 0.0) {
                theta = target;
                break;
            }
            theta += (target - &theta) * limit.max(0.0);
            free.retain(|i| theta[*i] > tolerance * f64::EPSILON && theta[*i] > 0.0 && *i < k);
            let mut kept = DVector::zeros(k);
            free.iter().for_each(|i| kept[*i] = theta[*i]);
            theta = kept;
            if free.is_empty() {
                break;
            }
        }
    }
    Err(Refusal::NotConverged {
        what: "non-negative least squares",
        iterations: 10 * k,
    })
}

fn solve_among(
    normal: &DMatrix<f64>,
    right: &DVector<f64>,
    free: &[usize],
) -> Result<DVector<f64>, Refusal> {
    let sub = normal.select_rows(free).select_columns(free);
    let solution = Cholesky::new(sub)
        .ok_or(Refusal::NotPositiveDefinite {
            what: "normal matrix",
            remedy: "some unknowns cannot be told apart; ask for fewer",
        })?
        .solve(&right.select_rows(free));
    let mut theta = DVector::zeros(right.len());
    free.iter()
        .zip(solution.iter())
        .for_each(|(i, v)| theta[*i] = *v);
    Ok(theta)
}

/// A covariance that must be positive semidefinite: what is known of it, and a matrix for each unknown.
pub(super) struct Cone {
    pub(super) known: DMatrix<f64>,
    pub(super) matrices: Vec<DMatrix<f64>>,
}

impl Cone {
    pub(super) fn at(&self, theta: &DVector<f64>) -> DMatrix<f64> {
        self.matrices
            .iter()
            .zip(theta.iter())
            .fold(self.known.clone(), |sum, (m, t)| sum + m * *t)
    }

    /// Restricted to the directions in which it can be other than zero: elsewhere its determinant is zero for any θ.
    fn reduced(self) -> Self {
        let reach = self
            .matrices
            .iter()
            .fold(&self.known * &self.known, |sum, m| sum + m * m);
        let eigen = SymmetricEigen::new(reach);
        let largest = eigen.eigenvalues.amax();
        let kept: Vec<usize> = (0..eigen.eigenvalues.len())
            .filter(|i| eigen.eigenvalues[*i] > 1e-24 * largest)
            .collect();
        let basis = eigen.eigenvectors.select_columns(&kept);
        Cone {
            known: basis.transpose() * self.known * &basis,
            matrices: self
                .matrices
                .iter()
                .map(|m| basis.transpose() * m * &basis)
                .collect(),
        }
    }
}

/// The θ that makes ½ θᵀNθ − rᵀθ least with every cone positive semidefinite.
///
/// Logarithmic barrier with Newton steps (\[Boyd04\] chapter 11), to a duality gap of 1e-13 of the objective: the unknowns are
/// few, so that each step costs next to nothing. An unconstrained minimum inside the cones is returned as it is.
pub(super) fn semidefinite(
    normal: &DMatrix<f64>,
    right: &DVector<f64>,
    cones: Vec<Cone>,
) -> Result<DVector<f64>, Refusal> {
    let k = right.len();
    let free = solve_among(normal, right, &(0..k).collect::<Vec<_>>())?;
    let inside = |m: DMatrix<f64>| {
        let values = SymmetricEigen::new(m).eigenvalues;
        values.iter().all(|v| *v >= 0.0)
    };
    if cones.iter().all(|cone| inside(cone.at(&free))) {
        return Ok(free);
    }
    let cones: Vec<Cone> = cones.into_iter().map(Cone::reduced).collect();
    let mut theta = interior(&cones, &free, k)?;
    let objective = |theta: &DVector<f64>| 0.5 * theta.dot(&(normal * theta)) - right.dot(theta);
    let dimension: usize = cones.iter().map(|c| c.known.nrows()).sum();
    let scale = objective(&free).abs().max(f64::MIN_POSITIVE);
    let merit = |theta: &DVector<f64>, sharpness: f64| -> Option<f64> {
        let mut value = sharpness * objective(theta);
        for cone in &cones {
            let factor = Cholesky::new(cone.at(theta))?;
            value -= 2.0
                * factor
                    .l_dirty()
                    .diagonal()
                    .iter()
                    .map(|d| d.ln())
                    .sum::<f64>();
        }
        Some(value)
    };
    let mut sharpness = dimension as f64 / scale;
    loop {
        // To the centre for this sharpness.
        for _ in 0..MOST_STEPS {
            let mut gradient = (normal * &theta - right) * sharpness;
            let mut hessian = normal * sharpness;
            for cone in &cones {
                let inverse = Cholesky::new(cone.at(&theta))
                    .ok_or(Refusal::NotPositiveDefinite {
                        what: "covariance inside the cone",
                        remedy: "scale the unknowns to like sizes",
                    })?
                    .inverse();
                let turned: Vec<DMatrix<f64>> =
                    cone.matrices.iter().map(|m| &inverse * m).collect();
                for i in 0..k {
                    gradient[i] -= turned[i].trace();
                    for j in 0..k {
                        hessian[(i, j)] += turned[i].component_mul(&turned[j].transpose()).sum();
                    }
                }
            }
            let step = Cholesky::new(hessian)
                .ok_or(Refusal::NotPositiveDefinite {
                    what: "normal matrix",
                    remedy: "some unknowns cannot be told apart; ask for fewer",
                })?
                .solve(&-&gradient);
            let decrement = -gradient.dot(&step);
            let here = merit(&theta, sharpness).unwrap_or(f64::INFINITY);
            let mut length = 1.0;
            let mut moved = false;
            while length > 1e-10 {
                let next = &theta + &step * length;
                if merit(&next, sharpness).is_some_and(|m| m <= here - 0.1 * length * decrement) {
                    theta = next;
                    moved = true;
                    break;
                }
                length *= 0.5;
            }
            // At the rounding of the merit no step lowers it any more: that is the centre, too.
            if decrement < CENTRED || !moved {
                break;
            }
        }
        if dimension as f64 / sharpness < 1e-13 * scale {
            return Ok(theta);
        }
        sharpness *= 10.0;
    }
}

/// A start strictly inside: the combination nearest to multiples of identity.
fn interior(cones: &[Cone], free: &DVector<f64>, k: usize) -> Result<DVector<f64>, Refusal> {
    let mut normal = DMatrix::<f64>::zeros(k, k);
    let mut right = DVector::zeros(k);
    for cone in cones {
        let size = cone.at(free).amax().max(f64::MIN_POSITIVE);
        let target = DMatrix::identity(cone.known.nrows(), cone.known.nrows()) * size - &cone.known;
        for i in 0..k {
            right[i] += cone.matrices[i].dot(&target);
            for j in 0..k {
                normal[(i, j)] += cone.matrices[i].dot(&cone.matrices[j]);
            }
        }
    }
    let start = normal
        .svd(true, true)
        .solve(&right, 1e-12)
        .map_err(|_| Refusal::NotFinite { what: "basis" })?;
    if cones.iter().all(|c| Cholesky::new(c.at(&start)).is_some()) {
        Ok(start)
    } else {
        Err(Refusal::NotPositiveDefinite {
            what: "every combination of the basis that was tried",
            remedy: "take a basis that can be near identity, or no constraint",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problem(seed: u64, k: usize) -> (DMatrix<f64>, DVector<f64>) {
        let mut state = seed.wrapping_mul(2).wrapping_add(1);
        let mut next = || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 33) as f64 / (1u64 << 31) as f64 - 0.5
        };
        let a = DMatrix::from_fn(3 * k, k, |_, _| next());
        let b = DVector::from_fn(3 * k, |_, _| next());
        (a.transpose() * &a, a.transpose() * b)
    }

    /// Karush, Kuhn, Tucker: where the unknown is free the slope is zero, at the bound it points outwards.
    #[test]
    fn nonnegative_minimum_satisfies_its_conditions() {
        let mut on_bound = 0;
        for seed in 0..200 {
            let (normal, right) = problem(seed, 5);
            let theta = nonnegative(&normal, &right).expect("converges");
            let slope = &normal * &theta - &right;
            for i in 0..5 {
                assert!(theta[i] >= 0.0 && slope[i] > -1e-12, "{seed}");
                assert!(theta[i] * slope[i].abs() < 1e-12, "{seed}");
                on_bound += usize::from(theta[i] == 0.0);
            }
        }
        assert!(on_bound > 200, "{on_bound}: the bounds matter here");
    }

    fn diagonal_cones(k: usize) -> Vec<Cone> {
        let matrices = (0..k)
            .map(|i| DMatrix::from_fn(k, k, |a, b| f64::from(a == i && b == i)))
            .collect();
        vec![Cone {
            known: DMatrix::zeros(k, k),
            matrices,
        }]
    }

    #[test]
    fn a_diagonal_cone_is_nonnegativity() {
        for seed in 0..100 {
            let (normal, right) = problem(seed, 4);
            let a = nonnegative(&normal, &right).expect("converges");
            let b = semidefinite(&normal, &right, diagonal_cones(4)).expect("converges");
            // Along a free direction the gap of 1e-13 is 1e-6 at worst, the smallest curvature being a tenth.
            assert!((&a - &b).amax() < 2e-6, "{seed}: {a} {b}");
            let objective = |t: &DVector<f64>| 0.5 * t.dot(&(&normal * t)) - right.dot(t);
            assert!((objective(&a) - objective(&b)).abs() < 1e-12, "{seed}");
        }
    }

    /// The nearest positive semidefinite matrix has the negative eigenvalues set to zero (\[Higham88\]).
    #[test]
    fn nearest_covariance_is_the_one_without_negative_eigenvalues() {
        let target =
            DMatrix::from_row_slice(3, 3, &[1.0, 1.4, 0.2, 1.4, 1.0, -0.5, 0.2, -0.5, 0.3]);
        let pairs = [(0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2)];
        let matrices: Vec<_> = pairs
            .iter()
            .map(|&(a, b)| {
                DMatrix::from_fn(3, 3, |i, j| f64::from((i, j) == (a, b) || (j, i) == (a, b)))
            })
            .collect();
        let normal = DMatrix::from_fn(6, 6, |i, j| matrices[i].dot(&matrices[j]));
        let right = DVector::from_fn(6, |i, _| matrices[i].dot(&target));
        let cone = || Cone {
            known: DMatrix::zeros(3, 3),
            matrices: matrices.clone(),
        };
        let theta = semidefinite(&normal, &right, vec![cone()]).expect("converges");
        let mut eigen = SymmetricEigen::new(target);
        assert!(eigen.eigenvalues.min() < -0.3);
        eigen.eigenvalues.apply(|v| *v = v.max(0.0));
        assert!((cone().at(&theta) - eigen.recompose()).amax() < 1e-6);
    }
}
