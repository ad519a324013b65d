//! Heading from outside.

use crate::attitude::{Euler, wrap_angle};
use crate::error::Result;
use crate::filter::{
    ATTITUDE, Columns, Eskf, Gate, Layout, Linearized, Measurement, Nominal, Update,
};
use crate::sample::Heading;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// One heading: r = ψ_fix − ψ, rad. Singular at pitch ±90°, where there is no heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeadingModel {
    /// Heading, rad.
    pub heading: f64,
    /// Standard deviation, rad.
    pub sigma: f64,
}

impl Measurement<1> for HeadingModel {
    fn name(&self) -> &'static str {
        "heading"
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<1> {
        let euler = Euler::from_quaternion(&at.nav.q_nb);
        let (s, c) = euler.heading.sin_cos();
        let t = euler.pitch.tan();
        let mut h = Columns::default();
        h.put(
            layout,
            ATTITUDE,
            &SMatrix::<f64, 1, 3>::new(c * t, s * t, 1.0),
        );
        Linearized {
            residual: SVector::<f64, 1>::new(wrap_angle(self.heading - euler.heading)),
            h,
            r: SMatrix::<f64, 1, 1>::new(self.sigma * self.sigma),
        }
    }
}

/// When and how headings are used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HeadingAid {
    gate: Gate,
}

impl HeadingAid {
    /// Offer a heading to the filter.
    ///
    /// # Errors
    /// As [`Eskf::update`].
    pub fn observe(&mut self, fix: &Heading, filter: &mut Eskf) -> Result<Update> {
        filter.update(
            &HeadingModel {
                heading: fix.heading,
                sigma: fix.sigma,
            },
            fix.time,
            &mut self.gate,
        )
    }
}
