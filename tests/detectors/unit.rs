//! The unit of the study's table and what shakes it.

use core::f64::consts::TAU;
use insnav::config::StationaryConfig;
use insnav::imu::{ImuNoise, STANDARD_GRAVITY};
use insnav::sample::{ImuSample, Sample};
use insnav::sim::{Source, Stream};
use insnav::stationary::{Belief, RestNoise, StopDetector};
use insnav::time::Time;
use nalgebra::{Matrix3, Vector3};

pub(crate) const ACCEL_WHITE: f64 = 0.008;
pub(crate) const GYRO_WHITE: f64 = 0.05 / 180.0 * core::f64::consts::PI;
pub(crate) const IDLE_HZ: f64 = 26.7;
pub(crate) const RATES: [f64; 3] = [30.0, 100.0, 200.0];

pub(crate) fn windows() -> u64 {
    if std::env::var_os("INSNAV_LONG").is_some() {
        20_000
    } else {
        2000
    }
}

/// What moves the unit beside its noise.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Shaking {
    /// Amplitudes, m/s² and rad/s.
    pub(crate) idle: (f64, f64),
    /// Down, rms, m/s².
    pub(crate) road: f64,
    pub(crate) turn: f64,
    pub(crate) accel: f64,
    pub(crate) accel_bias: f64,
    pub(crate) gyro_bias: f64,
}

impl Shaking {
    /// Whether a part of it is another in each run.
    pub(crate) fn is_drawn(&self) -> bool {
        self.idle.0 > 0.0 || self.road > 0.0
    }
}

/// What a sample is of the vibration about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Output {
    /// Its value at an instant: everything above half the sampling rate comes down into the band.
    Instants,
    /// Its mean over the interval, as of a unit that samples fast and gives increments or their means.
    Means,
    /// Behind a low-pass of second order (Butterworth) with its corner at four tenths of the sampling rate.
    LowPassed,
}

impl Output {
    /// Gain at the frequency of the engine.
    fn gain(self, rate: f64) -> f64 {
        let x = IDLE_HZ / rate;
        match self {
            Output::Instants => 1.0,
            Output::Means => (0.5 * TAU * x).sin() / (0.5 * TAU * x),
            Output::LowPassed => (1.0 + (x / 0.4).powi(4)).powf(-0.5),
        }
    }
}

/// Samples of one run.
pub(crate) struct Unit {
    source: Source,
    pub(crate) rate: f64,
    shaking: Shaking,
    phases: [f64; 6],
    road: Vector3<f64>,
    index: u32,
    /// Factor on its noise.
    noise: f64,
    output: Output,
}

impl Unit {
    pub(crate) fn new(seed: u64, rate: f64, shaking: Shaking) -> Self {
        let mut source = Source::new(seed, Stream::AccelWhite);
        let phases = core::array::from_fn(|_| source.between(0.0, TAU));
        Unit {
            source,
            rate,
            shaking,
            phases,
            road: Vector3::zeros(),
            index: 0,
            noise: 1.0,
            output: Output::Instants,
        }
    }

    /// The same, what shakes it drawn alike.
    pub(crate) fn without_noise(seed: u64, rate: f64, shaking: Shaking) -> Self {
        Unit {
            noise: 0.0,
            ..Self::new(seed, rate, shaking)
        }
    }

    pub(crate) fn giving(self, output: Output) -> Self {
        Unit { output, ..self }
    }

    /// Time, specific force, rate.
    pub(crate) fn next(&mut self) -> (f64, Vector3<f64>, Vector3<f64>) {
        let s = &self.shaking;
        let t = f64::from(self.index) / self.rate;
        self.index += 1;
        let root = self.rate.sqrt() * self.noise;
        let gain = self.output.gain(self.rate);
        let sine = |k: usize| gain * (TAU * IDLE_HZ * t + self.phases[k]).sin();
        let decay = (-TAU * 10.0 / self.rate).exp();
        let drive = (1.0 - decay * decay).sqrt();
        let along = Vector3::new(0.5, 0.5, 1.0) * s.road;
        let drawn = self.source.normal3();
        let start = if self.index == 1 { 1.0 } else { drive };
        self.road = self.road * decay + drawn.component_mul(&along) * start;
        let force = Vector3::new(s.accel, 0.0, -STANDARD_GRAVITY) - Vector3::z() * s.accel_bias
            + self.source.normal3() * (ACCEL_WHITE * root)
            + Vector3::from_fn(|k, _| s.idle.0 * sine(k))
            + self.road;
        let rate = self.source.normal3() * (GYRO_WHITE * root)
            + Vector3::from_fn(|k, _| s.idle.1 * sine(k + 3))
            + Vector3::repeat(s.gyro_bias)
            + Vector3::z() * s.turn;
        (t, force, rate)
    }
}

pub(crate) fn idle(force: f64, deg_per_s: f64) -> Shaking {
    Shaking {
        idle: (force, deg_per_s.to_radians()),
        ..Shaking::default()
    }
}

pub(crate) fn road(rms: f64) -> Shaking {
    Shaking {
        road: rms,
        ..Shaking::default()
    }
}

pub(crate) fn turn(deg_per_s: f64) -> Shaking {
    Shaking {
        turn: deg_per_s.to_radians(),
        ..Shaking::default()
    }
}

/// What the table's unit leaves of its biases: 0.08 m/s² along gravity (across it adds its square over 2 g, which no threshold
/// knows of) and, per axis, 0.0412 °/s.
pub(crate) const ACCEL_BIAS: f64 = 0.08;
pub(crate) const GYRO_BIAS: f64 = 0.0412 / 180.0 * core::f64::consts::PI;

pub(crate) fn imu_noise() -> ImuNoise {
    ImuNoise {
        gyro_white: GYRO_WHITE,
        accel_white: ACCEL_WHITE,
        gyro_bias_sigma: 7e-4,
        accel_bias_sigma: ACCEL_BIAS,
        gyro_bias_tau: 1e4,
        accel_bias_tau: 1e4,
    }
}

pub(crate) fn rest_noise() -> RestNoise {
    let mut noise = RestNoise::new(&StationaryConfig::default(), false, &imu_noise());
    // Without what gravity differs by from place to place: the study's does not.
    noise.accel_bias = ACCEL_BIAS;
    noise
}

pub(crate) fn knows_nothing() -> Belief {
    Belief {
        rate_b: Vector3::zeros(),
        // 0.007 °/s: a gyro bias as the filter knows it after a minute of standing.
        rate_covariance_b: Matrix3::from_diagonal_element(0.007f64.to_radians().powi(2)),
        velocity_n: Vector3::zeros(),
        velocity_covariance_n: Matrix3::from_diagonal_element(100.0),
    }
}

pub(crate) fn stands() -> Belief {
    Belief {
        velocity_covariance_n: Matrix3::from_diagonal_element(0.01 * 0.01),
        ..knows_nothing()
    }
}

pub(crate) fn detector() -> StopDetector {
    StopDetector::new(&StationaryConfig::default(), &imu_noise())
}

pub(crate) fn imu(t: f64, force: Vector3<f64>, rate: Vector3<f64>) -> Sample {
    Sample::Imu(ImuSample {
        time: Time::from_seconds(t),
        angular_rate_b: rate,
        specific_force_b: force,
    })
}
