//! The velocity of a body that hardly moves, as a whole stop shows it.

use crate::filter::{Columns, Layout, Linearized, Measurement, Nominal, VELOCITY};
use nalgebra::{Matrix3, Vector3};

/// A velocity that is known: r = v − v̂, m/s NED.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct KnownVelocityModel {
    /// NED, m/s.
    pub(crate) velocity_n: Vector3<f64>,
    /// Standard deviation of each component, m/s.
    pub(crate) sigma: f64,
}

impl Measurement<3> for KnownVelocityModel {
    fn name(&self) -> &'static str {
        "zero_velocity"
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<3> {
        let mut h = Columns::default();
        h.put(layout, VELOCITY, &Matrix3::identity());
        Linearized {
            residual: self.velocity_n - at.nav.velocity_n,
            h,
            r: Matrix3::from_diagonal_element(self.sigma * self.sigma),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::Geodetic;
    use crate::filter::{CAPACITY, Eskf, InitialSigma};
    use crate::imu::{ImuErrors, ImuGrade};
    use crate::mechanization::NavState;
    use crate::time::Time;
    use nalgebra::UnitQuaternion;

    /// What a small error does to the residual, through the filter's own ⊞; linear, so that only rounding is left.
    #[test]
    fn h_is_the_derivative_of_the_residual() {
        let nav = NavState {
            time: Time(0),
            position: Geodetic::from_degrees(60.0, 30.0, 100.0),
            velocity_n: Vector3::new(0.3, -0.2, 0.1),
            q_nb: UnitQuaternion::from_euler_angles(0.1, -0.2, 2.0),
        };
        let one = Vector3::repeat(1.0);
        let sigma = InitialSigma {
            position: one,
            velocity: one,
            attitude: one,
            gyro_bias: one,
            accel_bias: one,
        };
        let noise = ImuGrade::Navigation.noise();
        let filter = Eskf::new(nav, ImuErrors::default(), &sigma, noise);
        let (at, layout) = (filter.nominal(), filter.covariance().layout());
        let model = KnownVelocityModel {
            velocity_n: Vector3::new(0.01, 0.02, -0.03),
            sigma: 1e-3,
        };
        let here = model.linearize(at, layout);
        let size = 1e-3;
        for state in 0..layout.len() {
            let mut dx = [0.0; CAPACITY];
            dx[state] = size;
            let there = model.linearize(&at.retract(layout, &dx), layout);
            let slope = (here.residual - there.residual) / size;
            let mut stated = Vector3::zeros();
            for (_, column) in here.h.iter().filter(|(j, _)| *j == state) {
                stated += Vector3::from(*column);
            }
            assert!((slope - stated).amax() < 1e-9, "{state}: {slope} {stated}");
        }
        assert!(here.h.iter().count() == 3, "and velocity is in it");
    }
}
