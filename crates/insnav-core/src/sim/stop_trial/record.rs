//! The same trials with a real unit that stood still: its record in place of simulated inertial samples.

use super::setting::{StopSetting, standing};
use super::trial::StopTrial;
use crate::attitude::Euler;
use crate::earth::{Geodetic, earth_rate_n, gravity};
use crate::error::{Error, Result};
use crate::filter::InitialSigma;
use crate::imu::ImuNoise;
use crate::noise_floor::NoiseMeter;
use crate::sample::{ImuSample, Sample};
use crate::sim::{ImuErrorModel, ImuModel, ImuOutput, Scenario, Source, Stream};
use crate::time::Time;
use nalgebra::Vector3;

/// Length of the means from which the wander of the biases follows, s.
const MEAN_S: f64 = 60.0;
/// Correlation time of the biases that the filter is told, s; that of the source's unit.
const WANDER_TAU_S: f64 = 3600.0;

/// A record of a unit that stood still, calibrated by its own mean.
///
/// The means of the whole record are what the unit would show at rest, by definition: roll and pitch are those of the mean
/// force, and what is left of the mean rate and of the size of the force is taken out, as a calibration before the experiment
/// would. The heading is drawn; the Earth's rate belongs to it.
#[derive(Clone, Debug)]
pub struct StaticRecord {
    samples: Vec<ImuSample>,
    mean_rate_b: Vector3<f64>,
    mean_force_b: Vector3<f64>,
    noise: ImuNoise,
    /// Scatter of the biases about the record's means: of rate, rad/s, and of force, m/s².
    scatter: [f64; 2],
}

impl StaticRecord {
    /// How many stops of a setting fit into the record without a common sample: so many of any number of trials are independent
    /// as far as the unit is concerned.
    pub fn independent_trials(&self, setting: &StopSetting) -> usize {
        (self.duration() / setting.stop_s) as usize
    }

    /// Of inertial samples in the order of time; others are passed over.
    ///
    /// # Errors
    /// `NotObservable` for a record without three means of a minute, one that is not of rates, one whose stamps leap, or one that
    /// turned.
    pub fn new(samples: impl IntoIterator<Item = Sample>) -> Result<Self> {
        let refuse = |reason| Error::NotObservable {
            what: "the errors of a unit at rest",
            reason,
        };
        let mut meter = NoiseMeter::default();
        let samples: Vec<Sample> = samples.into_iter().collect();
        if Self::leap(&samples).is_some() {
            return Err(refuse(
                "its stamps leap by more than 5 s or run backward: it is not one record",
            ));
        }
        if Self::turning(&samples).is_some() {
            return Err(refuse(
                "its mean rate changed by more than 0.1 °/s within 10 s: the unit did not stand still",
            ));
        }
        let mut record = Vec::new();
        for sample in samples {
            meter.push(&sample);
            match sample {
                Sample::Imu(s) => record.push(s),
                Sample::ImuIncrement(_) => {
                    return Err(refuse("it needs rates and forces, not their increments"));
                }
                _ => {}
            }
        }
        let floor = meter.floor()?;
        let count = record.len() as f64;
        let mean = |of: fn(&ImuSample) -> Vector3<f64>| {
            record.iter().map(of).sum::<Vector3<f64>>() / count
        };
        let mean_rate_b = mean(|s| s.angular_rate_b);
        let mean_force_b = mean(|s| s.specific_force_b);
        let rates = minutes(&record, |s| s.angular_rate_b);
        let forces = minutes(&record, |s| s.specific_force_b);
        if rates.len() < 3 {
            return Err(refuse("it needs three minutes of samples"));
        }
        let size = |v: &Vector3<f64>| (v.norm_squared() / 3.0).sqrt();
        let (gyro_white, accel_white) = (size(&floor.gyro_white), size(&floor.accel_white));
        let gyro = Wander::of(&rates, &mean_rate_b, gyro_white);
        let accel = Wander::of(&forces, &mean_force_b, accel_white);
        // A turn by a degree is no wander of an accelerometer.
        if accel.scatter > 0.2 {
            return Err(refuse(
                "its force turned by more than a degree: the unit did not stand still",
            ));
        }
        Ok(StaticRecord {
            samples: record,
            mean_rate_b,
            mean_force_b,
            noise: ImuNoise {
                gyro_white,
                accel_white,
                gyro_bias_sigma: gyro.steady,
                accel_bias_sigma: accel.steady,
                gyro_bias_tau: WANDER_TAU_S,
                accel_bias_tau: WANDER_TAU_S,
            },
            scatter: [gyro.scatter, accel.scatter],
        })
    }

    /// Length, s.
    pub fn duration(&self) -> f64 {
        match (self.samples.first(), self.samples.last()) {
            (Some(first), Some(last)) => last.time.since(first.time),
            _ => 0.0,
        }
    }

    /// Noise of the unit as the record shows it: what the filter is told.
    pub fn noise(&self) -> &ImuNoise {
        &self.noise
    }

    /// The start's sigmas: those of the source, but for the biases, which scatter as in the record.
    pub fn sigma(&self) -> InitialSigma {
        InitialSigma {
            gyro_bias: Vector3::repeat(self.scatter[0]),
            accel_bias: Vector3::repeat(self.scatter[1]),
            ..StopSetting::sigma()
        }
    }

    /// Trial `run` of `runs`, which begin at evenly spaced instants of the record and overlap where it is short; receiver and
    /// start are drawn anew for each.
    ///
    /// # Errors
    /// `NotObservable` when the record is shorter than a stop of the setting, which must have no drives.
    pub fn trial(
        &self,
        setting: &StopSetting,
        run: usize,
        runs: usize,
        seed: u64,
    ) -> Result<StopTrial> {
        if self.duration() < setting.stop_s || setting.drives > 0 {
            return Err(Error::NotObservable {
                what: "the errors over the stop",
                reason: "the record is shorter than the stop",
            });
        }
        let share = if runs > 1 {
            run as f64 / (runs - 1) as f64
        } else {
            0.0
        };
        let first = self.samples[0].time;
        let from = first.plus((self.duration() - setting.stop_s) * share);
        let begin = self.samples.partition_point(|s| s.time < from);
        let begin_time = self.samples[begin].time;

        let heading_deg = Source::new(seed, Stream::Route).between(0.0, 360.0);
        let f = -self.mean_force_b;
        let level = Euler {
            roll: f.y.atan2(f.z),
            pitch: (-f.x).atan2(f.y.hypot(f.z)),
            heading: heading_deg.to_radians(),
        };
        let tilt_deg = [level.roll.to_degrees(), level.pitch.to_degrees()];
        let still = |scaled| Scenario {
            duration_s: setting.stop_s,
            drive: setting.drive(heading_deg, tilt_deg, vec![standing(setting.stop_s)]),
            imu: ImuModel {
                rate_hz: 1.0,
                output: ImuOutput::Rates,
                errors: ImuErrorModel::default(),
            },
            gnss: StopSetting::receiver(scaled),
        };
        let mut simulation = still(true).simulate(seed)?;
        let zero = simulation.trajectory.start();
        let at = simulation.trajectory.after(0.0).nav;
        let moved = |s: &ImuSample| {
            self.at_rest(s, zero.plus(s.time.since(begin_time)), &at.position, &level)
        };
        let inertial = self.samples[begin..]
            .iter()
            .map(moved)
            .take_while(|s| s.time.since(zero) <= setting.stop_s + 1e-6);
        simulation.samples.retain(|s| !s.is_inertial());
        simulation.samples.extend(inertial.map(Sample::Imu));
        Ok(StopTrial::new(
            simulation,
            still(false).simulate(seed)?.samples,
            setting.stops(),
            self.sigma(),
            self.noise,
            seed,
        ))
    }

    /// A sample with the record's mean replaced by what a body at rest would show.
    fn at_rest(&self, s: &ImuSample, time: Time, at: &Geodetic, level: &Euler) -> ImuSample {
        let q_bn = level.to_quaternion().inverse();
        let rate_b = q_bn * earth_rate_n(at.latitude);
        let force_b = q_bn * Vector3::new(0.0, 0.0, -gravity(at));
        ImuSample {
            time,
            angular_rate_b: s.angular_rate_b - self.mean_rate_b + rate_b,
            specific_force_b: s.specific_force_b - self.mean_force_b + force_b,
        }
    }
}

/// Means over whole minutes, of a record without leaps.
fn minutes(record: &[ImuSample], of: fn(&ImuSample) -> Vector3<f64>) -> Vec<Vector3<f64>> {
    let Some(first) = record.first() else {
        return Vec::new();
    };
    let mut sums: Vec<(Vector3<f64>, f64)> = Vec::new();
    for s in record {
        let minute = (s.time.since(first.time) / MEAN_S) as usize;
        if minute >= sums.len() {
            sums.push((Vector3::zeros(), 0.0));
        }
        if let Some(last) = sums.last_mut() {
            last.0 += of(s);
            last.1 += 1.0;
        }
    }
    // The last one is not whole.
    sums.pop();
    sums.iter().map(|s| s.0 / s.1).collect()
}

/// How a bias wanders.
struct Wander {
    /// About the mean.
    scatter: f64,
    /// Steady sigma of the Gauss–Markov process that wanders as much from minute to minute.
    steady: f64,
}

impl Wander {
    /// From means of a minute. Their white noise has the variance N²/T. Differences of neighbouring means of a random walk of
    /// density q have ⅔ q T, and a Gauss–Markov process begins as one of 2σ²/τ. What the white noise hides is taken as a
    /// tenth of it, as no bias is constant.
    fn of(means: &[Vector3<f64>], mean: &Vector3<f64>, white: f64) -> Self {
        let noise = white * white / MEAN_S;
        let count = means.len() as f64;
        let about: f64 =
            means.iter().map(|m| (m - mean).norm_squared()).sum::<f64>() / (3.0 * count);
        let steps: f64 = means
            .windows(2)
            .map(|w| (w[1] - w[0]).norm_squared())
            .sum::<f64>()
            / (3.0 * (count - 1.0));
        let density = 1.5 * (steps - 2.0 * noise).max(0.2 * noise) / MEAN_S;
        Wander {
            scatter: (about - noise).max(0.1 * noise).sqrt(),
            steady: (density * WANDER_TAU_S / 2.0).sqrt(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten minutes of a unit with known noise and biases, standing with roll 3° and pitch −4°.
    fn simulated(seed: u64) -> Vec<Sample> {
        let noise = StopSetting::noise();
        let mut scenario = Scenario {
            duration_s: 3600.0,
            drive: StopSetting::paper().drive(77.0, [3.0, -4.0], vec![standing(3600.0)]),
            imu: ImuModel {
                rate_hz: 20.0,
                output: ImuOutput::Rates,
                errors: ImuErrorModel::from_noise(noise),
            },
            gnss: StopSetting::receiver(true),
        };
        scenario.imu.errors.accel_bias_m_per_s2 = [0.05, -0.05, 0.1];
        scenario.simulate(seed).expect("valid").samples
    }

    #[test]
    fn noise_is_found_again_and_the_mean_is_the_truth() {
        let record = StaticRecord::new(simulated(5)).expect("an hour at rest");
        let (found, told) = (record.noise(), StopSetting::noise());
        // 20 stretches of 2 s for the quietest tenth leave 10 %.
        assert!((found.gyro_white / told.gyro_white - 1.0).abs() < 0.3);
        assert!((found.accel_white / told.accel_white - 1.0).abs() < 0.3);
        // 59 steps a minute long on three axes leave 8 % of the density's root, beside the white noise that is taken out.
        assert!((found.gyro_bias_sigma / told.gyro_bias_sigma - 1.0).abs() < 0.5);
        let trial = record
            .trial(&StopSetting::paper(), 2, 5, 1)
            .expect("long enough");
        let truth = trial.simulation.truth_at(Time(0)).nav.q_nb;
        let (roll, pitch, _) = truth.euler_angles();
        // The accelerometers' own biases turn what they call level, by 0.1 m/s² at most.
        assert!((roll.to_degrees() - 3.0).abs() < 0.7 && (pitch.to_degrees() + 4.0).abs() < 0.7);
    }

    #[test]
    fn a_record_that_is_short_or_turned_is_refused() {
        let samples = simulated(6);
        let short: Vec<Sample> = samples.iter().take(20 * 100).copied().collect();
        assert!(StaticRecord::new(short).is_err());
        let turned = samples.iter().enumerate().map(|(i, s)| match s {
            Sample::Imu(s) if i > 30_000 => Sample::Imu(ImuSample {
                specific_force_b: s.specific_force_b + Vector3::new(0.9, 0.0, 0.0),
                ..*s
            }),
            other => *other,
        });
        let error = StaticRecord::new(turned).unwrap_err().to_string();
        assert!(error.contains("stand still"), "{error}");
        assert_eq!(StaticRecord::turning(&samples), None);
        // A slow turn on a level floor, which no force shows.
        let first = samples.iter().find(|s| s.is_inertial());
        let begin = first.expect("inertial samples").time().plus(1200.0);
        let turned = samples.iter().map(|s| match s {
            Sample::Imu(s) if s.time >= begin => Sample::Imu(ImuSample {
                angular_rate_b: s.angular_rate_b + Vector3::new(0.0, 0.0, 0.3f64.to_radians()),
                ..*s
            }),
            other => *other,
        });
        let turned: Vec<Sample> = turned.collect();
        let turn = StaticRecord::turning(&turned).expect("it turned");
        assert!(
            turn.after_s == 1200.0 && (turn.rate_change.to_degrees() - 0.3).abs() < 0.05,
            "{turn:?}"
        );
        assert!(StaticRecord::new(turned).is_err());
        let record = StaticRecord::new(samples).expect("an hour at rest");
        let long = StopSetting {
            stop_s: 4000.0,
            ..StopSetting::paper()
        };
        assert!(record.trial(&long, 0, 1, 1).is_err());
    }

    /// One stamp years ahead, one that runs backward: neither is one record, and neither costs memory.
    #[test]
    fn stamps_that_leap_are_refused() {
        let samples = simulated(7);
        assert_eq!(StaticRecord::leap(&samples), None);
        for (by, at) in [(3e8, 30_000), (-2.0, 30_000), (5.1, 100)] {
            let mut wild = samples.clone();
            let mut inertial = wild.iter_mut().filter(|s| s.is_inertial());
            let Some(Sample::Imu(s)) = inertial.nth(at) else {
                panic!("rates");
            };
            s.time = s.time.plus(by);
            let leap = StaticRecord::leap(&wild).expect("it leaps");
            assert!((leap.by_s - by - 0.05).abs() < 1e-6, "{leap:?}");
            assert!(
                (leap.after_s - (at as f64 - 1.0) * 0.05).abs() < 1e-6,
                "{leap:?}"
            );
            let error = StaticRecord::new(wild).unwrap_err().to_string();
            assert!(error.contains("leap"), "{error}");
        }
    }

    /// An hour has room for twelve stops of five minutes, whatever is asked of it.
    #[test]
    fn slices_that_share_samples_are_not_independent() {
        let record = StaticRecord::new(simulated(8)).expect("an hour at rest");
        assert!((11..=12).contains(&record.independent_trials(&StopSetting::paper())));
    }
}
