//! Orientation errors as the BROAD benchmark defines them (\[Laidig21\] section 4.3).

use super::errors::rms;
use nalgebra::{Matrix3, Matrix4, Quaternion, SymmetricEigen, UnitQuaternion};
use serde::Serialize;

/// Errors of an orientation against an optical one, no alignment between them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct OrientationErrors {
    /// Instants scored.
    #[serde(rename = "orientation_count")]
    pub count: usize,
    /// Root mean square of the whole angle 2 acos|w|, degrees.
    pub total_rmse_deg: Option<f64>,
    /// Of the part about the vertical, 2 atan|z/w|.
    pub heading_rmse_deg: Option<f64>,
    /// Of the part about the horizontal, 2 acos √(w² + z²).
    pub inclination_rmse_deg: Option<f64>,
    /// Share of errors inside the 95 % ellipsoid of the stated covariance (three degrees of freedom).
    pub coverage_95: Option<f64>,
}

/// 95 % quantile of the chi-square distribution with three degrees of freedom.
const CHI_SQUARE_3_95: f64 = 7.814_728;

/// Body forward-right-down to NED, turned into body forward-left-up to ENU: the axes of BROAD.
pub fn to_enu_flu(q_nb: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let half = core::f64::consts::FRAC_1_SQRT_2;
    // NED → ENU is half a turn about the horizontal diagonal; FRD → FLU half a turn about forward.
    let enu_ned = UnitQuaternion::new_unchecked(Quaternion::new(0.0, half, half, 0.0));
    let frd_flu = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0));
    enu_ned * q_nb * frd_flu
}

/// An estimate and the truth at one instant, both sensor to ENU.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OrientationPair {
    /// The estimate.
    pub estimate: UnitQuaternion<f64>,
    /// The truth.
    pub truth: UnitQuaternion<f64>,
    /// Covariance of the estimate as a small rotation in ENU, rad².
    pub covariance: Option<Matrix3<f64>>,
}

/// Errors q_estimate ⊗ conj(q_truth) of all instants.
pub fn orientation_errors(pairs: &[OrientationPair]) -> OrientationErrors {
    let errors: Vec<UnitQuaternion<f64>> = pairs
        .iter()
        .map(|p| p.estimate * p.truth.conjugate())
        .collect();
    let of =
        |angle: fn(&UnitQuaternion<f64>) -> f64| rms(errors.iter().map(angle)).map(f64::to_degrees);
    let inside: Vec<bool> = errors
        .iter()
        .zip(pairs)
        .filter_map(|(e, pair)| {
            let phi = crate::attitude::log(e);
            Some(phi.dot(&pair.covariance?.cholesky()?.solve(&phi)) <= CHI_SQUARE_3_95)
        })
        .collect();
    OrientationErrors {
        count: pairs.len(),
        total_rmse_deg: of(|q| 2.0 * q.w.abs().min(1.0).acos()),
        heading_rmse_deg: of(|q| 2.0 * q.k.abs().atan2(q.w.abs())),
        inclination_rmse_deg: of(|q| 2.0 * q.w.hypot(q.k).min(1.0).acos()),
        coverage_95: (!inside.is_empty())
            .then(|| inside.iter().filter(|&&i| i).count() as f64 / inside.len() as f64),
    }
}

/// Passes after which two alignments that depend on one another are left as they are.
const MOST_PASSES: usize = 100;
/// Angle of a pass that ends them, rad.
const ALIGNED: f64 = 1e-9;

/// Take constant rotations out of the estimates: between the earth frames, between the body axes, or both. Returns the angle of the
/// first, rad.
pub(super) fn align(pairs: &mut [OrientationPair], earth: bool, body: bool) -> Option<f64> {
    let mut whole = UnitQuaternion::identity();
    for _ in 0..MOST_PASSES {
        let mut left = 0.0;
        if earth {
            let back = mean_of(pairs, |p| p.estimate * p.truth.conjugate()).conjugate();
            let turn = back.to_rotation_matrix().into_inner();
            for pair in pairs.iter_mut() {
                pair.estimate = back * pair.estimate;
                pair.covariance = pair.covariance.map(|p| turn * p * turn.transpose());
            }
            whole = back * whole;
            left = back.angle();
        }
        if body {
            let back = mean_of(pairs, |p| p.truth.conjugate() * p.estimate).conjugate();
            for pair in pairs.iter_mut() {
                pair.estimate *= back;
            }
            left = f64::max(left, back.angle());
        }
        // One alone is done with the first pass.
        if left < ALIGNED || !(earth && body) {
            break;
        }
    }
    earth.then(|| whole.angle())
}

/// The mean rotation: the unit quaternion that makes Σ (m·eᵢ)² largest (\[Markley07\]). No start value, and any size.
fn mean_of(
    pairs: &[OrientationPair],
    of: impl Fn(&OrientationPair) -> UnitQuaternion<f64>,
) -> UnitQuaternion<f64> {
    let sum = pairs.iter().fold(Matrix4::zeros(), |sum, p| {
        let e = of(p).coords;
        sum + e * e.transpose()
    });
    let eigen = SymmetricEigen::new(sum);
    let mean = eigen.eigenvectors.column(eigen.eigenvalues.imax());
    UnitQuaternion::new_normalize(Quaternion::from(mean.into_owned()))
}

/// The trials of a benchmark in one line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct OrientationMean {
    /// Trials that have a score.
    pub trials: usize,
    /// Mean of the trials' [`OrientationErrors::total_rmse_deg`], every trial with the same weight.
    pub total_rmse_deg: Option<f64>,
    /// Of their heading errors.
    pub heading_rmse_deg: Option<f64>,
    /// Of their inclination errors.
    pub inclination_rmse_deg: Option<f64>,
    /// Share inside the 95 % ellipsoid of all instants of all trials together.
    pub pooled_coverage_95: Option<f64>,
    /// The same share in the trial where it is smallest.
    pub least_coverage_95: Option<f64>,
}

/// Means over trials.
pub fn orientation_mean<'a>(
    trials: impl IntoIterator<Item = &'a OrientationErrors>,
) -> OrientationMean {
    let trials: Vec<&OrientationErrors> = trials.into_iter().filter(|t| t.count > 0).collect();
    let mean = |of: fn(&OrientationErrors) -> Option<f64>| {
        let values: Vec<f64> = trials.iter().filter_map(|t| of(t)).collect();
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    };
    let covered: Vec<(f64, f64)> = trials
        .iter()
        .filter_map(|t| Some((t.coverage_95?, t.count as f64)))
        .collect();
    let instants: f64 = covered.iter().map(|(_, count)| count).sum();
    OrientationMean {
        trials: trials.len(),
        total_rmse_deg: mean(|t| t.total_rmse_deg),
        heading_rmse_deg: mean(|t| t.heading_rmse_deg),
        inclination_rmse_deg: mean(|t| t.inclination_rmse_deg),
        pooled_coverage_95: (instants > 0.0).then(|| {
            covered
                .iter()
                .map(|(share, count)| share * count)
                .sum::<f64>()
                / instants
        }),
        least_coverage_95: covered.iter().map(|(share, _)| *share).reduce(f64::min),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{Euler, exp};
    use nalgebra::Vector3;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    #[test]
    fn heading_and_inclination_split_the_total() {
        let reference = exp(&Vector3::new(0.4, -1.2, 0.3));
        let (heading, inclination) = (0.2_f64, 0.1_f64);
        let error = exp(&Vector3::new(0.0, 0.0, heading))
            * exp(&Vector3::new(0.6 * inclination, 0.8 * inclination, 0.0));
        let e = orientation_errors(&[OrientationPair {
            estimate: error * reference,
            truth: reference,
            covariance: None,
        }]);
        assert!((e.heading_rmse_deg.unwrap().to_radians() - heading).abs() < 1e-9);
        assert!((e.inclination_rmse_deg.unwrap().to_radians() - inclination).abs() < 1e-9);
        // cos(total/2) = cos(heading/2) cos(inclination/2), for the two axes are at right angles.
        let total = 2.0 * ((heading / 2.0).cos() * (inclination / 2.0).cos()).acos();
        assert!((e.total_rmse_deg.unwrap().to_radians() - total).abs() < 1e-9);
        assert_eq!(e.coverage_95, None);
    }

    #[test]
    fn trials_have_the_same_weight_and_instants_are_pooled() {
        let trial = |count, total, coverage_95| OrientationErrors {
            count,
            total_rmse_deg: Some(total),
            coverage_95,
            ..OrientationErrors::default()
        };
        let nothing = OrientationErrors::default();
        let mean = orientation_mean(&[
            trial(100, 1.0, Some(0.9)),
            trial(300, 3.0, Some(0.5)),
            trial(50, 5.0, None),
            nothing,
        ]);
        assert_eq!((mean.trials, mean.total_rmse_deg), (3, Some(3.0)));
        assert_eq!(mean.heading_rmse_deg, None);
        assert_eq!(mean.least_coverage_95, Some(0.5));
        assert!((mean.pooled_coverage_95.unwrap() - 0.6).abs() < 1e-15);
    }

    #[test]
    fn a_constant_turn_of_the_earth_frame_is_taken_out() {
        let turn = exp(&Vector3::new(0.4, -1.2, 2.0));
        let sigma = Vector3::new(0.01, 0.02, 0.05);
        let mut pairs: Vec<_> = (0..8)
            .map(|i| {
                let truth = exp(&Vector3::new(0.1 * f64::from(i), 0.2, -0.3));
                // Errors about all three axes, in opposite pairs.
                let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
                let error = exp(&(Vector3::new(0.02, 0.01, 0.03) * sign));
                let covariance = Matrix3::from_diagonal(&sigma.component_mul(&sigma));
                let turned = turn.to_rotation_matrix().into_inner();
                OrientationPair {
                    estimate: turn * error * truth,
                    truth,
                    covariance: Some(turned * covariance * turned.transpose()),
                }
            })
            .collect();
        let angle = align(&mut pairs, true, false).unwrap();
        assert!((angle - turn.angle()).abs() < 1e-12);
        let left = pairs[0].estimate * pairs[0].truth.conjugate();
        assert!((crate::attitude::log(&left) - Vector3::new(0.02, 0.01, 0.03)).norm() < 1e-12);
        let sigmas = pairs[0].covariance.unwrap().diagonal().map(f64::sqrt);
        assert!((sigmas - sigma).norm() < 1e-12);
    }

    #[test]
    fn a_turn_of_the_body_axes_is_told_from_one_of_the_earth_frame() {
        let (earth, body) = (
            exp(&Vector3::new(0.1, -0.3, 2.0)),
            exp(&Vector3::new(0.05, 0.02, -0.04)),
        );
        let turned = || -> Vec<_> {
            (0..200)
                .map(|i| {
                    let t = 0.1 * f64::from(i);
                    let truth = exp(&Vector3::new(
                        t.sin(),
                        (1.3 * t).cos(),
                        2.0 * (0.7 * t).sin(),
                    ));
                    OrientationPair {
                        estimate: earth * truth * body,
                        truth,
                        covariance: None,
                    }
                })
                .collect()
        };
        let left = |earth: bool, body: bool| {
            let mut pairs = turned();
            align(&mut pairs, earth, body);
            orientation_errors(&pairs).total_rmse_deg.unwrap()
        };
        assert!(left(true, true) < 1e-6, "{}", left(true, true));
        // The body's turn is 3.9°, that of the earth frame 116°.
        assert!(left(true, false) > 2.0 && left(false, true) > 60.0);
    }

    #[test]
    fn axes_of_the_benchmark() {
        // Level and looking east: FLU x is E (1,0,0), y is N, z is U.
        let q = to_enu_flu(&Euler::from_degrees(0.0, 0.0, 90.0).to_quaternion());
        assert!((q * Vector3::x() - Vector3::x()).norm() < 1e-12);
        assert!((q * Vector3::y() - Vector3::y()).norm() < 1e-12);
        assert!((q * Vector3::z() - Vector3::z()).norm() < 1e-12);
    }

    #[test]
    fn the_95_percent_ellipsoid_holds_95_percent() {
        let mut random = Pcg64::new(3, 4);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let sigma = Vector3::new(0.01, 0.02, 0.05);
        let n = 4000;
        let pairs: Vec<_> = (0..n)
            .map(|_| {
                let r = exp(&Vector3::new(normal(), normal(), normal()));
                let e = exp(&sigma.component_mul(&Vector3::new(normal(), normal(), normal())));
                OrientationPair {
                    estimate: e * r,
                    truth: r,
                    covariance: Some(Matrix3::from_diagonal(&sigma.component_mul(&sigma))),
                }
            })
            .collect();
        let got = orientation_errors(&pairs).coverage_95.unwrap();
        assert!(
            (got - 0.95).abs() < 3.0 * (0.95 * 0.05 / f64::from(n)).sqrt(),
            "{got}"
        );
    }
}
