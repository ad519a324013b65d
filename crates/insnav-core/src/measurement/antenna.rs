//! An antenna on a lever arm: where it is and how it moves, with the derivatives that every GNSS model needs.

use crate::attitude::skew;
use crate::earth::earth_rate_n;
use crate::filter::{ATTITUDE, Columns, LEVER_ARM, Layout, Nominal, VELOCITY};
use nalgebra::{Matrix3, Vector3};

/// The antenna at one estimate.
pub(super) struct Antenna<'a> {
    nominal: &'a Nominal,
    axes_n: Matrix3<f64>,
    lever_b: Vector3<f64>,
    earth_rate_n: Vector3<f64>,
    /// C l: from the IMU to the antenna, NED, m.
    pub(super) lever_n: Vector3<f64>,
    /// C (ω_ib × l).
    swing_n: Vector3<f64>,
    /// v + C (ω_ib × l) − ω_ie × C l: over ground, NED, m/s.
    pub(super) velocity_n: Vector3<f64>,
}

impl<'a> Antenna<'a> {
    /// With the lever arm of the settings; what the filter has found is added.
    pub(super) fn at(nominal: &'a Nominal, settings_b: &Vector3<f64>) -> Self {
        let axes_n = nominal.nav.q_nb.to_rotation_matrix().into_inner();
        let lever_b = settings_b + nominal.calibration.lever_arm_b;
        let lever_n = axes_n * lever_b;
        let swing_n = axes_n * nominal.rate_b.cross(&lever_b);
        let earth_rate_n = earth_rate_n(nominal.nav.position.latitude);
        Antenna {
            nominal,
            axes_n,
            lever_b,
            earth_rate_n,
            lever_n,
            swing_n,
            velocity_n: nominal.nav.velocity_n + swing_n - earth_rate_n.cross(&lever_n),
        }
    }

    /// Derivatives of C l, without that of the position of the IMU.
    pub(super) fn put_lever(&self, h: &mut Columns<3>, layout: &Layout) {
        h.put(layout, ATTITUDE, &-skew(&self.lever_n));
        h.put(layout, LEVER_ARM, &self.axes_n);
    }

    /// `factor` times the derivatives of the velocity.
    pub(super) fn put_velocity(&self, h: &mut Columns<3>, layout: &Layout, factor: f64) {
        let earth = skew(&self.earth_rate_n);
        let by_attitude = earth * skew(&self.lever_n) - skew(&self.swing_n);
        let by_rate = self.axes_n * skew(&self.lever_b) * -factor;
        h.put(layout, VELOCITY, &Matrix3::from_diagonal_element(factor));
        h.put(layout, ATTITUDE, &(by_attitude * factor));
        self.nominal.put_rate(h, layout, &by_rate);
        if layout.has(LEVER_ARM) {
            let by_lever = self.axes_n * skew(&self.nominal.rate_b) - earth * self.axes_n;
            h.put(layout, LEVER_ARM, &(by_lever * factor));
        }
    }
}
