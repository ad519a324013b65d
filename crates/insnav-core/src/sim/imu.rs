//! What an inertial unit says: exact increments or rates of a trajectory, then its errors.

use super::noise::{GaussMarkov, Source, Stream};
use super::quadrature::gauss_legendre;
use super::trajectory::Trajectory;
use crate::error::{Error, Result};
use crate::imu::{ImuErrors, ImuNoise};
use crate::sample::{ImuIncrement, ImuSample, Sample};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// What a unit puts out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ImuOutput {
    /// Angular rate and specific force at the stamp.
    #[default]
    Rates,
    /// Their integrals over the interval that ends at the stamp.
    Increments,
}

/// An inertial unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImuModel {
    /// Samples per second.
    pub rate_hz: f64,
    /// Rates or increments.
    #[serde(default)]
    pub output: ImuOutput,
    /// What is wrong with it.
    #[serde(default)]
    pub errors: ImuErrorModel,
}

/// Errors of an inertial unit: measured = (1 + scale) true + constant bias + drifting bias + white noise, then quantised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImuErrorModel {
    /// White noise and drifting biases, SI; the first value of a bias has the power-on sigma. `None`: neither.
    pub noise: Option<ImuNoise>,
    /// Constant gyro bias, degrees per hour, body axes.
    pub gyro_bias_deg_per_hour: [f64; 3],
    /// Constant accelerometer bias, m/s², body axes.
    pub accel_bias_m_per_s2: [f64; 3],
    /// Scale factor errors of the gyros, parts per million.
    pub gyro_scale_ppm: [f64; 3],
    /// Scale factor errors of the accelerometers, parts per million.
    pub accel_scale_ppm: [f64; 3],
    /// Least step of an angular output: rad/s of rates, rad of increments; 0: continuous.
    pub gyro_quantum: f64,
    /// Least step of a force output: m/s² of rates, m/s of increments; 0: continuous.
    pub accel_quantum: f64,
}

impl ImuErrorModel {
    /// White noise and drifting biases only.
    pub fn from_noise(noise: ImuNoise) -> Self {
        ImuErrorModel {
            noise: Some(noise),
            ..Self::default()
        }
    }

    fn constant(&self) -> ImuErrors {
        ImuErrors {
            gyro_bias: Vector3::from(self.gyro_bias_deg_per_hour).map(|v| v.to_radians() / 3600.0),
            accel_bias: Vector3::from(self.accel_bias_m_per_s2),
        }
    }
}

/// Nodes per panel and longest panel (s) of the integrals: of tenth order, so that a 20 Hz motion leaves less than rounding.
const NODES: usize = 5;
const PANEL: f64 = 0.01;

impl ImuModel {
    pub(super) fn check(&self) -> Result<()> {
        let require = |ok: bool, key, value, expected| {
            if ok {
                Ok(())
            } else {
                Err(Error::Config {
                    key,
                    value,
                    expected,
                })
            }
        };
        require(
            self.rate_hz > 0.0 && self.rate_hz <= 1e5,
            "imu.rate_hz",
            self.rate_hz,
            "positive and at most 100000",
        )?;
        let e = &self.errors;
        let finite = |v: &[f64; 3], key| {
            v.iter()
                .try_for_each(|v| require(v.is_finite(), key, *v, "finite"))
        };
        finite(
            &e.gyro_bias_deg_per_hour,
            "imu.errors.gyro_bias_deg_per_hour",
        )?;
        finite(&e.accel_bias_m_per_s2, "imu.errors.accel_bias_m_per_s2")?;
        finite(&e.gyro_scale_ppm, "imu.errors.gyro_scale_ppm")?;
        finite(&e.accel_scale_ppm, "imu.errors.accel_scale_ppm")?;
        require(
            e.gyro_quantum >= 0.0,
            "imu.errors.gyro_quantum",
            e.gyro_quantum,
            "not negative",
        )?;
        require(
            e.accel_quantum >= 0.0,
            "imu.errors.accel_quantum",
            e.accel_quantum,
            "not negative",
        )?;
        if let Some(n) = &e.noise {
            let sigma = |v: f64, key| {
                require(
                    (0.0..f64::INFINITY).contains(&v),
                    key,
                    v,
                    "finite and not negative",
                )
            };
            sigma(n.gyro_white, "imu.errors.noise.gyro_white")?;
            sigma(n.accel_white, "imu.errors.noise.accel_white")?;
            sigma(n.gyro_bias_sigma, "imu.errors.noise.gyro_bias_sigma")?;
            sigma(n.accel_bias_sigma, "imu.errors.noise.accel_bias_sigma")?;
            sigma(n.gyro_turn_on_sigma, "imu.errors.noise.gyro_turn_on_sigma")?;
            sigma(
                n.accel_turn_on_sigma,
                "imu.errors.noise.accel_turn_on_sigma",
            )?;
            require(
                n.gyro_bias_tau > 0.0,
                "imu.errors.noise.gyro_bias_tau",
                n.gyro_bias_tau,
                "positive",
            )?;
            require(
                n.accel_bias_tau > 0.0,
                "imu.errors.noise.accel_bias_tau",
                n.accel_bias_tau,
                "positive",
            )?;
        }
        Ok(())
    }
}

/// ∫ω_ib dt and ∫f dt over the `span` that ends at `to` (s after the start), both resolved in the body axes as they turn:
/// rad, m/s.
fn quadrature<const N: usize>(
    trajectory: &Trajectory,
    to: f64,
    span: f64,
    rule: &[(f64, f64); N],
    longest: f64,
) -> (Vector3<f64>, Vector3<f64>) {
    // A rounded-up 0.01 / 0.01 must not make two panels.
    let panels = (span / longest - 1e-6).ceil().max(1.0);
    // From the span itself: the difference of two instants an hour on is known to 1e-10 of a sample interval only.
    let half = 0.5 * span / panels;
    let (mut angle, mut velocity) = (Vector3::zeros(), Vector3::zeros());
    for i in 0..panels as usize {
        let middle = to - half * (2.0 * i as f64 + 1.0);
        for (x, w) in rule {
            let k = trajectory.after(middle + half * x);
            angle += k.angular_rate_b * *w;
            velocity += k.specific_force_b * *w;
        }
    }
    (angle * half, velocity * half)
}

/// The samples of a unit on a trajectory and its biases at every one of them.
///
/// The first stamp is the start. With increments, its interval lies before the start, where the first instant holds.
pub(super) fn simulate(
    model: &ImuModel,
    trajectory: &Trajectory,
    duration: f64,
    seed: u64,
) -> (Vec<Sample>, Vec<ImuErrors>) {
    let mut unit = Unit::new(model, seed);
    let rule = gauss_legendre::<NODES>();
    let count = (duration * model.rate_hz + 1e-6).floor() as usize;
    let mut samples = Vec::with_capacity(count + 1);
    let mut biases = Vec::with_capacity(count + 1);
    let dt = 1.0 / model.rate_hz;
    let mut previous = trajectory.start().plus(-dt);
    for i in 0..=count {
        let time = trajectory.start().plus(i as f64 / model.rate_hz);
        // Stamps are whole nanoseconds: the integrals run between stamps, not between multiples of 1/rate.
        let to = time.since(trajectory.start());
        let span = time.since(previous);
        if i > 0 {
            unit.drift(span);
        }
        samples.push(match model.output {
            ImuOutput::Rates => {
                let k = trajectory.after(to);
                let (w, f) = unit.corrupt(
                    &k.angular_rate_b,
                    &k.specific_force_b,
                    1.0,
                    (1.0 / dt).sqrt(),
                );
                Sample::Imu(ImuSample {
                    time,
                    angular_rate_b: w,
                    specific_force_b: f,
                })
            }
            ImuOutput::Increments => {
                let (angle, velocity) = quadrature(trajectory, to, span, &rule, PANEL);
                let (a, v) = unit.corrupt(&angle, &velocity, span, span.sqrt());
                Sample::ImuIncrement(ImuIncrement {
                    time,
                    angle_b: a,
                    velocity_b: v,
                })
            }
        });
        biases.push(unit.biases());
        previous = time;
    }
    (samples, biases)
}

/// A unit with its random sources.
struct Unit {
    constant: ImuErrors,
    gyro_gain: Vector3<f64>,
    accel_gain: Vector3<f64>,
    noise: Option<Noise>,
    quantum: (f64, f64),
    /// What quantisation of increments has held back: a counting output loses nothing.
    residue: Option<(Vector3<f64>, Vector3<f64>)>,
}

struct Noise {
    gyro_white: (f64, Source),
    accel_white: (f64, Source),
    gyro_bias: GaussMarkov,
    accel_bias: GaussMarkov,
}

impl Unit {
    fn new(model: &ImuModel, seed: u64) -> Self {
        let e = &model.errors;
        let gain = |ppm: [f64; 3]| Vector3::from(ppm).map(|v| 1.0 + v * 1e-6);
        let process = |sigma: f64, initial: f64, tau: f64, stream| {
            GaussMarkov::new(
                Vector3::repeat(sigma),
                Vector3::repeat(initial),
                tau,
                Source::new(seed, stream),
            )
        };
        Unit {
            constant: e.constant(),
            gyro_gain: gain(e.gyro_scale_ppm),
            accel_gain: gain(e.accel_scale_ppm),
            noise: e.noise.map(|n| Noise {
                gyro_white: (n.gyro_white, Source::new(seed, Stream::GyroWhite)),
                accel_white: (n.accel_white, Source::new(seed, Stream::AccelWhite)),
                gyro_bias: process(
                    n.gyro_bias_sigma,
                    n.gyro_turn_on_sigma,
                    n.gyro_bias_tau,
                    Stream::GyroBias,
                ),
                accel_bias: process(
                    n.accel_bias_sigma,
                    n.accel_turn_on_sigma,
                    n.accel_bias_tau,
                    Stream::AccelBias,
                ),
            }),
            quantum: (e.gyro_quantum, e.accel_quantum),
            residue: (model.output == ImuOutput::Increments)
                .then(|| (Vector3::zeros(), Vector3::zeros())),
        }
    }

    fn drift(&mut self, dt: f64) {
        if let Some(n) = &mut self.noise {
            n.gyro_bias.step(dt);
            n.accel_bias.step(dt);
        }
    }

    fn biases(&self) -> ImuErrors {
        let mut errors = self.constant;
        if let Some(n) = &self.noise {
            errors.gyro_bias += n.gyro_bias.value;
            errors.accel_bias += n.accel_bias.value;
        }
        errors
    }

    /// Errors of one sample: biases count `span` times, white noise `white` times its density.
    fn corrupt(
        &mut self,
        angular: &Vector3<f64>,
        force: &Vector3<f64>,
        span: f64,
        white: f64,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let biases = self.biases();
        let mut angular = angular.component_mul(&self.gyro_gain) + biases.gyro_bias * span;
        let mut force = force.component_mul(&self.accel_gain) + biases.accel_bias * span;
        if let Some(n) = &mut self.noise {
            angular += n.gyro_white.1.normal3() * (n.gyro_white.0 * white);
            force += n.accel_white.1.normal3() * (n.accel_white.0 * white);
        }
        let mut none = (Vector3::zeros(), Vector3::zeros());
        let counts = self.residue.is_some();
        let residue = self.residue.as_mut().unwrap_or(&mut none);
        quantise(&mut angular, self.quantum.0, counts, &mut residue.0);
        quantise(&mut force, self.quantum.1, counts, &mut residue.1);
        (angular, force)
    }
}

fn quantise(value: &mut Vector3<f64>, quantum: f64, counts: bool, residue: &mut Vector3<f64>) {
    if quantum > 0.0 {
        let wanted = *value + *residue;
        *value = wanted.map(|v| (v / quantum).round() * quantum);
        if counts {
            *residue = wanted - *value;
        }
    }
}
