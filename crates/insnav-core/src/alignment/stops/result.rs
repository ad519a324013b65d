//! What every method of alignment from stops gives.

use super::standing::Taper;
use crate::attitude::Euler;
use crate::time::Time;
use nalgebra::{SMatrix, UnitQuaternion, Vector3, Vector4};
use serde::{Deserialize, Serialize};
use std::string::String;
use std::vec::Vec;

/// How an attitude is found from stops.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AlignmentMethod {
    /// What suits the unit and the stops: levelling where north cannot be found, a Kalman filter on a quiet base, the joint
    /// tapered regression on a rocking one.
    #[default]
    Auto,
    /// Roll and pitch from gravity in the last stop; the mean rate is taken for the gyro bias.
    Levelling,
    /// Gravity and the mean rate as two vectors, in the last stop.
    TwoVector,
    /// Optimisation-based alignment in the inertial frame, by the q-method, in the last stop.
    Coarse,
    /// A third-order levelling loop in the last stop.
    Gyrocompass,
    /// The Kalman filter in the last stop alone.
    Fine,
    /// Two or more stops with turns between them: Kalman filter or joint regression, as the base is quiet or rocks.
    MultiPosition,
    /// The joint regression (ZUPT-1J) of all stops.
    Joint,
    /// The Kalman filter over all stops.
    Kalman,
    /// The explicit equations of \[Lobusov14\], one stop after the other.
    Paper,
    /// Drifts from one stop whose heading is known (ZUPT-2).
    Zupt2,
}

impl AlignmentMethod {
    /// All, in the order of `--help`.
    pub const ALL: [AlignmentMethod; 11] = [
        AlignmentMethod::Auto,
        AlignmentMethod::Levelling,
        AlignmentMethod::TwoVector,
        AlignmentMethod::Coarse,
        AlignmentMethod::Gyrocompass,
        AlignmentMethod::Fine,
        AlignmentMethod::MultiPosition,
        AlignmentMethod::Joint,
        AlignmentMethod::Kalman,
        AlignmentMethod::Paper,
        AlignmentMethod::Zupt2,
    ];

    /// Name as in reports.
    pub fn name(self) -> &'static str {
        match self {
            AlignmentMethod::Auto => "auto",
            AlignmentMethod::Levelling => "levelling",
            AlignmentMethod::TwoVector => "two_vector",
            AlignmentMethod::Coarse => "coarse",
            AlignmentMethod::Gyrocompass => "gyrocompass",
            AlignmentMethod::Fine => "fine",
            AlignmentMethod::MultiPosition => "multi_position",
            AlignmentMethod::Joint => "joint",
            AlignmentMethod::Kalman => "kalman",
            AlignmentMethod::Paper => "paper",
            AlignmentMethod::Zupt2 => "zupt2",
        }
    }
}

/// Attitude and sensor errors from stops, with all that is known of their errors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AlignmentResult {
    /// The method that gave it: never [`AlignmentMethod::Auto`].
    pub method: AlignmentMethod,
    /// Why that one.
    pub reason: String,
    /// The instant for which everything holds: the end of the last stop.
    pub at: Time,
    /// Attitude then, body to NED.
    pub q_nb: UnitQuaternion<f64>,
    /// Heading of the body's x axis at the first stop's begin, where the level frame of the drift-free equations is taken,
    /// rad: the azimuth of \[Lobusov14\]. `None` where north is not found, and by methods without a fit, which know the end only.
    pub azimuth: Option<f64>,
    /// Gyro bias (drift), body, rad/s: measured minus true.
    pub gyro_bias: Vector3<f64>,
    /// Accelerometer bias, body, m/s².
    pub accel_bias: Vector3<f64>,
    /// Covariance of attitude error (φ, n: `C = Exp(φ) Ĉ`), gyro bias and accelerometer bias, cross terms included.
    pub covariance: SMatrix<f64, 9, 9>,
    /// Whether the stops said something of each of these nine: attitude to better than the largest azimuth sigma allowed, biases to
    /// less than nine tenths of their sigma beforehand.
    pub observable: [bool; 9],
    /// Sigma that the azimuth has or, where it is not found, would have with this unit and these stops, rad.
    pub azimuth_sigma: f64,
    /// The combination of azimuth and drift (north, east, down at the first stop, over Ω cos L) that the attitudes tell least.
    pub weakest: Vector4<f64>,
    /// How well they tell it, a singular value: 0 not at all, 1.4 the best that two positions can do.
    pub geometry_ratio: f64,
    /// Horizontal Earth rate found over that of the latitude, minus one, and its sigma (once and a half the bias sigma of the unit
    /// allowed for, where the positions do not tell the drift); with two or more stops.
    pub norm_residual: Option<[f64; 2]>,
    /// Normalised innovations squared of the Kalman filter over their number: 1 or less on a quiet base.
    pub nis_ratio: Option<f64>,
    /// Per stop.
    pub stops: Vec<StopReport>,
}

/// What one stop showed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StopReport {
    /// Begin.
    pub begin: Time,
    /// End.
    pub end: Time,
    /// Rate that attitude, Earth and drift together explain there, n, rad/s, and what is left over.
    pub rate_n: Vector3<f64>,
    /// What the stop's own fit leaves of it, rad/s.
    pub residual_rate_n: Vector3<f64>,
    /// Standard deviation of that by the unit's noise and the rocking of the stop.
    pub sigma_rate: Vector3<f64>,
    /// Mean attitude.
    pub q_nb: UnitQuaternion<f64>,
    /// Scatter of the attitude about it: north, east, down, rad rms.
    pub rocking_rms: Vector3<f64>,
    /// Scatter of the computed velocity about its fit, m/s rms.
    pub velocity_rms: f64,
    /// Weights used.
    pub taper: Taper,
    /// Largest difference of the rates of the two halves, in its sigmas.
    pub half_disagreement: f64,
    /// Period of the strongest rocking, s, when it rocks.
    pub rocking_period_s: Option<f64>,
}

impl AlignmentResult {
    /// Roll, pitch and heading.
    pub fn euler(&self) -> Euler {
        Euler::from_quaternion(&self.q_nb)
    }

    /// Standard deviations of the nine, rad, rad/s, m/s².
    pub fn sigma(&self) -> [f64; 9] {
        core::array::from_fn(|i| self.covariance[(i, i)].max(0.0).sqrt())
    }
}
