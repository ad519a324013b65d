//! Noise of an inertial unit as its own log shows it, and the class it belongs to.

use crate::error::{Error, Result};
use crate::imu::{ImuGrade, STANDARD_GRAVITY};
use crate::sample::Sample;
use crate::time::Time;
use nalgebra::Vector3;

/// Length of the stretches that are judged one by one, s.
const WINDOW: f64 = 2.0;
/// Fewest samples in one.
const FEWEST_SAMPLES: usize = 32;
/// Samples are also averaged over this time, s: most units low-pass what they put out, so that their noise between
/// neighbouring samples is less than its density. A car's motion is still slow against it.
const BLOCK: f64 = 0.05;
/// The share of stretches that counts as quiet.
const QUIET: f64 = 0.1;
/// Earth rate, rad/s: a gyro at rest may show as much on an axis without any bias.
const EARTH_RATE: f64 = 7.292e-5;
/// Largest difference of normal gravity on the ground from its standard value, m/s² (equator and poles, to 5 km).
const GRAVITY_RANGE: f64 = 0.042;
/// A class holds noise up to this multiple of its own: about halfway to the next worse one.
const NOISE_MARGIN: f64 = 1.4;
/// And biases up to this many of its sigmas.
const BIAS_MARGIN: f64 = 3.0;

/// What the quietest stretches of a log show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseFloor {
    /// Samples per second.
    pub rate: f64,
    /// White noise of the gyros, rad/√s, per axis. Vibration that never stops is in it.
    pub gyro_white: Vector3<f64>,
    /// White noise of the accelerometers, m/s/√s, likewise.
    pub accel_white: Vector3<f64>,
    /// White noise of the gyros under way, rad/√s: the middle one of all stretches, quiet or not, mean of the axes. Vibration
    /// above the sampling rate reaches a filter as white noise that no data sheet states.
    pub gyro_shaken: f64,
    /// White noise of the accelerometers under way, m/s/√s, likewise.
    pub accel_shaken: f64,
    /// Mean rate while quiet, rad/s: bias and Earth rate.
    pub gyro_mean: Vector3<f64>,
    /// Size of the mean specific force while quiet, m/s².
    pub force: f64,
    /// Steps in which the gyros' values come, rad/s, where these are of the noise's size; else 0.
    pub gyro_step: Vector3<f64>,
    /// Steps of the accelerometers, m/s², likewise.
    pub accel_step: Vector3<f64>,
    /// Number of stretches that were judged.
    pub stretches: usize,
}

impl NoiseFloor {
    /// The best class that the unit may belong to.
    ///
    /// White noise (the middle one of the three axes, since vibration has a direction) up to 1.4 times that of the class, and
    /// while quiet a mean rate and a size of the specific force within three of its bias sigmas, less what Earth rate and
    /// latitude may do. Whatever fits no class is [`ImuGrade::Consumer`]. A good unit on a vehicle that vibrates at
    /// all times looks like a worse one: state the class of such a unit.
    pub fn grade(&self) -> ImuGrade {
        let middle = |v: &Vector3<f64>| {
            let mut v = [v.x, v.y, v.z];
            v.sort_by(f64::total_cmp);
            v[1]
        };
        let gyro_bias = (self.gyro_mean.amax() - EARTH_RATE).max(0.0);
        let accel_bias = ((self.force - STANDARD_GRAVITY).abs() - GRAVITY_RANGE).max(0.0);
        ImuGrade::ALL
            .into_iter()
            .rev()
            .find(|grade| {
                let class = grade.noise();
                middle(&self.gyro_white) <= NOISE_MARGIN * class.gyro_white
                    && middle(&self.accel_white) <= NOISE_MARGIN * class.accel_white
                    && gyro_bias <= BIAS_MARGIN * class.gyro_bias_sigma
                    && accel_bias <= BIAS_MARGIN * class.accel_bias_sigma
            })
            .unwrap_or(ImuGrade::Consumer)
    }
}

/// Takes inertial samples one by one and tells the noise floor at the end.
///
/// The third difference of white noise of variance σ² has the variance 20 σ², and next to nothing of smooth motion. It is
/// taken of the samples and of their 50 ms means, over stretches of 2 s; the larger density counts. Gyros are judged on the
/// tenth of the stretches in which the accelerometers are quietest and the reverse, so that being chosen for little noise
/// does not make it seem less.
#[derive(Clone, Debug, Default)]
pub struct NoiseMeter {
    window: Vec<Reading>,
    /// From the window's first sample to its last, s.
    span: f64,
    stretches: Vec<Stretch>,
    previous: Option<Time>,
    steps: [Step; 6],
}

/// One sample: seconds since the sample before, rates and forces.
#[derive(Clone, Copy, Debug)]
struct Reading {
    dt: f64,
    values: [f64; 6],
}

/// One stretch: squared densities, means.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    dt: f64,
    white: [f64; 6],
    /// Squared densities between neighbouring samples alone, gyros and accelerometers, mean of the axes.
    shaken: [f64; 2],
    /// Densities of the averaged samples alone: how much is going on.
    liveliness: [f64; 2],
    gyro_mean: Vector3<f64>,
    force: f64,
}

impl NoiseMeter {
    /// Take a sample; what is not inertial is passed over, as are stamps that do not advance and values that are not finite.
    pub fn push(&mut self, sample: &Sample) {
        let time = sample.time();
        let dt = self.previous.map_or(0.0, |previous| time.since(previous));
        let (rate, force) = match sample {
            Sample::Imu(s) => (s.angular_rate_b, s.specific_force_b),
            Sample::ImuIncrement(s) if dt > 0.0 => (s.angle_b / dt, s.velocity_b / dt),
            Sample::ImuIncrement(_) => {
                self.previous = Some(time);
                return;
            }
            _ => return,
        };
        let values = [rate.x, rate.y, rate.z, force.x, force.y, force.z];
        if values.iter().any(|v| !v.is_finite()) || (self.previous.is_some() && dt <= 0.0) {
            return;
        }
        self.previous = Some(time);
        if let Some(last) = self.window.last() {
            // A hole ends the stretch unjudged.
            if self.window.len() > 1 && dt > 3.0 * last.dt {
                self.window.clear();
                self.span = 0.0;
            } else {
                self.span += dt;
                let pairs = values.iter().zip(&last.values);
                for (step, (now, before)) in self.steps.iter_mut().zip(pairs) {
                    step.push((now - before).abs());
                }
            }
        }
        self.window.push(Reading { dt, values });
        if self.span >= WINDOW && self.window.len() >= FEWEST_SAMPLES {
            self.stretches.push(Stretch::of(&self.window));
            self.window.clear();
            self.span = 0.0;
        }
    }

    /// What all samples so far show.
    ///
    /// # Errors
    /// [`Error::NotObservable`] when there are less than five stretches of 2 s without a hole.
    pub fn floor(&self) -> Result<NoiseFloor> {
        if self.stretches.len() < 5 {
            return Err(Error::NotObservable {
                what: "the IMU's noise floor",
                reason: "it needs ten seconds of samples without holes",
            });
        }
        let quiet = |by: usize| {
            let mut order: Vec<&Stretch> = self.stretches.iter().collect();
            order.sort_by(|a, b| a.liveliness[by].total_cmp(&b.liveliness[by]));
            let count = ((QUIET * order.len() as f64) as usize).max(5);
            order.truncate(count);
            order
        };
        let (still, steady) = (quiet(1), quiet(0));
        let middle = |of: &dyn Fn(&Stretch) -> f64, among: &[&Stretch]| {
            let mut values: Vec<f64> = among.iter().map(|s| of(s)).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let all: Vec<&Stretch> = self.stretches.iter().collect();
        let dt = middle(&|s| s.dt, &all);
        let step = |k: usize| self.steps[k].size();
        // A rounding of steps q adds q²/12 ([Widrow61]), and hides the noise when that is less.
        let white = |k: usize, among: &[&Stretch]| {
            let rounding = step(k).powi(2) / 12.0 * dt;
            middle(&|s| s.white[k], among).max(rounding).sqrt()
        };
        let gyro_white = Vector3::from_fn(|k, _| white(k, &still));
        let accel_white = Vector3::from_fn(|k, _| white(k + 3, &steady));
        // Finer steps than a fifth of the noise change nothing.
        let telling = |step: f64, white: f64| {
            if step > 0.2 * white / dt.sqrt() {
                step
            } else {
                0.0
            }
        };
        Ok(NoiseFloor {
            rate: 1.0 / dt,
            gyro_white,
            accel_white,
            gyro_shaken: middle(&|s| s.shaken[0], &all).sqrt(),
            accel_shaken: middle(&|s| s.shaken[1], &all).sqrt(),
            gyro_mean: Vector3::from_fn(|k, _| middle(&|s| s.gyro_mean[k], &still)),
            force: middle(&|s| s.force, &steady),
            gyro_step: Vector3::from_fn(|k, _| telling(step(k), gyro_white[k])),
            accel_step: Vector3::from_fn(|k, _| telling(step(k + 3), accel_white[k])),
            stretches: self.stretches.len(),
        })
    }
}

impl Stretch {
    fn of(window: &[Reading]) -> Self {
        let dt = window.iter().skip(1).map(|r| r.dt).sum::<f64>() / (window.len() - 1) as f64;
        let per_block = ((BLOCK / dt).round() as usize).max(1);
        let mut white = [0.0; 6];
        let mut liveliness = [0.0; 2];
        let mut shaken = [0.0; 2];
        let mut mean = [0.0; 6];
        for k in 0..6 {
            let values: Vec<f64> = window.iter().map(|r| r.values[k]).collect();
            mean[k] = values.iter().sum::<f64>() / values.len() as f64;
            let blocks: Vec<f64> = values
                .chunks_exact(per_block)
                .map(|c| c.iter().sum::<f64>() / per_block as f64)
                .collect();
            let fine = third_difference_variance(&values) * dt;
            let coarse = third_difference_variance(&blocks) * dt * per_block as f64;
            white[k] = fine.max(coarse);
            liveliness[k / 3] += coarse;
            shaken[k / 3] += fine / 3.0;
        }
        Stretch {
            dt,
            white,
            shaken,
            liveliness,
            gyro_mean: Vector3::new(mean[0], mean[1], mean[2]),
            force: Vector3::new(mean[3], mean[4], mean[5]).norm(),
        }
    }
}

/// Variance of the white noise that has these third differences.
fn third_difference_variance(values: &[f64]) -> f64 {
    let sum: f64 = values
        .windows(4)
        .map(|w| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).powi(2))
        .sum();
    sum / (20.0 * values.len().saturating_sub(3).max(1) as f64)
}

/// Finds the step in which values come: the least change there is, if all changes are its multiples.
#[derive(Clone, Debug, Default)]
struct Step {
    least: f64,
    changes: Vec<f64>,
}

impl Step {
    /// Changes that are kept for the check.
    const KEPT: usize = 4000;

    fn push(&mut self, change: f64) {
        // Less than this is the rounding of the arithmetic that brought the value here.
        if change > 1e-9 && self.changes.len() < Self::KEPT {
            self.least = if self.changes.is_empty() {
                change
            } else {
                self.least.min(change)
            };
            self.changes.push(change);
        }
    }

    /// The step; 0 when the values come in none.
    fn size(&self) -> f64 {
        if self.changes.len() < 100 {
            return 0.0;
        }
        let multiple = |c: f64| (c / self.least - (c / self.least).round()).abs() < 0.1;
        // Large multiples of an inexact step miss: look at the small ones.
        let small: Vec<f64> = self
            .changes
            .iter()
            .copied()
            .filter(|c| *c < 20.0 * self.least)
            .collect();
        let on = small.iter().filter(|c| multiple(**c)).count();
        // One in five would be by chance; and where hardly any change is small, the least one is no step.
        if on * 100 < small.len() * 97 || small.len() * 20 < self.changes.len() {
            0.0
        } else {
            self.least
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::ImuSample;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;
    use rand_pcg::rand_core::SeedableRng;

    fn floor_of(
        rate: f64,
        gyro_white: f64,
        accel_white: f64,
        step: f64,
        driving: f64,
    ) -> NoiseFloor {
        let mut rng = Pcg64::seed_from_u64(5);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let mut meter = NoiseMeter::default();
        let round = |x: f64| {
            if step > 0.0 {
                (x / step).round() * step
            } else {
                x
            }
        };
        for i in 0..(300.0 * rate) as i32 {
            let t = f64::from(i) / rate;
            // Driving for four fifths of the time: turns, brakes and, with them, vibration of ten times the noise.
            let moving = if t % 100.0 < 80.0 { driving } else { 0.0 };
            let shaking = 1.0 + 10.0 * moving;
            let mut noise = |white: f64| white * rate.sqrt() * shaking * normal();
            let turn = Vector3::new(
                0.02 * (2.0 * t).sin(),
                0.03 * (3.0 * t).cos(),
                0.4 * (0.3 * t).sin(),
            );
            let push = Vector3::new(
                2.0 * (0.2 * t).sin(),
                1.5 * (0.5 * t).cos(),
                0.3 * (4.0 * t).sin(),
            );
            let gyro = Vector3::from_fn(|_, _| round(noise(gyro_white))) + turn * moving;
            let accel = Vector3::from_fn(|_, _| noise(accel_white)) + push * moving;
            meter.push(&Sample::Imu(ImuSample {
                time: Time::from_seconds(t),
                angular_rate_b: gyro + Vector3::repeat(1e-4),
                specific_force_b: accel - Vector3::z() * 9.8,
            }));
        }
        meter.floor().expect("long enough")
    }

    #[test]
    fn white_noise_is_measured_at_any_rate() {
        for rate in [30.0, 100.0, 200.0, 400.0] {
            for driving in [0.0, 1.0] {
                let floor = floor_of(rate, 1e-4, 1e-3, 0.0, driving);
                let ratio = (floor.gyro_white / 1e-4, floor.accel_white / 1e-3);
                // The larger one of two estimates, each of 15 windows with some 40 values: high by about their 6 %.
                let near = |r: &Vector3<f64>| r.iter().all(|x| (0.9..1.25).contains(x));
                assert!(
                    near(&ratio.0) && near(&ratio.1),
                    "{rate} {driving}: {ratio:?}"
                );
                assert!((floor.rate - rate).abs() < 1e-3 * rate);
                assert!(
                    (floor.gyro_mean - Vector3::repeat(1e-4)).amax() < 1e-4,
                    "{:?}",
                    floor.gyro_mean
                );
                assert!((floor.force - 9.8).abs() < 0.01);
            }
        }
    }

    #[test]
    fn each_class_is_told_from_its_noise() {
        for grade in ImuGrade::ALL {
            let noise = grade.noise();
            let floor = floor_of(100.0, noise.gyro_white, noise.accel_white, 0.0, 1.0);
            // The bias of 1e-4 rad/s (20 °/h, of which Earth rate may be 15) rules out the best class.
            assert_eq!(floor.grade(), grade.min(ImuGrade::Tactical), "{floor:?}");
        }
    }

    #[test]
    fn a_large_bias_or_a_wrong_gravity_means_a_worse_class() {
        let noise = ImuGrade::Industrial.noise();
        let floor = floor_of(100.0, noise.gyro_white, noise.accel_white, 0.0, 0.0);
        assert_eq!(floor.grade(), ImuGrade::Industrial);
        let turned = NoiseFloor {
            gyro_mean: Vector3::new(0.0, -5e-3, 0.0),
            ..floor
        };
        assert_eq!(turned.grade(), ImuGrade::Consumer);
        let heavy = NoiseFloor {
            force: 9.98,
            ..floor
        };
        assert_eq!(heavy.grade(), ImuGrade::Automotive);
    }

    #[test]
    fn steps_are_found_and_told_only_where_they_matter() {
        let floor = floor_of(100.0, 1e-4, 1e-3, 4e-3, 0.0);
        // Noise of 1e-3 rad/s per sample, rounded to 4e-3: nearly all values are zero.
        assert!(
            floor.gyro_step.iter().all(|s| (s - 4e-3).abs() < 1e-9),
            "{floor:?}"
        );
        assert!(
            floor.gyro_white.iter().all(|w| (1e-4..2e-4).contains(w)),
            "{floor:?}"
        );
        assert_eq!(floor.accel_step, Vector3::zeros());
        assert_eq!(
            floor_of(100.0, 1e-4, 1e-3, 1e-4, 0.0).gyro_step,
            Vector3::zeros()
        );
    }

    #[test]
    fn too_little_is_an_error() {
        assert!(NoiseMeter::default().floor().is_err());
    }
}
