//! The body stands: the means of what the inertial unit measures show its errors.

use crate::attitude::skew;
use crate::earth::{LocalEarth, earth_rate_n};
use crate::filter::{
    ACCEL_BIAS, ACCEL_SCALE, ATTITUDE, Columns, GYRO_BIAS, GYRO_SCALE, Layout, Linearized,
    Measurement, Nominal,
};
use nalgebra::{Matrix3, Vector3};

/// Mean specific force at rest, as measured: r = f̃ − ((1 + s_a)(−Cᵀ g) + b_a), m/s², body axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StandingForceModel {
    /// The mean, sensor errors inside, m/s².
    pub specific_force_b: Vector3<f64>,
    /// Its variance on each axis, m²/s⁴.
    pub variance: f64,
}

impl Measurement<3> for StandingForceModel {
    fn name(&self) -> &'static str {
        "standing_force"
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<3> {
        let to_b = at.nav.q_nb.inverse().to_rotation_matrix().into_inner();
        let gravity_n = Vector3::z() * LocalEarth::at(&at.nav.position).gravity();
        let force_b = to_b * -gravity_n;
        let scale = at.imu_errors.accel_scale.add_scalar(1.0);
        let mut h = Columns::default();
        // C = Exp(φ) Ĉ: −Cᵀ g = −Ĉᵀ (g − φ × g).
        let by_attitude = -(to_b * skew(&gravity_n));
        h.put(
            layout,
            ATTITUDE,
            &(Matrix3::from_diagonal(&scale) * by_attitude),
        );
        h.put(layout, ACCEL_BIAS, &Matrix3::identity());
        h.put(layout, ACCEL_SCALE, &Matrix3::from_diagonal(&force_b));
        Linearized {
            residual: self.specific_force_b
                - scale.component_mul(&force_b)
                - at.imu_errors.accel_bias,
            h,
            r: Matrix3::from_diagonal_element(self.variance),
        }
    }
}

/// Mean angular rate at rest, as measured: r = ω̃ − ((1 + s_g) Cᵀ ω_ie + b_g), rad/s, body axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StandingRateModel {
    /// The mean, sensor errors inside, rad/s.
    pub angular_rate_b: Vector3<f64>,
    /// Its variance on each axis, rad²/s².
    pub variance: Vector3<f64>,
    /// Whether the heading is known well enough to say where on the body the Earth's rate is: a linear filter must not look
    /// for a heading of which nothing is known. Else the variance has to cover the Earth's rate.
    pub earth_rate_tells: bool,
    /// Where it does not tell: by how much a turn of the heading is in the rate nevertheless, 1/s, since the biases were found with that
    /// heading (−P(b, φ_D)/P(φ_D)). The measurement then has nothing to do with the heading. Zero for biases that are independent.
    pub by_heading: Vector3<f64>,
}

impl Measurement<3> for StandingRateModel {
    fn name(&self) -> &'static str {
        "standing_rate"
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<3> {
        let to_b = at.nav.q_nb.inverse().to_rotation_matrix().into_inner();
        let mut earth_rate_n = earth_rate_n(at.nav.position.latitude);
        if !self.earth_rate_tells {
            // North is anywhere: its mean over all headings is none, but for the part of it with which the biases were found.
            let turned = to_b * earth_rate_n.cross(&Vector3::z());
            let part = self.by_heading.dot(&turned) / turned.norm_squared();
            earth_rate_n.x *= if part.is_finite() {
                part.clamp(0.0, 1.0)
            } else {
                0.0
            };
        }
        let rate_b = to_b * earth_rate_n;
        let scale = at.imu_errors.gyro_scale.add_scalar(1.0);
        let mut h = Columns::default();
        if self.earth_rate_tells {
            let by_attitude = to_b * skew(&earth_rate_n);
            h.put(
                layout,
                ATTITUDE,
                &(Matrix3::from_diagonal(&scale) * by_attitude),
            );
        } else {
            h.put_axis(layout, ATTITUDE, 2, self.by_heading.into());
        }
        h.put(layout, GYRO_BIAS, &Matrix3::identity());
        h.put(layout, GYRO_SCALE, &Matrix3::from_diagonal(&rate_b));
        Linearized {
            residual: self.angular_rate_b - scale.component_mul(&rate_b) - at.imu_errors.gyro_bias,
            h,
            r: Matrix3::from_diagonal(&self.variance),
        }
    }
}
