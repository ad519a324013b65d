//! GNSS position of an antenna on a lever arm.

use super::antenna::Antenna;
use super::{UNSTATED_POSITION_SIGMA, believable};
use crate::config::GnssConfig;
use crate::earth::Geodetic;
use crate::error::Result;
use crate::filter::{
    CLOCK_OFFSET, Columns, Eskf, GNSS_COLOUR, Gate, Layout, Linearized, Measurement, Nominal,
    POSITION, Update,
};
use crate::sample::GnssPosition;
use crate::time::Time;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// One fix: r = p_gnss − (p + C l − u δ + c), metres NED, with the antenna's velocity u, a clock offset δ and a
/// time-correlated error c, both zero unless estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GnssPositionModel {
    /// Position of the antenna.
    pub position: Geodetic,
    /// Antenna from the IMU, body axes, m.
    pub lever_arm_b: Vector3<f64>,
    /// Covariance, NED, m².
    pub r: Matrix3<f64>,
}

impl Measurement<3> for GnssPositionModel {
    fn name(&self) -> &'static str {
        "gnss_position"
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<3> {
        let antenna = Antenna::at(at, &self.lever_arm_b);
        let delay = at.calibration.clock_offset;
        let mut predicted_n = antenna.lever_n + at.calibration.gnss_colour_n;
        let mut h = Columns::default();
        h.put(layout, POSITION, &Matrix3::identity());
        antenna.put_lever(&mut h, layout);
        h.put(layout, GNSS_COLOUR, &Matrix3::identity());
        if layout.has(CLOCK_OFFSET) || delay != 0.0 {
            let motion = antenna.motion();
            h.put(layout, CLOCK_OFFSET, &-motion.velocity_n);
            motion.put_velocity(&mut h, layout, -delay);
            predicted_n -= motion.velocity_n * delay;
        }
        Linearized {
            residual: at
                .nav
                .position
                .offset(&predicted_n)
                .offset_to(&self.position),
            h,
            r: self.r,
        }
    }
}

/// When and how positions are used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GnssPositionAid {
    lever_arm_b: Vector3<f64>,
    sigma_floor: f64,
    sigma_scale: f64,
    correlation_time: f64,
    last: Option<Time>,
    gate: Gate,
}

impl GnssPositionAid {
    /// From the settings.
    pub fn new(config: &GnssConfig) -> Self {
        GnssPositionAid {
            lever_arm_b: Vector3::from(config.lever_arm_b_m.unwrap_or_default()),
            sigma_floor: config.sigma_floor_m,
            sigma_scale: config.sigma_scale,
            // States of its own take the correlated part; what is left is white.
            correlation_time: match config.colour {
                Some(_) => 0.0,
                None => config.correlation_time_s,
            },
            last: None,
            gate: Gate::default(),
        }
    }

    /// The model of one fix: its covariance believable, and weighed down if the fix before it came shortly ago.
    ///
    /// White errors that are to average out no faster than errors of correlation time τ need 2τ/Δt times the variance.
    pub fn model(&self, fix: &GnssPosition) -> GnssPositionModel {
        let stated = fix.covariance_n.unwrap_or(Matrix3::from_diagonal_element(
            UNSTATED_POSITION_SIGMA * UNSTATED_POSITION_SIGMA,
        ));
        let interval = self.last.map_or(f64::INFINITY, |last| fix.time.since(last));
        // The same fix once more says nothing new: its weight is a thousandth.
        let dependence = (2.0 * self.correlation_time / interval.max(1e-3)).max(1.0);
        GnssPositionModel {
            position: fix.position,
            lever_arm_b: self.lever_arm_b,
            r: believable(&stated, self.sigma_scale, self.sigma_floor) * dependence,
        }
    }

    /// Offer a fix to the filter.
    ///
    /// # Errors
    /// As [`Eskf::update`].
    pub fn observe(&mut self, fix: &GnssPosition, filter: &mut Eskf) -> Result<Update> {
        let update = filter.update(&self.model(fix), fix.time, &mut self.gate)?;
        self.last = Some(fix.time);
        Ok(update)
    }
}
