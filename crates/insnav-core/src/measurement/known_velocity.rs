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
