//! Rotation vectors: exponential, logarithm, Jacobian.

#[cfg(not(feature = "std"))]
use nalgebra::{ComplexField, RealField};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Below this squared angle (rad²), series replace sin and cos: their remainder is then below 1e-17.
const SMALL_SQUARED: f64 = 1e-2;

/// The skew-symmetric matrix [v×]: `skew(a) * b = a × b`.
pub fn skew(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// The rotation by a rotation vector (rad): Exp, exact for any size.
pub fn exp(r: &Vector3<f64>) -> UnitQuaternion<f64> {
    let angle_squared = r.norm_squared();
    // cos(θ/2) and sin(θ/2)/θ as series in x = θ²/4.
    let (w, k) = if angle_squared < SMALL_SQUARED {
        let x = 0.25 * angle_squared;
        (
            1.0 - x / 2.0 * (1.0 - x / 12.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0))),
            0.5 * (1.0 - x / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0)))),
        )
    } else {
        let angle = angle_squared.sqrt();
        let (s, c) = (0.5 * angle).sin_cos();
        (c, s / angle)
    };
    UnitQuaternion::new_unchecked(Quaternion::new(w, k * r.x, k * r.y, k * r.z))
}

/// The rotation vector of a rotation (rad), of size at most π: Log.
pub fn log(q: &UnitQuaternion<f64>) -> Vector3<f64> {
    let v = q.imag();
    let (v, w) = if q.w < 0.0 { (-v, -q.w) } else { (v, q.w) };
    let s = v.norm();
    if s < 1e-10 {
        // asin(s)/s = 1 to second order, and w = 1 to second order.
        return v * (2.0 / w);
    }
    v * (2.0 * s.atan2(w) / s)
}

/// The left Jacobian of SO(3), J(r) = ∫₀¹ Exp(s r) ds.
///
/// With constant rate and constant body-frame force, the velocity gained over an interval, resolved in the axes at its
/// begin, is J(α) ν: \[Savage98b\] eq. 19 and 20 keep its series to the third order, ν + ½ α×ν + ⅙ α×(α×ν).
pub fn left_jacobian(r: &Vector3<f64>) -> Matrix3<f64> {
    let x = r.norm_squared();
    // (1 − cos θ)/θ² and (θ − sin θ)/θ³ as series in x = θ².
    let (a, b) = if x < SMALL_SQUARED {
        (
            0.5 * (1.0 - x / 12.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0 * (1.0 - x / 90.0)))),
            (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0 * (1.0 - x / 110.0)))) / 6.0,
        )
    } else {
        let angle = x.sqrt();
        ((1.0 - angle.cos()) / x, (angle - angle.sin()) / (x * angle))
    };
    let k = skew(r);
    Matrix3::identity() + k * a + k * k * b
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
        (-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64)
            .prop_map(move |(x, y, z)| Vector3::new(x, y, z) * size)
    }

    proptest! {
        #[test]
        fn log_inverts_exp(r in vector(1.8)) {
            prop_assert!((log(&exp(&r)) - r).norm() < 1e-14 * (1.0 + r.norm()));
        }

        #[test]
        fn log_inverts_exp_when_small(r in vector(1e-9)) {
            prop_assert!((log(&exp(&r)) - r).norm() < 1e-24);
        }

        #[test]
        fn exp_is_a_unit_quaternion(r in vector(0.06)) {
            prop_assert!((exp(&r).norm() - 1.0).abs() < 3e-16);
        }

        #[test]
        fn exp_equals_the_closed_form(r in vector(0.055)) {
            let other = UnitQuaternion::from_scaled_axis(r);
            prop_assert!((exp(&r).coords - other.coords).norm() < 3e-16);
        }

        /// Exp(s r) v integrated by Simpson's rule, whose remainder θ⁴/(180 n⁴) is below 4e-11 here.
        #[test]
        fn left_jacobian_is_the_mean_rotation(r in vector(2.0), v in vector(1.0)) {
            let n = 400;
            let at = |i: i32| exp(&(r * (f64::from(i) / f64::from(n)))) * v;
            let mut sum = at(0) + at(n);
            for i in 1..n { sum += at(i) * if i % 2 == 1 { 4.0 } else { 2.0 }; }
            prop_assert!((sum / (3.0 * f64::from(n)) - left_jacobian(&r) * v).norm() < 1e-10);
        }

        #[test]
        fn rotation_acts_by_cross_product_to_first_order(r in vector(1e-7), v in vector(1.0)) {
            prop_assert!((exp(&r) * v - (v + skew(&r) * v)).norm() < 1e-13);
        }
    }

    #[test]
    fn the_two_branches_meet() {
        for scale in [1.0 - 1e-12, 1.0 + 1e-12] {
            let r = Vector3::new(0.06, -0.08, 0.0) * scale;
            let other = UnitQuaternion::from_scaled_axis(r);
            assert!((exp(&r).coords - other.coords).norm() < 3e-16);
        }
    }
}
