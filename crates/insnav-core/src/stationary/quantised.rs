//! Gyros whose values come in steps coarser than their noise.
//!
//! At rest most of their samples are equal, and their mean is not the bias: a rate below half a step may show as none at all.
//! A gyro that repeats one value shows no step either. That is no proof of a bias but of the contrary: white noise never
//! repeats itself for half a second.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Less than this is the rounding of the arithmetic that brought the value here, rad/s.
const ROUNDING: f64 = 1e-8;
/// Changes that must be seen before a step is believed.
const FEWEST_CHANGES: u32 = 20;
/// Pairs of samples after which the older half is forgotten.
const REMEMBERED: u32 = 4000;
/// One value over so long, s, and so many pairs of samples, is no noise: a unit that is read thrice as often as it measures
/// repeats itself for less.
const REPEATED: f64 = 0.5;
const FEWEST_EQUAL: u32 = 10;
/// So many changes without such a repetition between them, and it is over. Where nine of ten samples are equal, 100 a second,
/// one change in two hundred is followed by one; there the step itself is known by then.
const ALIVE: u32 = 50;
/// Pairs of samples after which a doubt is raised where most were equal.
const FEWEST_PAIRS: u32 = 20;

/// What rounding does to the means of three gyros at rest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rounding {
    /// Steps, rad/s, of gyros whose values come in steps coarser than their noise; else 0. That of a gyro which repeats one
    /// value is the others'.
    pub step: Vector3<f64>,
    /// Whether a gyro repeats one value.
    pub repeats: [bool; 3],
    /// Standard deviation of what a mean at rest is off by, however long it is taken, rad/s.
    pub sigma: Vector3<f64>,
}

/// Finds the steps of three gyros, sample by sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GyroSteps {
    /// Standard deviation of a bias of which nothing is known, rad/s.
    unknown: f64,
    last: Option<Vector3<f64>>,
    axes: [Axis; 3],
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Axis {
    /// The least change so far; 0 before any.
    least: f64,
    pairs: u32,
    equal: u32,
    /// Small changes since the least one is known, and how many of them are multiples of it.
    tested: u32,
    multiples: u32,
    /// Once most samples were equal the steps stay coarse, whatever the body does.
    coarse: bool,
    /// Time, s, and pairs of samples since the last change.
    same_for: f64,
    same: u32,
    repeats: bool,
    /// Changes since one value was repeated for long, and since the begin.
    changes: u32,
    all_changes: u32,
}

impl Axis {
    fn push(&mut self, dt: f64, change: f64) {
        self.pairs += 1;
        if change < ROUNDING {
            self.equal += 1;
            self.same += 1;
            self.same_for += dt;
        } else {
            (self.same, self.same_for) = (0, 0.0);
            self.changes = self.changes.saturating_add(1);
            self.all_changes = self.all_changes.saturating_add(1);
            self.count(change);
        }
        if self.same_for >= REPEATED && self.same >= FEWEST_EQUAL {
            self.repeats = true;
            self.changes = 0;
        } else if self.changes >= ALIVE {
            self.repeats = false;
        }
        let still = self.pairs >= 200 && self.is_mostly_equal();
        self.coarse = self.is_in_steps() && (self.coarse || still || self.repeats);
        if self.pairs >= REMEMBERED {
            self.pairs /= 2;
            self.equal /= 2;
            // Never below what a verdict needs.
            if self.tested >= 2 * FEWEST_CHANGES {
                self.tested /= 2;
                self.multiples /= 2;
            }
        }
    }

    fn count(&mut self, change: f64) {
        if self.least == 0.0 || change < 0.9 * self.least {
            // What was tested against another least change says nothing.
            (self.least, self.tested, self.multiples) = (change, 0, 0);
            self.coarse = false;
        } else if change < 20.0 * self.least {
            // Large multiples of an inexact step miss.
            let times = change / self.least;
            self.tested += 1;
            let off = times - (times + 0.5) as u32 as f64;
            self.multiples += u32::from(off.abs() < 0.1);
        }
    }

    /// One in five would be by chance.
    fn is_in_steps(&self) -> bool {
        self.tested >= FEWEST_CHANGES && self.multiples * 100 >= self.tested * 97
    }

    fn is_mostly_equal(&self) -> bool {
        self.equal * 2 > self.pairs
    }

    /// Whether most samples are equal and too few were not to say why.
    fn is_doubtful(&self) -> bool {
        self.pairs >= FEWEST_PAIRS && self.is_mostly_equal() && self.all_changes <= FEWEST_CHANGES
    }
}

impl GyroSteps {
    /// With the standard deviation of a bias of which nothing is known, rad/s.
    pub fn new(unknown: f64) -> Self {
        GyroSteps {
            unknown,
            ..GyroSteps::default()
        }
    }

    /// Take a rate, rad/s, `dt` seconds after the last.
    pub fn push(&mut self, dt: f64, rate: &Vector3<f64>) {
        if let Some(last) = self.last.replace(*rate) {
            for (axis, (now, before)) in self.axes.iter_mut().zip(rate.iter().zip(last.iter())) {
                axis.push(dt, (now - before).abs());
            }
        }
    }

    /// What is known of the rounding so far.
    pub fn rounding(&self) -> Rounding {
        let steps = |axis: &Axis| if axis.is_in_steps() { axis.least } else { 0.0 };
        let of_others = self.axes.iter().map(steps).fold(0.0, f64::max);
        let mut rounding = Rounding::default();
        for (k, axis) in self.axes.iter().enumerate() {
            rounding.repeats[k] = axis.repeats;
            if axis.coarse {
                rounding.step[k] = axis.least;
            } else if axis.repeats {
                rounding.step[k] = of_others;
            }
            rounding.sigma[k] = if rounding.step[k] > 0.0 {
                // Uniform over a step.
                rounding.step[k] / TWELVE_ROOT
            } else if axis.repeats || axis.is_doubtful() {
                self.unknown
            } else {
                0.0
            };
        }
        rounding
    }
}

/// √12.
const TWELVE_ROOT: f64 = 3.464_101_615_137_754_6;

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::*;
    use crate::sim::{Source, Stream};

    /// 500 °/h.
    const UNKNOWN: f64 = 2.4e-3;

    /// Noise in units of the step, then rest and driving.
    fn seen(step: f64, sigma: f64, turning: f64) -> Vector3<f64> {
        let mut source = Source::new(5, Stream::GyroWhite);
        let mut steps = GyroSteps::new(UNKNOWN);
        for i in 0..6000 {
            let moving = if i < 2000 { 0.0 } else { turning };
            let swing = (0.013 * f64::from(i)).sin() * moving;
            let rate = source.normal3() * sigma + Vector3::new(0.001, -0.0005, 0.002 + swing);
            let rounded = if step > 0.0 {
                rate.map(|r| (r / step).round() * step)
            } else {
                rate
            };
            steps.push(0.01, &rounded);
        }
        steps.rounding().step
    }

    #[test]
    fn steps_coarser_than_the_noise_are_found() {
        // Zero in nine of ten samples: 1.64 sigma in half a step.
        for step in [0.01, 8.7e-4] {
            let found = seen(step, 0.5 * step / 1.7, 0.0);
            assert!((found - Vector3::repeat(step)).amax() < 1e-9, "{found}");
            // And kept while driving, when hardly two samples are equal.
            let found = seen(step, 0.5 * step / 1.7, 0.5);
            assert!((found - Vector3::repeat(step)).amax() < 1e-9, "{found}");
        }
    }

    #[test]
    fn fine_steps_continuous_values_and_a_dead_gyro_have_none() {
        assert_eq!(seen(0.01, 0.05, 0.2), Vector3::zeros());
        assert_eq!(seen(0.0, 0.01, 0.0), Vector3::zeros());
        assert_eq!(seen(0.01, 0.0, 0.0), Vector3::zeros());
    }

    /// A unit read thrice as often as it measures: most samples repeat, the values are continuous.
    #[test]
    fn repeated_samples_are_not_steps() {
        let mut source = Source::new(6, Stream::GyroWhite);
        let mut steps = GyroSteps::new(UNKNOWN);
        for _ in 0..3000 {
            let rate = source.normal3() * 0.01;
            for _ in 0..3 {
                steps.push(0.01, &rate);
            }
        }
        assert_eq!(steps.rounding(), Rounding::default());
    }

    /// X repeats zero, y is in steps, z is continuous.
    #[test]
    fn one_value_has_the_step_of_the_others_or_none_that_is_known() {
        let mut source = Source::new(7, Stream::GyroWhite);
        let (mut alone, mut beside) = (GyroSteps::new(UNKNOWN), GyroSteps::new(UNKNOWN));
        for i in 0..1000 {
            let noise = source.normal3() * 3e-3;
            let stepped = (noise.y / 0.01).round() * 0.01;
            alone.push(0.01, &Vector3::new(0.0, noise.x, noise.z));
            beside.push(0.01, &Vector3::new(0.0, stepped, noise.z));
            let told = alone.rounding();
            // Half a second of one value is enough, and a fifth of one raises a doubt.
            assert_eq!(told.repeats, [i >= 50, false, false], "{i}");
            assert_eq!(told.sigma.x > 0.0, i >= 20, "{i}");
        }
        let told = alone.rounding();
        assert_eq!(told.step, Vector3::zeros());
        assert_eq!(told.sigma, Vector3::new(UNKNOWN, 0.0, 0.0));
        let told = beside.rounding();
        assert!((told.step - Vector3::new(0.01, 0.01, 0.0)).amax() < 1e-9);
        assert!((told.sigma.x - 0.01 / 12.0_f64.sqrt()).abs() < 1e-9);
        assert_eq!(told.repeats, [true, false, false]);
        // And it is over when it comes alive.
        for _ in 0..=ALIVE {
            alone.push(0.01, &(source.normal3() * 3e-3));
        }
        assert_eq!(alone.rounding(), Rounding::default());
    }

    /// A driver that hangs: noise, then one of its values for ever. That value is no mean.
    #[test]
    fn a_value_that_hangs_is_no_mean() {
        let mut source = Source::new(8, Stream::GyroWhite);
        let mut steps = GyroSteps::new(UNKNOWN);
        let mut rate = Vector3::zeros();
        for i in 0..600 {
            if i < 500 {
                rate = source.normal3() * 3e-3;
            }
            steps.push(0.01, &rate);
        }
        assert_eq!(steps.rounding().sigma, Vector3::repeat(UNKNOWN));
    }

    /// Steps that motion has shown are known at rest, also where one value repeats from the begin of the stop on.
    #[test]
    fn steps_seen_under_way_are_those_at_rest() {
        let mut steps = GyroSteps::new(UNKNOWN);
        for i in 0..2000 {
            let swing = if i < 1500 {
                0.05 * (0.05 * f64::from(i)).sin()
            } else {
                0.0
            };
            let rate = Vector3::repeat(swing) + Vector3::new(0.001, 0.004, -0.003);
            steps.push(0.01, &rate.map(|r| (r / 0.01).round() * 0.01));
        }
        let told = steps.rounding();
        assert!(
            (told.step - Vector3::repeat(0.01)).amax() < 1e-9,
            "{told:?}"
        );
    }
}
