//! A body at one place, simulated sample by sample, and what a navigator makes of it.

// Each test that takes this in uses a part of it.
#![allow(dead_code)]

use insnav::attitude::Euler;
use insnav::config::{Config, DetectorKind, Intervals, StationaryConfig, StationaryMode};
use insnav::earth::{Geodetic, LocalEarth};
use insnav::filter::InitialSigma;
use insnav::imu::{ImuErrors, ImuGrade, ImuNoise};
use insnav::mechanization::NavState;
use insnav::navigator::Navigator;
use insnav::sample::{GnssPosition, ImuSample, Sample};
use insnav::sim::{Source, Stream};
use insnav::solution::{Epoch, Event, Sink};
use insnav::stationary::StopRecord;
use insnav::time::Time;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

pub(crate) const BEGIN: Time = Time(1_700_000_000_000_000_000);
pub(crate) const RATE: f64 = 100.0;

/// A body at one place, turned as a function of time says: roll, pitch, heading in degrees.
pub(crate) struct AtRest<F: Fn(f64) -> [f64; 3]> {
    pub(crate) attitude_deg: F,
    pub(crate) errors: ImuErrors,
    pub(crate) noise: ImuNoise,
    /// Steps of the gyro's values, rad/s; 0: none.
    pub(crate) gyro_step: f64,
    pub(crate) seed: u64,
}

impl<F: Fn(f64) -> [f64; 3]> AtRest<F> {
    pub(crate) fn place() -> Geodetic {
        Geodetic::from_degrees(55.0, 37.0, 200.0)
    }

    pub(crate) fn q_nb(&self, t: f64) -> UnitQuaternion<f64> {
        let [roll, pitch, heading] = (self.attitude_deg)(t);
        Euler::from_degrees(roll, pitch, heading).to_quaternion()
    }

    /// Inertial samples and fixes of `sigma` metres once a second; the sample at `t` is the mean over the interval around it.
    pub(crate) fn samples(&self, duration: f64, sigma: f64) -> Vec<Sample> {
        let mut source = Source::new(self.seed, Stream::Initial);
        let earth = LocalEarth::at(&Self::place());
        let dt = 1.0 / RATE;
        let mut out = Vec::new();
        for k in 0..=(duration * RATE) as i64 {
            let t = k as f64 * dt;
            let time = BEGIN.plus(t);
            if k % RATE as i64 == 0 {
                out.push(Sample::GnssPosition(GnssPosition {
                    time,
                    position: Self::place().offset(&(source.normal3() * sigma)),
                    covariance_n: Some(Matrix3::identity() * (sigma * sigma)),
                }));
            }
            let (before, after) = (self.q_nb(t - 0.5 * dt), self.q_nb(t + 0.5 * dt));
            let turn = (before.inverse() * after).scaled_axis() / dt;
            let to_b = self.q_nb(t).inverse();
            let white = RATE.sqrt();
            let rate = turn
                + to_b * earth.earth_rate_n()
                + self.errors.gyro_bias
                + source.normal3() * (self.noise.gyro_white * white);
            let stepped = |x: f64| {
                if self.gyro_step > 0.0 {
                    (x / self.gyro_step).round() * self.gyro_step
                } else {
                    x
                }
            };
            let force = to_b * Vector3::new(0.0, 0.0, -earth.gravity())
                + self.errors.accel_bias
                + source.normal3() * (self.noise.accel_white * white);
            out.push(Sample::Imu(ImuSample {
                time,
                angular_rate_b: rate.map(stepped),
                specific_force_b: force,
            }));
        }
        out
    }

    pub(crate) fn nav(&self) -> NavState {
        NavState {
            time: BEGIN,
            position: Self::place(),
            velocity_n: Vector3::zeros(),
            q_nb: self.q_nb(0.0),
        }
    }
}

#[derive(Default)]
pub(crate) struct Record {
    pub(crate) epochs: Vec<Epoch>,
    pub(crate) stops: Vec<StopRecord>,
}

impl Sink for Record {
    fn epoch(&mut self, epoch: &Epoch) {
        self.epochs.push(*epoch);
    }

    fn event(&mut self, event: &Event) {
        if let Event::StopEnded(stop) = event {
            self.stops.push(*stop);
        }
    }
}

pub(crate) fn declared(mode: StationaryMode, intervals: &[[f64; 2]]) -> Config {
    Config {
        stationary: StationaryConfig {
            mode,
            detector: DetectorKind::None,
            intervals_s: Intervals::new(intervals).expect("few"),
            ..StationaryConfig::default()
        },
        ..Config::default()
    }
}

pub(crate) fn sigma(heading_deg: f64) -> InitialSigma {
    let each = Vector3::from_element;
    let noise = ImuGrade::Industrial.noise();
    InitialSigma {
        position: each(1.0),
        velocity: each(0.05),
        attitude: Vector3::new(0.002, 0.002, heading_deg.to_radians()),
        gyro_bias: each(noise.gyro_bias_sigma),
        accel_bias: each(noise.accel_bias_sigma),
    }
}

pub(crate) fn run(
    config: &Config,
    nav: NavState,
    sigma: &InitialSigma,
    samples: &[Sample],
) -> Record {
    let noise = ImuGrade::Industrial.noise();
    let mut navigator =
        Navigator::aligned(config, noise, nav, ImuErrors::default(), sigma).expect("good settings");
    let mut record = Record::default();
    for sample in samples {
        navigator.step(sample, &mut record).expect("good samples");
    }
    navigator.finish(&mut record).expect("good samples");
    record
}

pub(crate) fn still(seed: u64) -> AtRest<impl Fn(f64) -> [f64; 3]> {
    let noise = ImuGrade::Industrial.noise();
    let mut source = Source::new(seed, Stream::GyroBias);
    AtRest {
        attitude_deg: |_| [1.0, -2.0, 130.0],
        errors: ImuErrors {
            gyro_bias: source.normal3() * noise.gyro_bias_sigma,
            accel_bias: source.normal3() * noise.accel_bias_sigma,
            ..ImuErrors::default()
        },
        noise,
        gyro_step: 0.0,
        seed,
    }
}

/// Standard deviations of the gyro bias.
pub(crate) fn gyro_bias_sigma(epoch: &Epoch) -> Vector3<f64> {
    Vector3::from_fn(|k, _| epoch.covariance[(9 + k, 9 + k)].sqrt())
}
