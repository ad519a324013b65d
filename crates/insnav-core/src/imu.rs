//! Errors of an inertial unit: what the filter estimates, and what the data sheet says.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// The slowly varying errors that are estimated and taken out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ImuErrors {
    /// Gyro bias b_g: measured rate = (1 + s_g) true rate + b_g + noise, rad/s, body axes.
    pub gyro_bias: Vector3<f64>,
    /// Accelerometer bias b_a: measured force = (1 + s_a) true force + b_a + noise, m/s², body axes.
    pub accel_bias: Vector3<f64>,
    /// Gyro scale factor errors s_g, body axes; 0 unless they are estimated or known.
    pub gyro_scale: Vector3<f64>,
    /// Accelerometer scale factor errors s_a, likewise.
    pub accel_scale: Vector3<f64>,
}

impl ImuErrors {
    /// Whether there is a scale factor to take out.
    pub(crate) fn has_scale(&self) -> bool {
        self.gyro_scale != Vector3::zeros() || self.accel_scale != Vector3::zeros()
    }
}

/// Noise of an inertial unit: white densities and first-order Gauss–Markov biases, equal on all axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImuNoise {
    /// Gyro white noise (angle random walk), rad/√s.
    pub gyro_white: f64,
    /// Accelerometer white noise (velocity random walk), m/s/√s.
    pub accel_white: f64,
    /// Steady-state standard deviation of the Gauss–Markov gyro bias, and that of the bias at power-on, rad/s.
    pub gyro_bias_sigma: f64,
    /// Likewise of the accelerometer bias, m/s².
    pub accel_bias_sigma: f64,
    /// Correlation time of the gyro bias, s.
    pub gyro_bias_tau: f64,
    /// Correlation time of the accelerometer bias, s.
    pub accel_bias_tau: f64,
}

/// Class of an inertial unit, where no data sheet is given.
///
/// Round numbers from the middle of the classes of \[Groves13\] table 4.1. The bias is one stationary process for both the
/// unknown constant at power-on and its wander: the sigma is that of power-on, the long correlation time gives a wander of
/// `sigma √(2/τ)` per root second.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ImuGrade {
    /// Phone or hobby MEMS: 2 °/√h, 1.5 m/s/√h, biases 500 °/h and 20 mg.
    Consumer,
    /// Car MEMS: 0.5 °/√h, 0.5 m/s/√h, biases 200 °/h and 10 mg.
    Automotive,
    /// Calibrated MEMS: 0.15 °/√h, 0.1 m/s/√h, biases 30 °/h and 3 mg.
    Industrial,
    /// FOG or best MEMS: 0.05 °/√h, 0.03 m/s/√h, biases 3 °/h and 1 mg.
    Tactical,
    /// Ring laser: 0.002 °/√h, 0.01 m/s/√h, biases 0.01 °/h and 0.05 mg.
    Navigation,
}

/// One g as data sheets mean it, m/s².
pub const STANDARD_GRAVITY: f64 = 9.806_65;

impl ImuGrade {
    /// All grades, from the worst.
    pub const ALL: [ImuGrade; 5] = [
        ImuGrade::Consumer,
        ImuGrade::Automotive,
        ImuGrade::Industrial,
        ImuGrade::Tactical,
        ImuGrade::Navigation,
    ];

    /// Name as in the configuration file.
    pub fn name(self) -> &'static str {
        match self {
            ImuGrade::Consumer => "consumer",
            ImuGrade::Automotive => "automotive",
            ImuGrade::Industrial => "industrial",
            ImuGrade::Tactical => "tactical",
            ImuGrade::Navigation => "navigation",
        }
    }

    /// The noise of this class.
    pub fn noise(self) -> ImuNoise {
        // °/√h, m/s/√h, °/h, mg, s
        let (arw, vrw, gyro_bias, accel_bias, tau) = match self {
            ImuGrade::Consumer => (2.0, 1.5, 500.0, 20.0, 20_000.0),
            ImuGrade::Automotive => (0.5, 0.5, 200.0, 10.0, 20_000.0),
            ImuGrade::Industrial => (0.15, 0.1, 30.0, 3.0, 20_000.0),
            ImuGrade::Tactical => (0.05, 0.03, 3.0, 1.0, 20_000.0),
            ImuGrade::Navigation => (0.002, 0.01, 0.01, 0.05, 20_000.0),
        };
        ImuNoise::from_data_sheet(arw, vrw, gyro_bias, accel_bias, tau, tau)
    }
}

impl ImuNoise {
    /// From the units of data sheets: °/√h, m/s/√h, °/h, mg, s, s.
    pub fn from_data_sheet(
        gyro_arw_deg_per_sqrt_hour: f64,
        accel_vrw_m_per_s_per_sqrt_hour: f64,
        gyro_bias_deg_per_hour: f64,
        accel_bias_mg: f64,
        gyro_bias_tau_s: f64,
        accel_bias_tau_s: f64,
    ) -> Self {
        let gyro_bias = gyro_bias_deg_per_hour.to_radians() / 3600.0;
        let accel_bias = accel_bias_mg * 1e-3 * STANDARD_GRAVITY;
        ImuNoise {
            gyro_white: gyro_arw_deg_per_sqrt_hour.to_radians() / 60.0,
            accel_white: accel_vrw_m_per_s_per_sqrt_hour / 60.0,
            gyro_bias_sigma: gyro_bias,
            accel_bias_sigma: accel_bias,
            gyro_bias_tau: gyro_bias_tau_s,
            accel_bias_tau: accel_bias_tau_s,
        }
    }
}
