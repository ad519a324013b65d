//! Errors at instants, and their statistics.

use super::reference::ReferencePoint;
use super::track::SolutionPoint;
use crate::attitude::{log, wrap_angle};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::Serialize;

/// A sum of normalised squares and the number of components in it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Normalised {
    sum: f64,
    components: usize,
}

/// Solution minus reference at one instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointError {
    /// NED, m.
    pub position_n: Option<Vector3<f64>>,
    /// NED, m/s; NaN where the reference has no component.
    pub velocity_n: Option<Vector3<f64>>,
    /// Roll, pitch, heading, rad; NaN where the reference has none.
    pub angles: Option<Vector3<f64>>,
    /// Axes of the solution's body in those of the reference's: q_nb(solution) = q_nb(reference) q.
    pub rotation: Option<UnitQuaternion<f64>>,
    /// The same difference as a small rotation about north, east and down, rad: q_nb(solution) = Exp(rotation_n) q_nb(reference).
    pub rotation_n: Option<Vector3<f64>>,
    position_nees: Option<Normalised>,
    velocity_nees: Option<Normalised>,
    attitude_nees: Option<Normalised>,
    /// Size in sigmas of each component of position, else of attitude.
    in_sigmas: Option<Vector3<f64>>,
}

impl PointError {
    /// Of a solution at the reference's point and instant (for velocity: `at_velocity`, where its instant differs).
    pub fn new(
        at: &SolutionPoint,
        at_velocity: &SolutionPoint,
        reference: &ReferencePoint,
    ) -> Self {
        let mut e = PointError::default();
        if let (Some(is), Some(should)) = (at.position, reference.position) {
            let d = should.offset_to(&is);
            e.position_n = Some(d);
            if let Some(p) = at.position_covariance_n {
                let s = p + squared(&reference.position_sigma_n);
                e.position_nees = normalised(&d, &s);
                e.in_sigmas = Some(in_sigmas(&d, &s));
            }
        }
        if let (Some(is), Some(should)) = (at_velocity.velocity_n, reference.velocity_n) {
            let d = is - should;
            e.velocity_n = Some(d);
            if let Some(p) = at_velocity.velocity_covariance_n {
                e.velocity_nees = normalised(&d, &(p + squared(&reference.velocity_sigma_n)));
            }
        }
        let Some(is) = at.q_nb else { return e };
        let euler = crate::attitude::Euler::from_quaternion(&is);
        let d = Vector3::new(euler.roll, euler.pitch, euler.heading) - reference.angles();
        if d.iter().any(|a| a.is_finite()) {
            e.angles = Some(d.map(wrap_angle));
        }
        if let Some(should) = reference.q_nb() {
            e.rotation = Some(should.inverse() * is);
            // true = Exp(φ) estimate, so −φ is the solution's error as a small rotation in n.
            let phi = log(&(should * is.inverse()));
            e.rotation_n = Some(-phi);
            if let Some(p) = at.attitude_covariance_n {
                e.attitude_nees = normalised(&phi, &p);
                e.in_sigmas = e.in_sigmas.or(Some(in_sigmas(&phi, &p)));
            }
        }
        e
    }

    /// eᵀ P⁻¹ e of position, velocity and attitude per component compared, with the reference's own sigmas in P; `None` without a
    /// covariance. [`Nees`] is the mean of such numbers.
    pub fn nees(&self) -> Nees {
        let mean = |n: Option<Normalised>| n.map(|n| n.sum / n.components as f64);
        Nees {
            position: mean(self.position_nees),
            velocity: mean(self.velocity_nees),
            attitude: mean(self.attitude_nees),
        }
    }
}

pub(super) fn squared(sigma: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_diagonal(&sigma.map(|s| if s.is_finite() { s * s } else { 0.0 }))
}

fn in_sigmas(error: &Vector3<f64>, covariance: &Matrix3<f64>) -> Vector3<f64> {
    error
        .component_div(&covariance.diagonal().map(f64::sqrt))
        .abs()
}

/// eᵀ S⁻¹ e over the finite components; `None` when S is not positive definite.
fn normalised(error: &Vector3<f64>, covariance: &Matrix3<f64>) -> Option<Normalised> {
    let mut e = *error;
    let mut s = *covariance;
    let mut components = 3;
    for i in 0..3 {
        if !e[i].is_finite() {
            // A component of zero with a variance of its own adds nothing: the rest is the marginal distribution.
            e[i] = 0.0;
            s.row_mut(i).fill(0.0);
            s.column_mut(i).fill(0.0);
            s[(i, i)] = 1.0;
            components -= 1;
        }
    }
    let sum = e.dot(&s.cholesky()?.solve(&e));
    (components > 0 && sum.is_finite()).then_some(Normalised { sum, components })
}

/// Mean normalised estimation error squared, per degree of freedom: 1 for a solution whose covariance is right,
/// larger for one that is too sure of itself (\[BarShalom01\] section 5.4.2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Nees {
    /// Of the position.
    pub position: Option<f64>,
    /// Of the velocity.
    pub velocity: Option<f64>,
    /// Of the attitude as a small rotation.
    pub attitude: Option<f64>,
}

/// Share of error components (of position; of attitude where the reference has no position) within their sigmas.
///
/// A Gaussian error with the right covariance gives 0.683, 0.954 and 0.997.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Coverage {
    /// Within one sigma.
    pub one_sigma: Option<f64>,
    /// Within two.
    pub two_sigma: Option<f64>,
    /// Within three.
    pub three_sigma: Option<f64>,
}

/// Statistics of the errors of a class of instants. `None` where the solution or the reference has no such quantity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ErrorStatistics {
    /// Instants compared.
    pub count: usize,
    /// Root mean square of the horizontal distance, m.
    pub horizontal_rms_m: Option<f64>,
    /// 95th percentile of it.
    pub horizontal_p95_m: Option<f64>,
    /// Largest.
    pub horizontal_max_m: Option<f64>,
    /// Root mean square of the height error, m.
    pub height_rms_m: Option<f64>,
    /// Root mean square of the velocity error's length, m/s: of the horizontal part where the reference has no vertical one.
    pub velocity_rms_m_per_s: Option<f64>,
    /// Root mean square of the roll error, degrees.
    pub roll_rms_deg: Option<f64>,
    /// Of the pitch error.
    pub pitch_rms_deg: Option<f64>,
    /// Of the heading error.
    pub heading_rms_deg: Option<f64>,
    /// Constant part of the attitude error as a mounting of the solution's axes against the reference's: roll, pitch,
    /// heading, degrees.
    pub mounting_deg: [Option<f64>; 3],
    /// Normalised errors.
    pub nees: Nees,
    /// Share of errors within their sigmas.
    pub coverage: Coverage,
}

impl ErrorStatistics {
    /// Of errors. `mounting_deg` is left empty: it is not a statistic of errors from which it may have been taken out.
    pub fn of<'a>(errors: impl IntoIterator<Item = &'a PointError>) -> Self {
        let errors: Vec<&PointError> = errors.into_iter().collect();
        let mut horizontal: Vec<f64> = errors
            .iter()
            .filter_map(|e| Some(e.position_n?.xy().norm()))
            .collect();
        horizontal.sort_by(f64::total_cmp);
        let angle = |i: usize| {
            rms(errors
                .iter()
                .filter_map(|e| Some(e.angles?[i]))
                .filter(|a| a.is_finite()))
            .map(f64::to_degrees)
        };
        let nees = |of: fn(&PointError) -> Option<Normalised>| {
            let (sum, components) = errors
                .iter()
                .filter_map(|e| of(e))
                .fold((0.0, 0), |(sum, components), n| {
                    (sum + n.sum, components + n.components)
                });
            (components > 0).then(|| sum / components as f64)
        };
        let sigmas: Vec<f64> = errors
            .iter()
            .filter_map(|e| e.in_sigmas)
            .flat_map(|v| [v.x, v.y, v.z])
            .filter(|s| s.is_finite())
            .collect();
        let within = |k: f64| {
            (!sigmas.is_empty())
                .then(|| sigmas.iter().filter(|&&s| s <= k).count() as f64 / sigmas.len() as f64)
        };
        ErrorStatistics {
            count: errors.len(),
            horizontal_rms_m: rms(horizontal.iter().copied()),
            horizontal_p95_m: percentile(&horizontal, 0.95),
            horizontal_max_m: horizontal.last().copied(),
            height_rms_m: rms(errors.iter().filter_map(|e| Some(e.position_n?.z))),
            velocity_rms_m_per_s: rms(errors
                .iter()
                .filter_map(|e| length_of_finite(&e.velocity_n?))),
            roll_rms_deg: angle(0),
            pitch_rms_deg: angle(1),
            heading_rms_deg: angle(2),
            mounting_deg: [None; 3],
            nees: Nees {
                position: nees(|e| e.position_nees),
                velocity: nees(|e| e.velocity_nees),
                attitude: nees(|e| e.attitude_nees),
            },
            coverage: Coverage {
                one_sigma: within(1.0),
                two_sigma: within(2.0),
                three_sigma: within(3.0),
            },
        }
    }
}

fn length_of_finite(v: &Vector3<f64>) -> Option<f64> {
    let horizontal = v.xy().norm_squared();
    horizontal
        .is_finite()
        .then(|| (horizontal + if v.z.is_finite() { v.z * v.z } else { 0.0 }).sqrt())
}

pub(super) fn rms(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (count, sum) = values
        .into_iter()
        .fold((0_usize, 0.0), |(n, s), v| (n + 1, s + v * v));
    (count > 0).then(|| (sum / count as f64).sqrt())
}

/// The value below which `share` of the sorted values lie, interpolated between neighbours.
pub(super) fn percentile(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let at = share * last as f64;
    let low = (at as usize).min(last);
    let high = (low + 1).min(last);
    Some(sorted[low] + (sorted[high] - sorted[low]) * (at - low as f64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{Euler, exp};
    use crate::earth::Geodetic;
    use crate::metrics::AttitudeReference;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    const AT: Geodetic = Geodetic {
        latitude: 0.9,
        longitude: -1.0,
        height: 50.0,
    };

    fn reference() -> ReferencePoint {
        ReferencePoint {
            position: Some(AT),
            velocity_n: Some(Vector3::new(3.0, 4.0, 0.0)),
            attitude: AttitudeReference::Quaternion(
                Euler::from_degrees(1.0, 2.0, 179.0).to_quaternion(),
            ),
            ..ReferencePoint::default()
        }
    }

    fn solution(dp: Vector3<f64>, dv: Vector3<f64>, attitude: Euler) -> SolutionPoint {
        SolutionPoint {
            position: Some(AT.offset(&dp)),
            velocity_n: Some(Vector3::new(3.0, 4.0, 0.0) + dv),
            q_nb: Some(attitude.to_quaternion()),
            ..SolutionPoint::default()
        }
    }

    #[test]
    fn statistics_of_four_known_errors() {
        let of = |n: f64, e: f64, d: f64, heading_deg: f64| {
            let s = solution(
                Vector3::new(n, e, d),
                Vector3::new(0.0, 0.0, n),
                Euler::from_degrees(1.5, 2.0, heading_deg),
            );
            PointError::new(&s, &s, &reference())
        };
        // Horizontal 0, 5, 10, 13; heights 0, 1, 2, 3; headings +0, +2 (across 180°), −2, +4.
        let errors = [
            of(0.0, 0.0, 0.0, 179.0),
            of(3.0, 4.0, 1.0, -179.0),
            of(6.0, 8.0, 2.0, 177.0),
            of(5.0, 12.0, 3.0, -177.0),
        ];
        let s = ErrorStatistics::of(&errors);
        let near = |x: Option<f64>, y: f64| assert!((x.unwrap() - y).abs() < 1e-7, "{x:?} {y}");
        assert_eq!(s.count, 4);
        near(s.horizontal_rms_m, (294.0_f64 / 4.0).sqrt());
        near(s.horizontal_max_m, 13.0);
        // Rank 0.95 × 3 = 2.85, between 10 and 13.
        near(s.horizontal_p95_m, 12.55);
        near(s.height_rms_m, (14.0_f64 / 4.0).sqrt());
        near(s.velocity_rms_m_per_s, (70.0_f64 / 4.0).sqrt());
        near(s.roll_rms_deg, 0.5);
        near(s.pitch_rms_deg, 0.0);
        near(s.heading_rms_deg, 6.0_f64.sqrt());
        assert_eq!(
            s.nees,
            Nees::default(),
            "no covariance, no normalised error"
        );
    }

    #[test]
    fn a_reference_without_vertical_velocity_is_compared_horizontally() {
        let mut r = reference();
        r.velocity_n = Some(Vector3::new(0.0, 0.0, f64::NAN));
        let mut s = solution(Vector3::zeros(), Vector3::zeros(), Euler::default());
        s.velocity_covariance_n = Some(Matrix3::identity());
        let got = ErrorStatistics::of(&[PointError::new(&s, &s, &r)]);
        assert_eq!(got.velocity_rms_m_per_s, Some(5.0));
        // 25 over two components.
        assert!((got.nees.velocity.unwrap() - 12.5).abs() < 1e-12);
    }

    #[test]
    fn nothing_compared_is_none_not_zero() {
        let s = ErrorStatistics::of(&[]);
        assert_eq!(
            (
                s.count,
                s.horizontal_rms_m,
                s.nees.position,
                s.coverage.one_sigma
            ),
            (0, None, None, None)
        );
    }

    /// Errors drawn from the stated covariance plus the reference's own sigma.
    fn gaussian(count: usize, optimism: f64) -> ErrorStatistics {
        let mut random = Pcg64::new(1, 2);
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let l = nalgebra::Matrix3::new(2.0, 0.0, 0.0, 0.7, 1.5, 0.0, -0.4, 0.3, 1.0);
        let errors: Vec<PointError> = (0..count)
            .map(|_| {
                let dp = l * Vector3::new(normal(), normal(), normal());
                let dv = l * Vector3::new(normal(), normal(), normal()) * 0.1;
                let phi = l * Vector3::new(normal(), normal(), normal()) * 0.01;
                let mut r = reference();
                r.position_sigma_n = Vector3::new(1.0, 2.0, 3.0);
                let noise =
                    r.position_sigma_n
                        .component_mul(&Vector3::new(normal(), normal(), normal()));
                r.position = Some(AT.offset(&noise));
                let truth = Euler::from_degrees(1.0, 2.0, 179.0).to_quaternion();
                let p = l * l.transpose() * optimism;
                let s = SolutionPoint {
                    position: Some(AT.offset(&dp)),
                    velocity_n: Some(Vector3::new(3.0, 4.0, 0.0) + dv),
                    q_nb: Some(exp(&-phi) * truth),
                    position_covariance_n: Some(p),
                    velocity_covariance_n: Some(p * 0.01),
                    attitude_covariance_n: Some(p * 1e-4),
                    ..SolutionPoint::default()
                };
                PointError::new(&s, &s, &r)
            })
            .collect();
        ErrorStatistics::of(&errors)
    }

    #[test]
    fn gaussian_errors_have_unit_nees_and_normal_coverage() {
        let n = 4000;
        let s = gaussian(n, 1.0);
        // A chi-square with three degrees of freedom has variance 6; divided by 3 and averaged over n.
        let standard_error = (6.0 / n as f64).sqrt() / 3.0;
        for nees in [s.nees.position, s.nees.velocity, s.nees.attitude] {
            assert!(
                (nees.unwrap() - 1.0).abs() < 3.0 * standard_error,
                "{nees:?}"
            );
        }
        let shares = [
            s.coverage.one_sigma,
            s.coverage.two_sigma,
            s.coverage.three_sigma,
        ];
        for (got, p) in shares.into_iter().zip([0.682_69, 0.954_50, 0.997_30_f64]) {
            // Components of one instant are correlated: count instants, not components.
            let standard_error = (p * (1.0 - p) / n as f64).sqrt();
            assert!(
                (got.unwrap() - p).abs() < 3.0 * standard_error,
                "{got:?} {p}"
            );
        }
    }

    #[test]
    fn a_covariance_four_times_too_small_shows() {
        let s = gaussian(1000, 0.25);
        assert!(s.nees.velocity.unwrap() > 3.5 && s.nees.attitude.unwrap() > 3.5);
        assert!(s.coverage.one_sigma.unwrap() < 0.62);
    }
}
