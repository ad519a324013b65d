//! An antenna on a lever arm: where it is and how it moves, with the derivatives that every GNSS model needs.

use crate::attitude::skew;
use crate::earth::earth_rate_n;
use crate::filter::{ATTITUDE, Columns, LEVER_ARM, Layout, Nominal, VELOCITY};
use nalgebra::{Matrix3, Vector3};

/// The place of the antenna at one estimate.
pub(super) struct Antenna<'a> {
    nominal: &'a Nominal,
    axes_n: Matrix3<f64>,
    lever_b: Vector3<f64>,
    /// C l: from the IMU to the antenna, NED, m.
    pub(super) lever_n: Vector3<f64>,
}

/// Its motion, which only velocities and unknown clocks ask for.
pub(super) struct AntennaMotion<'a> {
    antenna: &'a Antenna<'a>,
    earth_rate_n: Vector3<f64>,
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
        Antenna {
            nominal,
            axes_n,
            lever_b,
            lever_n: axes_n * lever_b,
        }
    }

    /// Derivatives of C l.
    pub(super) fn put_lever(&self, h: &mut Columns<3>, layout: &Layout) {
        h.put(layout, ATTITUDE, &-skew(&self.lever_n));
        h.put(layout, LEVER_ARM, &self.axes_n);
    }

    pub(super) fn motion(&self) -> AntennaMotion<'_> {
        let swing_n = self.axes_n * self.nominal.rate_b.cross(&self.lever_b);
        let earth_rate_n = earth_rate_n(self.nominal.nav.position.latitude);
        AntennaMotion {
            antenna: self,
            earth_rate_n,
            swing_n,
            velocity_n: self.nominal.nav.velocity_n + swing_n - earth_rate_n.cross(&self.lever_n),
        }
    }
}

impl AntennaMotion<'_> {
    /// `factor` times the derivatives of the velocity.
    pub(super) fn put_velocity(&self, h: &mut Columns<3>, layout: &Layout, factor: f64) {
        let Antenna {
            nominal,
            axes_n,
            lever_b,
            lever_n,
        } = self.antenna;
        let earth = skew(&self.earth_rate_n);
        let by_attitude = earth * skew(lever_n) - skew(&self.swing_n);
        let by_rate = axes_n * skew(lever_b) * -factor;
        h.put(layout, VELOCITY, &Matrix3::from_diagonal_element(factor));
        h.put(layout, ATTITUDE, &(by_attitude * factor));
        nominal.put_rate(h, layout, &by_rate);
        if layout.has(LEVER_ARM) {
            let by_lever = axes_n * skew(&nominal.rate_b) - earth * axes_n;
            h.put(layout, LEVER_ARM, &(by_lever * factor));
        }
    }
}
