//! Attitude that gravity and the Earth's magnetic field show at one instant.

use crate::attitude::{Euler, exp};
#[cfg(not(feature = "std"))]
use nalgebra::{ComplexField, RealField};
use nalgebra::{UnitQuaternion, Vector3};

/// Below this share of a vector's length across the vertical, its direction is no heading.
const LEAST_SHARE: f64 = 1e-6;

/// Roll, pitch and magnetic heading of a specific force and a magnetic field in body axes, of a body that does not accelerate.
///
/// \[Belokurov18\] eq. (1) and (2), with the quadrants that its arctangents lose, and for the specific force that an
/// accelerometer measures: forward-right-down, (0, 0, −g) at rest and level (its a is −f). At pitch ±90° roll and heading are
/// not defined one by one: there [`measured_attitude`] goes on to be right. `None` for vectors that have no direction.
pub fn roll_pitch_heading(
    specific_force_b: &Vector3<f64>,
    field_b: &Vector3<f64>,
) -> Option<Euler> {
    let a = -specific_force_b;
    let (across, h) = (a.y.hypot(a.z), field_b);
    if a.norm_squared().is_nan() || h.norm_squared().is_nan() || a.norm() <= 0.0 {
        return None;
    }
    let pitch = (-a.x).atan2(across);
    let roll = a.y.atan2(a.z);
    let ((sin_roll, cos_roll), (sin_pitch, cos_pitch)) = (roll.sin_cos(), pitch.sin_cos());
    let east = -h.y * cos_roll + h.z * sin_roll;
    let north = h.x * cos_pitch + h.y * sin_roll * sin_pitch + h.z * cos_roll * sin_pitch;
    (east.hypot(north) > LEAST_SHARE * h.norm()).then(|| Euler {
        roll,
        pitch,
        heading: east.atan2(north),
    })
}

/// The attitude q_nb that a specific force and a magnetic field show, n being north (magnetic), east, down.
///
/// What [`roll_pitch_heading`] shows, without angles: defined in every attitude but where the force is along the field.
/// \[Belokurov18\] eq. (3) makes of its matrix (navigation to body) the conjugate of this quaternion; here it is the one from
/// body to navigation, as that of the gyros is.
pub fn measured_attitude(
    specific_force_b: &Vector3<f64>,
    field_b: &Vector3<f64>,
) -> Option<UnitQuaternion<f64>> {
    let guess = UnitQuaternion::identity();
    let seen = innovation_n(&guess, Some(specific_force_b), Some(field_b));
    Some(seen.heading_turn()? * seen.levelling()?)
}

/// What force and field say of the error of an attitude, as angles about the axes of n, true = turned by them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AttitudeInnovation {
    /// About north and east, rad: by the specific force alone, whatever the field.
    pub tilt: Option<[f64; 2]>,
    /// About down, rad, after levelling by `tilt` (where there is none, by the attitude itself): by the field alone.
    pub heading: Option<f64>,
}

/// The errors that a specific force and a magnetic field show of an attitude.
///
/// The form for n: no angle of Euler is formed, tilt does not depend on the field, and the heading not on an offset of the
/// heading itself, so that either may be left out. To first order the vector θ of C_true = (1 + θ×) Ĉ.
pub fn innovation_n(
    q_nb: &UnitQuaternion<f64>,
    specific_force_b: Option<&Vector3<f64>>,
    field_b: Option<&Vector3<f64>>,
) -> AttitudeInnovation {
    let tilt = specific_force_b.and_then(|f| tilt_of(&(q_nb * f)));
    let seen = AttitudeInnovation {
        tilt,
        heading: None,
    };
    let heading = field_b.and_then(|field| {
        let levelled = seen.levelling().unwrap_or_default() * (q_nb * field);
        let across = levelled.xy().norm();
        (across > LEAST_SHARE * levelled.norm()).then(|| -levelled.y.atan2(levelled.x))
    });
    AttitudeInnovation { tilt, heading }
}

impl AttitudeInnovation {
    /// The smallest turn that makes the measured force point up.
    pub fn levelling(&self) -> Option<UnitQuaternion<f64>> {
        self.tilt
            .map(|[north, east]| exp(&Vector3::new(north, east, 0.0)))
    }

    /// The turn about the vertical.
    pub fn heading_turn(&self) -> Option<UnitQuaternion<f64>> {
        self.heading
            .map(|angle| exp(&Vector3::new(0.0, 0.0, angle)))
    }
}

/// Rotation vector, without a part along the vertical, from a force to straight up.
fn tilt_of(force_n: &Vector3<f64>) -> Option<[f64; 2]> {
    let size = force_n.norm();
    if !(size > 0.0 && size.is_finite()) {
        return None;
    }
    let across = force_n.xy().norm();
    let angle = across.atan2(-force_n.z);
    if across <= f64::EPSILON * size {
        // Up, or upside down, where any horizontal axis does.
        return Some([if force_n.z < 0.0 { 0.0 } else { angle }, 0.0]);
    }
    Some([-force_n.y * angle / across, force_n.x * angle / across])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::log;
    use proptest::prelude::*;

    const FIELD_N: Vector3<f64> = Vector3::new(20e-6, 0.0, 45e-6);
    const FORCE_N: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);

    proptest! {
        /// E4, E6: all quadrants, and the quaternion is the one from body to navigation.
        #[test]
        fn attitude_comes_back_in_every_quadrant(
            roll in -3.1..3.1f64, pitch in -1.5..1.5f64, heading in -3.1..3.1f64,
        ) {
            let truth = Euler { roll, pitch, heading };
            let q = truth.to_quaternion();
            let (f, m) = (q.inverse() * FORCE_N, q.inverse() * FIELD_N);
            let found = measured_attitude(&f, &m).expect("both have a direction");
            prop_assert!(log(&(found * q.inverse())).norm() < 1e-9);
            let angles = roll_pitch_heading(&f, &m).expect("both have a direction");
            prop_assert!(log(&(angles.to_quaternion() * q.inverse())).norm() < 1e-9);
        }

        /// true = turned by it: to first order the rotation vector, and with heading and tilt apart exactly.
        #[test]
        fn innovation_is_the_turn_to_the_truth(
            north in -0.3..0.3f64, east in -0.3..0.3f64, down in -3.0..3.0f64, roll in -1.0..1.0f64,
        ) {
            let truth = Euler { roll, pitch: 0.4, heading: 2.0 }.to_quaternion();
            let (f, m) = (truth.inverse() * FORCE_N, truth.inverse() * FIELD_N);
            let turn = exp(&Vector3::new(0.0, 0.0, down)) * exp(&Vector3::new(north, east, 0.0));
            let seen = innovation_n(&(turn.inverse() * truth), Some(&f), Some(&m));
            let [n, e] = seen.tilt.expect("a force");
            prop_assert!((n - north).abs() < 1e-12 && (e - east).abs() < 1e-12);
            prop_assert!((seen.heading.expect("a field") - down).abs() < 1e-9);
        }
    }

    /// E6: the paper's arctangents lose the quadrant of a body that lies on its back, and of one that looks south.
    #[test]
    fn arctangents_of_quotients_are_another_attitude() {
        let q = Euler::from_degrees(170.0, 10.0, 120.0).to_quaternion();
        let a = -(q.inverse() * FORCE_N);
        let found = roll_pitch_heading(&-a, &(q.inverse() * FIELD_N)).expect("directions");
        assert!((found.roll.to_degrees() - 170.0).abs() < 1e-9);
        let printed = (a.y / a.z).atan().to_degrees();
        assert!((printed + 10.0).abs() < 1e-9, "{printed}");
    }

    /// E6: at pitch 90° the angles are not defined, the quaternion is.
    #[test]
    fn straight_up_is_an_attitude_too() {
        for heading in [-100.0, 0.0, 30.0] {
            let q = Euler::from_degrees(0.0, 90.0, heading).to_quaternion();
            let found = measured_attitude(&(q.inverse() * FORCE_N), &(q.inverse() * FIELD_N));
            let error = log(&(found.expect("directions") * q.inverse()));
            assert!(error.norm() < 1e-9, "{error}");
        }
    }

    /// A field along the force shows no heading, no force no tilt; each goes without the other.
    #[test]
    fn what_shows_nothing_is_none() {
        let up = Vector3::new(0.0, 0.0, -9.81);
        assert_eq!(measured_attitude(&up, &(up * 1e-6)), None);
        assert_eq!(measured_attitude(&Vector3::zeros(), &FIELD_N), None);
        let nan = Vector3::new(f64::NAN, 0.0, 0.0);
        assert_eq!(roll_pitch_heading(&nan, &FIELD_N), None);
        let q = UnitQuaternion::identity();
        let seen = innovation_n(&q, None, Some(&FIELD_N));
        assert_eq!((seen.tilt, seen.heading), (None, Some(0.0)));
        assert_eq!(innovation_n(&q, Some(&nan), None).tilt, None);
    }
}
