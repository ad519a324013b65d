//! Euler angles of the 3-2-1 sequence.

use core::f64::consts::{PI, TAU};
#[cfg(not(feature = "std"))]
use nalgebra::{ComplexField, RealField};
use nalgebra::{Matrix3, UnitQuaternion};
use serde::{Deserialize, Serialize};

/// Roll, pitch and heading of the body (forward-right-down) against NED: 3-2-1 sequence, radians.
///
/// Heading is clockwise from true north, in (−π, π]. At pitch ±90° only the sum or difference of roll and heading is
/// defined: roll is then reported as 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Euler {
    /// About forward, right side down positive, rad.
    pub roll: f64,
    /// About right, nose up positive, rad.
    pub pitch: f64,
    /// About down, clockwise from north, rad.
    pub heading: f64,
}

impl Euler {
    /// From degrees.
    pub fn from_degrees(roll_deg: f64, pitch_deg: f64, heading_deg: f64) -> Self {
        Euler {
            roll: roll_deg.to_radians(),
            pitch: pitch_deg.to_radians(),
            heading: heading_deg.to_radians(),
        }
    }

    /// The rotation q_nb (\[Groves13\] eq. 2.22 transposed).
    pub fn to_quaternion(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_euler_angles(self.roll, self.pitch, self.heading)
    }

    /// The angles of q_nb (\[Groves13\] eq. 2.23).
    pub fn from_quaternion(q_nb: &UnitQuaternion<f64>) -> Self {
        let c = q_nb.to_rotation_matrix();
        let c = c.matrix();
        let pitch = (-c[(2, 0)]).atan2((c[(0, 0)] * c[(0, 0)] + c[(1, 0)] * c[(1, 0)]).sqrt());
        if c[(2, 0)].abs() > 1.0 - 1e-12 {
            return Euler {
                roll: 0.0,
                pitch,
                heading: (-c[(0, 1)]).atan2(c[(1, 1)]),
            };
        }
        Euler {
            roll: c[(2, 1)].atan2(c[(2, 2)]),
            pitch,
            heading: c[(1, 0)].atan2(c[(0, 0)]),
        }
    }

    /// How roll, pitch and heading change with a small rotation φ in n, C = Exp(φ) Ĉ: rows of the angles, columns north, east, down.
    ///
    /// The covariance of the angles is J P Jᵀ. Without bounds towards ±90° of pitch, where roll and heading are one and the same.
    pub fn by_rotation(&self) -> Matrix3<f64> {
        let (sin, cos) = self.heading.sin_cos();
        let (over, t) = (1.0 / self.pitch.cos(), self.pitch.tan());
        Matrix3::new(
            cos * over,
            sin * over,
            0.0,
            -sin,
            cos,
            0.0,
            cos * t,
            sin * t,
            1.0,
        )
    }

    /// Heading in degrees, 0 to 360.
    pub fn heading_deg(&self) -> f64 {
        let d = self.heading.to_degrees();
        if d < 0.0 { d + 360.0 } else { d }
    }
}

/// The angle in (−π, π] that differs from `angle` (rad) by whole turns.
pub fn wrap_angle(angle: f64) -> f64 {
    let a = angle - TAU * ((angle + PI) / TAU).floor();
    if a <= -PI { a + TAU } else { a }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn there_and_back(roll in -3.1..3.1f64, pitch in -1.57..1.57f64, heading in -3.1..3.1f64) {
            let e = Euler { roll, pitch, heading };
            let back = Euler::from_quaternion(&e.to_quaternion());
            // Near ±90° of pitch, roll and heading lose digits as 1/cos(pitch).
            let tolerance = 1e-14 / pitch.cos();
            prop_assert!(wrap_angle(back.roll - roll).abs() < tolerance);
            prop_assert!((back.pitch - pitch).abs() < 1e-7_f64.min(tolerance));
            prop_assert!(wrap_angle(back.heading - heading).abs() < tolerance);
        }

        #[test]
        fn angles_change_with_a_rotation_as_their_derivative_says(
            roll in -3.1..3.1f64, pitch in -1.4..1.4f64, heading in -3.1..3.1f64, axis in 0usize..3
        ) {
            let e = Euler { roll, pitch, heading };
            let h = 1e-6;
            let turned = |by: f64| {
                let mut phi = Vector3::zeros();
                phi[axis] = by;
                Euler::from_quaternion(&(crate::attitude::exp(&phi) * e.to_quaternion()))
            };
            let (up, down) = (turned(h), turned(-h));
            let found = Vector3::new(up.roll - down.roll, up.pitch - down.pitch, up.heading - down.heading)
                .map(|d| wrap_angle(d) / (2.0 * h));
            // Second differences of 1/cos and tan up to 80°, and 1e-16 of an angle by the step of 1e-6.
            prop_assert!((found - e.by_rotation().column(axis)).norm() < 1e-8);
        }

        #[test]
        fn wrapped_angles_stay_in_one_turn(a in -1e3..1e3f64) {
            let w = wrap_angle(a);
            prop_assert!(w > -PI && w <= PI + 1e-12);
            prop_assert!(((a - w) / TAU - ((a - w) / TAU).round()).abs() < 1e-12);
        }
    }

    #[test]
    fn each_angle_turns_its_axis_the_right_way() {
        let forward = |e: Euler| e.to_quaternion() * Vector3::x();
        assert!(
            (forward(Euler::from_degrees(0.0, 0.0, 90.0)) - Vector3::y()).norm() < 1e-15,
            "heading 90 looks east"
        );
        assert!(
            (forward(Euler::from_degrees(0.0, 90.0, 0.0)) + Vector3::z()).norm() < 1e-15,
            "pitch 90 looks up"
        );
        let right = Euler::from_degrees(90.0, 0.0, 0.0).to_quaternion() * Vector3::y();
        assert!(
            (right - Vector3::z()).norm() < 1e-15,
            "roll 90 puts the right side down"
        );
    }

    #[test]
    fn straight_up_keeps_the_rotation() {
        let q = Euler::from_degrees(20.0, 90.0, 50.0).to_quaternion();
        let back = Euler::from_quaternion(&q);
        assert_eq!(back.roll, 0.0);
        assert!(q.angle_to(&back.to_quaternion()) < 1e-7);
    }
}
