//! GNSS velocity of an antenna on a lever arm.

use super::antenna::Antenna;
use super::learnt_noise::{Evidence, LearntNoise};
use super::{UNSTATED_VELOCITY_SIGMA, believable};
use crate::config::GnssConfig;
use crate::error::Result;
use crate::filter::{
    CLOCK_OFFSET, Columns, Eskf, Gate, Layout, Linearized, Measurement, Nominal, Update, Verdict,
};
use crate::sample::GnssVelocity;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// One velocity: r = v_gnss − (v + C (ω_ib × l) − ω_ie × C l − a δ), m/s NED, with the acceleration a and a clock offset δ
/// that is zero unless estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GnssVelocityModel {
    /// Velocity of the antenna over ground, NED, m/s.
    pub velocity_n: Vector3<f64>,
    /// Antenna from the IMU, body axes, m.
    pub lever_arm_b: Vector3<f64>,
    /// Covariance, NED, m²/s².
    pub r: Matrix3<f64>,
}

impl Measurement<3> for GnssVelocityModel {
    fn name(&self) -> &'static str {
        "gnss_velocity"
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<3> {
        let antenna = Antenna::at(at, &self.lever_arm_b);
        let mut h = Columns::default();
        let motion = antenna.motion();
        motion.put_velocity(&mut h, layout, 1.0);
        h.put(layout, CLOCK_OFFSET, &-at.acceleration_n);
        let predicted = motion.velocity_n - at.acceleration_n * at.calibration.clock_offset;
        Linearized {
            residual: self.velocity_n - predicted,
            h,
            r: self.r,
        }
    }
}

/// The two horizontal components alone, for receivers that give speed and course.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HorizontalVelocityModel(pub GnssVelocityModel);

impl Measurement<2> for HorizontalVelocityModel {
    fn name(&self) -> &'static str {
        self.0.name()
    }

    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<2> {
        let full = self.0.linearize(at, layout);
        Linearized {
            residual: full.residual.fixed_rows::<2>(0).into_owned(),
            h: full.h.leading(),
            r: full.r.fixed_view::<2, 2>(0, 0).into_owned(),
        }
    }
}

/// When and how velocities are used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GnssVelocityAid {
    lever_arm_b: Vector3<f64>,
    sigma_floor: f64,
    sigma_scale: f64,
    learnt: Option<LearntNoise>,
    gate: Gate,
}

impl GnssVelocityAid {
    /// From the settings.
    pub fn new(config: &GnssConfig) -> Self {
        GnssVelocityAid {
            lever_arm_b: Vector3::from(config.lever_arm_b_m.unwrap_or_default()),
            sigma_floor: config.velocity_sigma_floor_m_per_s,
            sigma_scale: config.velocity_sigma_scale.fixed().unwrap_or(1.0),
            // A velocity is used for attitude, which errors that do not show would spoil: what is stated is the least.
            learnt: config
                .velocity_sigma_scale
                .fixed()
                .is_none()
                .then(LearntNoise::upward),
            gate: Gate::default(),
        }
    }

    /// The model of one velocity.
    pub fn model(&self, fix: &GnssVelocity) -> GnssVelocityModel {
        let stated = stated(fix);
        GnssVelocityModel {
            velocity_n: fix.velocity_n,
            lever_arm_b: self.lever_arm_b,
            r: match &self.learnt {
                Some(learnt) => learnt.apply(&stated, self.sigma_floor, true),
                None => believable(&stated, self.sigma_scale, self.sigma_floor),
            },
        }
    }

    /// Factors on stated sigmas as used now, horizontal and vertical.
    pub fn scale(&self) -> [f64; 2] {
        self.learnt
            .map_or([self.sigma_scale; 2], |learnt| learnt.scale())
    }

    /// Offer a velocity to the filter; with a NaN Down component, its horizontal part.
    ///
    /// # Errors
    /// As [`Eskf::update`].
    pub fn observe(&mut self, fix: &GnssVelocity, filter: &mut Eskf) -> Result<Update> {
        let model = self.model(fix);
        let update = if fix.velocity_n.z.is_nan() {
            filter.update(&HorizontalVelocityModel(model), fix.time, &mut self.gate)?
        } else {
            filter.update(&model, fix.time, &mut self.gate)?
        };
        if let Some(learnt) = &mut self.learnt
            && update.verdict == Verdict::Accepted
        {
            let evidence = Evidence {
                residual: Vector3::from(update.residual),
                predicted: Vector3::from(update.sigma).map(|s| s * s) - model.r.diagonal(),
                stated: stated(fix).diagonal(),
            };
            learnt.learn(fix.time, &evidence, self.sigma_floor, true);
        }
        Ok(update)
    }
}

fn stated(fix: &GnssVelocity) -> Matrix3<f64> {
    fix.covariance_n.unwrap_or(Matrix3::from_diagonal_element(
        UNSTATED_VELOCITY_SIGMA * UNSTATED_VELOCITY_SIGMA,
    ))
}
