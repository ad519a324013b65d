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
            1.0 - x
                * (1.0 / 2.0)
                * (1.0 - x * (1.0 / 12.0) * (1.0 - x * (1.0 / 30.0) * (1.0 - x * (1.0 / 56.0)))),
            0.5 * (1.0
                - x * (1.0 / 6.0)
                    * (1.0
                        - x * (1.0 / 20.0) * (1.0 - x * (1.0 / 42.0) * (1.0 - x * (1.0 / 72.0))))),
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

/// The rotation by an attitude error in navigation axes (rad): its level part tilts, then its third component turns about Down.
///
/// To first order this is [`exp`]. A turn of any size leaves what the level part says of gravity in body axes as it is, which one
/// rotation vector for both does not: a heading of which little is known must not bend the level.
pub fn exp_level(r: &Vector3<f64>) -> UnitQuaternion<f64> {
    exp(&Vector3::new(0.0, 0.0, r.z)) * exp(&Vector3::new(r.x, r.y, 0.0))
}

/// The inverse of [`exp_level`]: tilt about north and east, and turn about Down in [−π, π], rad.
pub fn log_level(q: &UnitQuaternion<f64>) -> Vector3<f64> {
    let (z, w) = if q.w < 0.0 { (-q.k, -q.w) } else { (q.k, q.w) };
    let turn = 2.0 * z.atan2(w);
    let tilt = log(&(exp(&Vector3::new(0.0, 0.0, -turn)) * q));
    Vector3::new(tilt.x, tilt.y, turn)
}

/// The left Jacobian of SO(3), J(r) = ∫₀¹ Exp(s r) ds.
///
/// With constant rate and constant body-frame force, the velocity gained over an interval, resolved in the axes at its
/// begin, is J(α) ν: \[Savage98b\] eq. 19 and 20 keep its series to the third order, ν + ½ α×ν + ⅙ α×(α×ν).
pub fn left_jacobian(r: &Vector3<f64>) -> Matrix3<f64> {
    let [a, b] = left_jacobian_series(r);
    let k = skew(r);
    Matrix3::identity() + k * a + k * k * b
}

/// J(r) v, without the matrix.
pub fn left_jacobian_times(r: &Vector3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    let [a, b] = left_jacobian_series(r);
    let once = r.cross(v);
    v + once * a + r.cross(&once) * b
}

/// (1 − cos θ)/θ² and (θ − sin θ)/θ³: factors of \[r×\] and its square.
fn left_jacobian_series(r: &Vector3<f64>) -> [f64; 2] {
    let x = r.norm_squared();
    // As series in x = θ². Reciprocals, since the compiler may not turn a division into them.
    if x < SMALL_SQUARED {
        let (c, s) = (1.0 / 90.0, 1.0 / 110.0);
        let c = 1.0 - x * (1.0 / 30.0) * (1.0 - x * (1.0 / 56.0) * (1.0 - x * c));
        let s = 1.0 - x * (1.0 / 42.0) * (1.0 - x * (1.0 / 72.0) * (1.0 - x * s));
        [
            0.5 * (1.0 - x * (1.0 / 12.0) * c),
            (1.0 - x * (1.0 / 20.0) * s) * (1.0 / 6.0),
        ]
    } else {
        let angle = x.sqrt();
        [(1.0 - angle.cos()) / x, (angle - angle.sin()) / (x * angle)]
    }
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
        fn log_level_inverts_exp_level(r in vector(1.8)) {
            prop_assert!((log_level(&exp_level(&r)) - r).norm() < 1e-14 * (1.0 + r.norm()));
        }

        /// Gravity in body axes does not depend on the turn; with one rotation vector it does.
        #[test]
        fn a_turn_leaves_the_level(r in vector(1.0), turn in 0.5..3.0f64) {
            let down = |q: UnitQuaternion<f64>| q.inverse() * Vector3::z();
            let turned = Vector3::new(r.x, r.y, r.z + turn);
            prop_assert!((down(exp_level(&r)) - down(exp_level(&turned))).norm() < 1e-14);
            let bent = (down(exp(&r)) - down(exp(&turned))).norm();
            prop_assert!(bent > 0.01 * r.xy().norm());
        }

        #[test]
        fn both_are_the_same_to_first_order(r in vector(1e-6)) {
            prop_assert!(exp(&r).angle_to(&exp_level(&r)) < 1e-12);
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
        fn the_product_is_that_with_the_matrix(r in vector(2.0), v in vector(1.0), small in 0.0..0.1f64) {
            for r in [r, r * small] {
                prop_assert!((left_jacobian_times(&r, &v) - left_jacobian(&r) * v).norm() < 1e-15);
            }
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
