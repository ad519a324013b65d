//! The body stands: heading, or the whole attitude, is what it was when the stop began.

use crate::attitude::{Euler, log, wrap_angle};
use crate::config::{HeadingRow, StationaryConfig};
use crate::error::Result;
use crate::filter::{
    ATTITUDE, Columns, Eskf, Gate, Layout, Linearized, Measurement, Nominal, Update,
};
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix1, Matrix1x3, Matrix3, Vector1};
use serde::{Deserialize, Serialize};

/// The held heading against that of now, rad. The error of the held one is in both: the residual shows what has come since.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldHeadingModel {
    /// r = \[Log(C_held Ĉᵀ)\]_D, or r = ψ_held − ψ̂ (\[Kozadaev17\] eq. 13 to 15).
    pub row: HeadingRow,
    /// Standard deviation, rad.
    pub sigma: f64,
}

impl Measurement<1> for HeldHeadingModel {
    fn name(&self) -> &'static str {
        "held_heading"
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<1> {
        let mut h = Columns::default();
        let (residual, row) = match self.row {
            HeadingRow::Down => (
                log(&(at.held_q_nb * at.nav.q_nb.inverse())).z,
                Matrix1x3::new(0.0, 0.0, 1.0),
            ),
            HeadingRow::Euler => {
                let (held, now) = (
                    Euler::from_quaternion(&at.held_q_nb),
                    Euler::from_quaternion(&at.nav.q_nb),
                );
                let (s, c) = now.heading.sin_cos();
                let t = now.pitch.tan();
                (
                    wrap_angle(held.heading - now.heading),
                    Matrix1x3::new(c * t, s * t, 1.0),
                )
            }
        };
        h.put(layout, ATTITUDE, &row);
        Linearized {
            residual: Vector1::new(residual),
            h,
            r: Matrix1::new(self.sigma * self.sigma),
        }
    }

    fn sees_whole_attitude(&self) -> bool {
        false
    }
}

/// The held attitude against that of now: r = Log(C_held Ĉᵀ), rad NED.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldAttitudeModel {
    /// Standard deviation about each axis, rad.
    pub sigma: f64,
}

impl Measurement<3> for HeldAttitudeModel {
    fn name(&self) -> &'static str {
        "held_attitude"
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<3> {
        let mut h = Columns::default();
        h.put(layout, ATTITUDE, &Matrix3::identity());
        Linearized {
            residual: log(&(at.held_q_nb * at.nav.q_nb.inverse())),
            h,
            r: Matrix3::from_diagonal_element(self.sigma * self.sigma),
        }
    }

    fn sees_whole_attitude(&self) -> bool {
        false
    }
}

/// When and how a held heading or attitude is used: at every inertial sample of a stop.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldAid {
    row: HeadingRow,
    density: f64,
}

impl HeldAid {
    /// From the settings.
    pub fn new(config: &StationaryConfig) -> Self {
        HeldAid {
            row: config.heading_row,
            density: config.held_heading_deg_per_sqrt_hz.to_radians(),
        }
    }

    /// Compare the heading with the held one, after an interval of `dt` seconds.
    ///
    /// # Errors
    /// As [`Eskf::update`].
    pub fn observe_heading(&self, dt: f64, filter: &mut Eskf) -> Result<Update> {
        let model = HeldHeadingModel {
            row: self.row,
            sigma: self.density / dt.sqrt(),
        };
        let time = filter.nominal().nav.time;
        filter.update(&model, time, &mut Gate::lenient())
    }

    /// Compare the attitude with the held one, after an interval of `dt` seconds.
    ///
    /// # Errors
    /// As [`Eskf::update`].
    pub fn observe_attitude(&self, dt: f64, filter: &mut Eskf) -> Result<Update> {
        let model = HeldAttitudeModel {
            sigma: self.density / dt.sqrt(),
        };
        let time = filter.nominal().nav.time;
        filter.update(&model, time, &mut Gate::lenient())
    }
}
