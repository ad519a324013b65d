//! Does the body stand? Everything that speaks for a stop or against it, in one place.

use super::{Evidence, Witness};
use crate::config::StationaryConfig;
use crate::imu::ImuNoise;
use crate::sample::Sample;
use crate::solution::Motion;
use crate::time::Time;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// What the filter believes, about half a second before the sample that the detector looks at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Belief {
    /// What the gyros would measure at rest: bias and Earth rate, body axes, rad/s.
    pub rate_b: Vector3<f64>,
    /// Covariance of that (of the gyro bias), rad²/s².
    pub rate_covariance_b: Matrix3<f64>,
    /// Velocity, NED, m/s.
    pub velocity_n: Vector3<f64>,
    /// Its covariance, m²/s².
    pub velocity_covariance_n: Matrix3<f64>,
}

/// Takes all samples in the order of time, ahead of the filter, and says whether the body stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StopDetector {
    intervals: crate::config::Intervals,
    origin: Option<Time>,
    declared: Option<Time>,
    motion: Motion,
    evidence: Evidence,
}

impl StopDetector {
    /// From the settings; `noise` is that of the inertial unit at rest where the settings do not say it.
    pub fn new(config: &StationaryConfig, _noise: &ImuNoise) -> Self {
        StopDetector {
            intervals: config.intervals_s,
            origin: None,
            declared: None,
            motion: Motion::Moving,
            evidence: Evidence::default(),
        }
    }

    /// Zero of the seconds of intervals; else the first inertial stamp.
    pub fn set_origin(&mut self, origin: Time) {
        self.origin = Some(origin);
    }

    /// Take a sample. Stamps must not run backward.
    pub fn observe(&mut self, sample: &Sample, _belief: &Belief) {
        let now = sample.time();
        if sample.is_inertial() {
            let origin = *self.origin.get_or_insert(now);
            let t = now.since(origin);
            let interval = self
                .intervals
                .as_slice()
                .iter()
                .find(|i| i[0] <= t && t <= i[1]);
            let since = self.declared.or(interval.map(|i| origin.plus(i[0])));
            self.motion = since.map_or(Motion::Moving, |since| Motion::Stationary { since });
            self.evidence.witness = match (self.declared, interval) {
                (Some(_), _) => Witness::Declared,
                (None, Some(_)) => Witness::Interval,
                (None, None) => Witness::Nobody,
            };
        }
        if let Sample::Standstill(s) = sample {
            self.declared = s.standing.then_some(self.declared.unwrap_or(now));
        }
    }

    /// Whether the body stands, after the last sample, and since when.
    pub fn motion(&self) -> Motion {
        self.motion
    }

    /// What speaks for it.
    pub fn evidence(&self) -> Evidence {
        self.evidence
    }
}
