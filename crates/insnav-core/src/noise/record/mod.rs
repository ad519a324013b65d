//! Noise of an inertial unit from a record of it, at rest or on the move.
//!
//! The record is cut into windows. In each, the gyros carry the attitude on from a levelled start, and the specific force, turned
//! into axes that stand still, tells the tilt of that attitude from sample to sample. What is constant and not noise (the start,
//! biases in body axes, a delay between gyros and accelerometers, tones) is fitted and taken out ([`turned`]); the rest is a random walk of gyro noise
//! plus the noise of the accelerometers, whose shares autocovariance least squares tells apart. Motion is no obstacle as long as the
//! body does not accelerate; where it does, the lag covariances are none of that model and the window is not used.
//!
//! In the order data flow: [`steps`] finds the pieces, [`window`] cuts and levels them, [`guess`] has first values, [`scales`] judges
//! windows by the fit of [`regress`], [`told`] says what they show together, [`heading`] does the same with the field. [`identify`] is the
//! way through.

mod guess;
mod heading;
mod identify;
mod regress;
mod rest;
mod scales;
mod steps;
mod told;
mod tones;
mod turned;
mod window;

pub use identify::{IdentifyOptions, identify_noise};
pub use rest::{AxisStability, RestStability, rest_stability};

use crate::time::Time;
use nalgebra::Vector3;
use std::string::String;
use std::vec::Vec;

/// One instant of an inertial record, in any right-handed body axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseReading {
    /// Stamp.
    pub time: Time,
    /// Angular rate, rad/s.
    pub angular_rate_b: Vector3<f64>,
    /// Specific force, m/s².
    pub specific_force_b: Vector3<f64>,
    /// Magnetic field, T, at the instants that have one.
    pub magnetic_field_b: Option<Vector3<f64>>,
}

/// A number as identified, with what it is worth.
#[derive(Clone, Debug, PartialEq)]
pub struct Known {
    /// The value; where nothing is identified, what was known before.
    pub value: f64,
    /// One sigma; of a value that was known before, NaN.
    pub standard_error: f64,
    /// Whether the record tells it.
    pub accepted: bool,
    /// Why, or why not.
    pub reason: String,
}

/// What a record shows of gyros and accelerometers.
#[derive(Clone, Debug, PartialEq)]
pub struct TiltNoise {
    /// White noise of the gyros, mean of the axes that were horizontal, rad/√s.
    pub gyro_white: Known,
    /// White noise of the tilt that accelerometers tell, rad √s: divide by the root of a step for the sigma of one sample.
    pub tilt_white: Known,
    /// The same as noise of the accelerometers, m/s/√s.
    pub accel_white: Known,
    /// How far each body axis was horizontal in the windows that are used, 0 to 1: only then its noise is seen.
    pub axes_seen: [f64; 3],
    /// Weighted sum of squares of what the model leaves of the lag covariances of all windows that are used; NaN without any.
    pub chi2: f64,
    /// Lag covariances less unknowns.
    pub dof: usize,
}

/// What a record shows of its magnetometer.
#[derive(Clone, Debug, PartialEq)]
pub struct HeadingNoise {
    /// White noise of the heading that the horizontal field tells, rad √s.
    pub heading_white: Known,
    /// The same as noise of one sample of the magnetometer, T.
    pub magnetometer: Known,
    /// White noise of the gyros as the heading shows it, rad/√s.
    pub gyro_white: Known,
    /// As of [`TiltNoise`].
    pub chi2: f64,
    /// As of [`TiltNoise`].
    pub dof: usize,
    /// Windows that are used.
    pub windows: usize,
}

/// Wander of the gyro bias: random walk of the rate, rad/s/√s.
#[derive(Clone, Debug, PartialEq)]
pub struct BiasNoise {
    /// As taken for known by the estimate of the other noises.
    pub prior: f64,
    /// What the record shows; seldom anything.
    pub wander: Known,
}

/// One window of the record.
#[derive(Clone, Debug, PartialEq)]
pub struct WindowNoise {
    /// Begin.
    pub begin: Time,
    /// End.
    pub end: Time,
    /// White noise of the gyros in this window alone, rad/√s, with its standard error; NaN where none could be told.
    pub gyro_white: [f64; 2],
    /// White noise of the tilt likewise, rad √s.
    pub tilt_white: [f64; 2],
    /// χ² by degree of freedom.
    pub chi2_per_dof: f64,
    /// Whether it went into the estimate.
    pub accepted: bool,
    /// Why, or why not.
    pub reason: String,
}

/// Noise of a record.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordNoise {
    /// Usual step between samples, s.
    pub step_s: f64,
    /// Samples.
    pub samples: usize,
    /// Pieces without a gap.
    pub pieces: usize,
    /// Length of a window, s.
    pub window_s: f64,
    /// So many samples are averaged into one that is filtered.
    pub averaged: usize,
    /// Number of lags.
    pub lags: usize,
    /// Lines in the spectrum of the accelerometers that are taken out of every window, Hz.
    pub tones_hz: Vec<f64>,
    /// Gyros and accelerometers.
    pub tilt: TiltNoise,
    /// Magnetometer; `None` for a record without.
    pub heading: Option<HeadingNoise>,
    /// Wander of the gyro bias.
    pub gyro_bias: BiasNoise,
    /// All windows, in the order of time.
    pub windows: Vec<WindowNoise>,
}

impl RecordNoise {
    /// The windows that went into the estimate, neighbours joined.
    pub fn accepted_intervals(&self) -> Vec<(Time, Time)> {
        let mut joined: Vec<(Time, Time)> = Vec::new();
        for window in self.windows.iter().filter(|w| w.accepted) {
            match joined.last_mut() {
                Some(last) if window.begin.since(last.1) < 1.5 * self.step_s => last.1 = window.end,
                _ => joined.push((window.begin, window.end)),
            }
        }
        joined
    }
}
