//! What makes a sample one that nobody can use.

use super::Sample;
use crate::earth::Geodetic;
use core::f64::consts::FRAC_PI_2;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix3, Vector3};

/// Smallest eigenvalue of a matrix of correlations that rounding explains: receivers state covariances in single precision.
const ROUNDING: f64 = 1e-6;

/// Why a sample cannot be used, whatever comes before and after it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unfit {
    /// NaN or infinity in a quantity.
    NotFinite {
        /// Which quantity.
        what: &'static str,
    },
    /// A finite number that the quantity cannot have.
    Impossible {
        /// Which quantity.
        what: &'static str,
        /// What is wrong with it.
        why: &'static str,
    },
}

impl Sample {
    /// Whether all of it is finite and possible: `Err` names the first quantity that is not. Impossible are a latitude beyond ±90°
    /// (at the poles there is no north), a covariance with a direction of negative variance, and a heading's sigma that is not
    /// positive.
    ///
    /// The Down component of a GNSS velocity may be NaN ("horizontal only"); then nothing is asked of its variance.
    ///
    /// # Errors
    /// [`Unfit`].
    pub fn check(&self) -> Result<(), Unfit> {
        let finite = |what, v: &Vector3<f64>| all_finite(what, v.as_slice());
        match self {
            Sample::Imu(s) => finite("angular rate", &s.angular_rate_b)
                .and_then(|()| finite("specific force", &s.specific_force_b)),
            Sample::ImuIncrement(s) => finite("angle increment", &s.angle_b)
                .and_then(|()| finite("velocity increment", &s.velocity_b)),
            Sample::GnssPosition(s) => place("GNSS position", &s.position)
                .and_then(|()| covariance("GNSS position covariance", s.covariance_n)),
            Sample::GnssVelocity(s) => {
                let down = s.velocity_n.z;
                all_finite("GNSS velocity", s.velocity_n.xy().as_slice())?;
                if down.is_infinite() {
                    let what = "GNSS velocity";
                    return Err(Unfit::NotFinite { what });
                }
                let what = "GNSS velocity covariance";
                let Some(stated) = s.covariance_n else {
                    return Ok(());
                };
                all_finite(what, stated.as_slice())?;
                covariance(
                    what,
                    Some(if down.is_nan() {
                        level(&stated)
                    } else {
                        stated
                    }),
                )
            }
            Sample::Heading(s) => {
                all_finite("heading", &[s.heading])?;
                let what = "heading sigma";
                all_finite(what, &[s.sigma])?;
                possible(s.sigma > 0.0, what, "is not above zero")
            }
            Sample::Standstill(_) => Ok(()),
            Sample::Speed(s) => all_finite("speed", &[s.speed]),
            Sample::Magnetic(s) => finite("magnetic field", &s.field_b),
        }
    }
}

/// Whether a matrix is a covariance: symmetric, and no direction has a variance below zero, but for rounding.
///
/// Axes may be of very different sigmas: it is the correlations that are looked at.
pub fn is_covariance(p: &Matrix3<f64>) -> bool {
    let sigma = p.diagonal().map(|variance| variance.max(0.0).sqrt());
    let mut correlation = Matrix3::from_diagonal_element(1.0 + ROUNDING);
    for (i, j) in [(0, 1), (0, 2), (1, 2)] {
        let scale = sigma[i] * sigma[j];
        let (upper, lower) = (p[(i, j)], p[(j, i)]);
        if (upper - lower).abs() > ROUNDING * scale.max(upper.abs().min(lower.abs())) {
            return false;
        }
        // Without a variance there is nothing to correlate.
        let share = match upper + lower {
            0.0 => 0.0,
            sum => 0.5 * sum / scale,
        };
        correlation[(i, j)] = share;
        correlation[(j, i)] = share;
    }
    p.diagonal().iter().all(|variance| *variance >= 0.0)
        && correlation.iter().all(|share| share.is_finite())
        && correlation.cholesky().is_some()
}

fn all_finite(what: &'static str, values: &[f64]) -> Result<(), Unfit> {
    let finite = values.iter().all(|x| x.is_finite());
    finite.then_some(()).ok_or(Unfit::NotFinite { what })
}

fn possible(is: bool, what: &'static str, why: &'static str) -> Result<(), Unfit> {
    is.then_some(()).ok_or(Unfit::Impossible { what, why })
}

fn place(what: &'static str, at: &Geodetic) -> Result<(), Unfit> {
    all_finite(what, &[at.latitude, at.longitude, at.height])?;
    let latitude = at.latitude.abs();
    possible(
        latitude <= FRAC_PI_2,
        what,
        "has a latitude beyond ±90°, which is no place",
    )?;
    possible(
        latitude < FRAC_PI_2,
        what,
        "is a pole, where there is no north",
    )
}

fn covariance(what: &'static str, stated: Option<Matrix3<f64>>) -> Result<(), Unfit> {
    let Some(stated) = stated else {
        return Ok(());
    };
    all_finite(what, stated.as_slice())?;
    possible(
        is_covariance(&stated),
        what,
        "is none: not symmetric, a variance below zero, or a correlation beyond ±1",
    )
}

/// Without what is said of Down.
fn level(p: &Matrix3<f64>) -> Matrix3<f64> {
    let mut level = *p;
    level.fill_row(2, 0.0);
    level.fill_column(2, 0.0);
    level
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{GnssPosition, GnssVelocity, Heading};
    use crate::time::Time;
    use proptest::prelude::*;

    fn matrix(values: [[f64; 3]; 3]) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| values[i][j])
    }

    proptest! {
        /// L Lᵀ is a covariance by construction, of whatever sigmas, singular ones too, and in single precision.
        #[test]
        fn squares_are_covariances(
            l in prop::array::uniform9(-1.0..1.0f64),
            sigma in prop::array::uniform3(-4.0..4.0f64),
            rank in 1usize..4,
        ) {
            let l = Matrix3::from_fn(|i, j| if j < rank { l[3 * i + j] * 10f64.powf(sigma[i]) } else { 0.0 });
            let p = l * l.transpose();
            prop_assert!(is_covariance(&p));
            prop_assert!(is_covariance(&p.map(|v| f64::from(v as f32))));
        }

        /// A direction whose variance is below zero by more than rounding, however the axes are scaled.
        #[test]
        fn a_negative_variance_in_any_direction_is_none(
            turn in prop::array::uniform3(-3.0..3.0f64),
            sigma in prop::array::uniform3(-4.0..4.0f64),
            least in 0.001..2.0f64,
        ) {
            let c = nalgebra::Rotation3::new(Vector3::from(turn)).into_inner();
            let of = |least| {
                let p = c * Matrix3::from_diagonal(&Vector3::new(1.0, 2.0, least)) * c.transpose();
                let scale = Matrix3::from_diagonal(&Vector3::from(sigma.map(|s| 10f64.powf(s))));
                scale * p * scale
            };
            prop_assert!(!is_covariance(&of(-least)));
            prop_assert!(is_covariance(&of(least)));
        }
    }

    #[test]
    fn some_that_are_and_some_that_are_not() {
        let cases = [
            ([[2.0, 3.0, 0.0], [3.0, 2.0, 0.0], [0.0, 0.0, 9.0]], false),
            ([[2.0, 2.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 9.0]], true),
            ([[2.0, 1.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 9.0]], false),
            ([[2.0, 0.0, 0.0], [0.0, -1e-9, 0.0], [0.0, 0.0, 9.0]], false),
            // Nothing is known to be wrong, and nothing of the first axis.
            ([[0.0; 3]; 3], true),
            ([[0.0, 1e-3, 0.0], [1e-3, 2.0, 0.0], [0.0, 0.0, 9.0]], false),
            // What is wrong between two precise axes is not hidden by a vague third one.
            (
                [[1e-8, 2e-8, 0.0], [2e-8, 1e-8, 0.0], [0.0, 0.0, 1e6]],
                false,
            ),
        ];
        for (values, is) in cases {
            assert_eq!(is_covariance(&matrix(values)), is, "{values:?}");
        }
    }

    #[test]
    fn says_whether_it_is_not_finite_or_not_possible() {
        let time = Time(0);
        let fix = |latitude_deg, covariance_n| {
            let position = Geodetic::from_degrees(latitude_deg, 14.0, 300.0);
            Sample::GnssPosition(GnssPosition {
                time,
                position,
                covariance_n,
            })
        };
        let velocity = |down: f64, covariance_n| {
            Sample::GnssVelocity(GnssVelocity {
                time,
                velocity_n: Vector3::new(1.0, 2.0, down),
                covariance_n: Some(covariance_n),
            })
        };
        let heading = |sigma| {
            Sample::Heading(Heading {
                time,
                heading: 1.0,
                sigma,
            })
        };
        let crossed = matrix([[2.0, 3.0, 0.0], [3.0, 2.0, 0.0], [0.0, 0.0, 9.0]]);
        let below = matrix([[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, -1.0]]);
        let nan = Matrix3::repeat(f64::NAN);
        let position = "GNSS position";
        let words = |sample: Sample| match sample.check() {
            Ok(()) => ("fits", ""),
            Err(Unfit::NotFinite { what }) => ("not finite", what),
            Err(Unfit::Impossible { what, .. }) => ("impossible", what),
        };
        assert_eq!(words(fix(50.0, None)).0, "fits");
        assert_eq!(words(fix(120.0, None)), ("impossible", position));
        assert_eq!(words(fix(90.0, None)), ("impossible", position));
        assert_eq!(words(fix(f64::NAN, None)), ("not finite", position));
        let stated = "GNSS position covariance";
        assert_eq!(words(fix(50.0, Some(crossed))), ("impossible", stated));
        assert_eq!(words(fix(50.0, Some(nan))), ("not finite", stated));
        let stated = "GNSS velocity covariance";
        assert_eq!(words(velocity(0.0, crossed)), ("impossible", stated));
        assert_eq!(words(velocity(0.0, below)), ("impossible", stated));
        assert_eq!(
            words(velocity(f64::NAN, below)).0,
            "fits",
            "no Down, no variance of it"
        );
        assert_eq!(words(velocity(f64::NAN, crossed)), ("impossible", stated));
        assert_eq!(words(heading(0.1)).0, "fits");
        for sigma in [0.0, -1.0] {
            assert_eq!(words(heading(sigma)), ("impossible", "heading sigma"));
        }
        assert_eq!(words(heading(f64::NAN)), ("not finite", "heading sigma"));
    }
}
