//! Gyros whose values come in steps coarser than their noise.
//!
//! At rest most of their samples are equal, and their mean is not the bias: a rate below half a step may show as none at all.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Less than this is the rounding of the arithmetic that brought the value here, rad/s.
const ROUNDING: f64 = 1e-8;
/// Changes that must be seen before a step is believed.
const FEWEST_CHANGES: u32 = 20;
/// Pairs of samples after which the older half is forgotten.
const REMEMBERED: u32 = 4000;

/// Finds the steps of three gyros, sample by sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GyroSteps {
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
}

impl Axis {
    fn push(&mut self, change: f64) {
        self.pairs += 1;
        if change < ROUNDING {
            self.equal += 1;
        } else if self.least == 0.0 || change < 0.9 * self.least {
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
        // One in five would be by chance.
        let in_steps = self.tested >= FEWEST_CHANGES && self.multiples * 100 >= self.tested * 97;
        let still = self.pairs >= 200 && self.equal * 2 > self.pairs;
        self.coarse = in_steps && (self.coarse || still);
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
}

impl GyroSteps {
    /// Take a rate, rad/s.
    pub fn push(&mut self, rate: &Vector3<f64>) {
        if let Some(last) = self.last.replace(*rate) {
            for (axis, (now, before)) in self.axes.iter_mut().zip(rate.iter().zip(last.iter())) {
                axis.push((now - before).abs());
            }
        }
    }

    /// The steps, rad/s; 0 where values are finer than their noise.
    pub fn steps(&self) -> Vector3<f64> {
        Vector3::from_fn(|k, _| {
            let axis = &self.axes[k];
            if axis.coarse { axis.least } else { 0.0 }
        })
    }
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::*;
    use crate::sim::{Source, Stream};

    /// Noise in units of the step, then rest and driving.
    fn seen(step: f64, sigma: f64, turning: f64) -> Vector3<f64> {
        let mut source = Source::new(5, Stream::GyroWhite);
        let mut steps = GyroSteps::default();
        for i in 0..6000 {
            let moving = if i < 2000 { 0.0 } else { turning };
            let swing = (0.013 * f64::from(i)).sin() * moving;
            let rate = source.normal3() * sigma + Vector3::new(0.001, -0.0005, 0.002 + swing);
            let rounded = if step > 0.0 {
                rate.map(|r| (r / step).round() * step)
            } else {
                rate
            };
            steps.push(&rounded);
        }
        steps.steps()
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

    /// A unit read twice as often as it measures: every second sample repeats, its values are continuous.
    #[test]
    fn repeated_samples_are_not_steps() {
        let mut source = Source::new(6, Stream::GyroWhite);
        let mut steps = GyroSteps::default();
        for _ in 0..3000 {
            let rate = source.normal3() * 0.01;
            for _ in 0..3 {
                steps.push(&rate);
            }
        }
        assert_eq!(steps.steps(), Vector3::zeros());
    }
}
