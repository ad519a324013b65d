//! Measurement models: one file each, with its settings, its model and when it is used.

mod antenna;
mod doubt;
mod frozen;
mod gnss_position;
mod gnss_velocity;
mod heading;
mod held_heading;
#[cfg(feature = "std")]
mod known_velocity;
mod learnt_noise;
mod nonholonomic;
mod standing_means;
mod zero_heading_rate;
mod zero_velocity;

pub use doubt::{Doubt, Vote};
pub use frozen::{Frozen, Moving, Repetition};
pub use gnss_position::{GnssPositionAid, GnssPositionModel};
pub use gnss_velocity::{GnssVelocityAid, GnssVelocityModel, HorizontalVelocityModel};
pub use heading::{HeadingAid, HeadingModel};
pub use held_heading::{HeldAid, HeldAttitudeModel, HeldHeadingModel};
#[cfg(feature = "std")]
pub(crate) use known_velocity::KnownVelocityModel;
pub use learnt_noise::{Evidence, LearntNoise};
pub use nonholonomic::{LateralModel, NonholonomicAid, NonholonomicModel};
pub use standing_means::{StandingForceModel, StandingRateModel};
pub use zero_heading_rate::{ZeroHeadingRateAid, ZeroHeadingRateModel};
pub use zero_velocity::{ZeroVelocityAid, ZeroVelocityModel};

use nalgebra::Matrix3;

/// Standard deviation of a position whose receiver states none, m.
pub const UNSTATED_POSITION_SIGMA: f64 = 3.0;
/// Standard deviation of a velocity whose receiver states none, m/s.
pub const UNSTATED_VELOCITY_SIGMA: f64 = 0.1;

/// A covariance as a receiver states it, made believable: scaled, and no component better than the floor.
fn believable(stated: &Matrix3<f64>, scale: f64, floor: f64) -> Matrix3<f64> {
    let mut r = stated * (scale * scale);
    for i in 0..3 {
        r[(i, i)] = r[(i, i)].max(floor * floor);
    }
    r
}
