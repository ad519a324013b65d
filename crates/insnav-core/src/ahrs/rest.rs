//! Whether the body rests, by the scatter of its own samples about a mean of half a second.

use super::settings::RestSettings;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Time constant of mean and scatter, s.
const MEAN: f64 = 0.5;

/// Mean and scatter of rate and force, and for how long they have been those of rest.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Rest {
    rate: Running,
    force: Running,
    quiet_for: f64,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Running {
    mean: Vector3<f64>,
    variance: Vector3<f64>,
    begun: bool,
}

impl Running {
    fn push(&mut self, value: &Vector3<f64>, weight: f64) -> Vector3<f64> {
        if !self.begun {
            (self.begun, self.mean) = (true, *value);
        }
        self.mean += (value - self.mean) * weight;
        let off = value - self.mean;
        self.variance += (off.component_mul(&off) - self.variance) * weight;
        off
    }
}

impl Rest {
    /// Takes a sample; `bias` is the gyro bias that is known, `white` the white noise of gyro and accelerometer at a sample.
    pub(super) fn push(
        &mut self,
        (rate, force, interval): (&Vector3<f64>, &Vector3<f64>, f64),
        bias: &Vector3<f64>,
        (gyro_white, accel_white): (f64, f64),
        settings: &RestSettings,
    ) {
        let weight = (interval / MEAN).min(1.0);
        let rate_off = self.rate.push(rate, weight);
        self.force.push(force, weight);
        // A unit whose own noise is more than the limit would never rest.
        let gyro_limit = settings.gyro_scatter.max(3.0 * gyro_white);
        let accel_limit = settings.accel_scatter.max(3.0 * accel_white);
        let quiet = self.rate.variance.max() < gyro_limit * gyro_limit
            && self.force.variance.max() < accel_limit * accel_limit
            && (self.rate.mean - bias).norm() < settings.rate_limit
            && rate_off.norm() < 3.0 * gyro_limit;
        self.quiet_for = if quiet {
            self.quiet_for + interval
        } else {
            0.0
        };
    }

    pub(super) fn rests(&self, settings: &RestSettings) -> bool {
        self.quiet_for > settings.duration
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rests_after(samples: impl Iterator<Item = (Vector3<f64>, Vector3<f64>)>) -> bool {
        let (mut rest, settings) = (Rest::default(), RestSettings::default());
        for (rate, force) in samples {
            let sample = (&rate, &force, 0.01);
            rest.push(sample, &Vector3::zeros(), (0.0, 0.0), &settings);
        }
        rest.rests(&settings)
    }

    #[test]
    fn quiet_rests_and_turning_or_shaking_does_not() {
        let still = Vector3::new(0.0, 0.0, -9.81);
        let n = 0..300;
        assert!(rests_after(
            n.clone().map(|_| (Vector3::new(0.01, 0.0, 0.0), still))
        ));
        assert!(!rests_after(
            n.clone().map(|_| (Vector3::new(0.1, 0.0, 0.0), still))
        ));
        let shake = |i: i32| Vector3::new(if i % 2 == 0 { 0.5 } else { -0.5 }, 0.0, 0.0);
        assert!(!rests_after(
            n.map(|i| (Vector3::zeros(), still + shake(i)))
        ));
        // Not yet.
        assert!(!rests_after((0..100).map(|_| (Vector3::zeros(), still))));
    }
}
