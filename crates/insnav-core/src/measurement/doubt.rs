//! Measurements that the gate refuses, taken together: who is wrong, they or the filter?

use crate::time::Time;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Votes needed: bursts of multipath and of bad fixes are shorter.
const VOTES: u32 = 10;
/// Time over which they must have come, s: ten fixes of a fast receiver are one and the same.
const LEAST_TIME: f64 = 3.0;
/// An accepted measurement takes back so many votes, so that refused ones must be more than two in three.
const TAKEN_BACK: u32 = 2;
/// From this many on the sigma of the solution covers what they say.
const DOUBTFUL: u32 = 2;
/// They agree when their common offset exceeds their scatter by this factor. The mean of ten residuals without a common offset
/// has √0.1 of their scatter.
const AGREEMENT: f64 = 2.0;

/// What the refused ones say, once there are enough.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Vote {
    /// The same place, which is not where the filter is: it has lost its way, or the measurements have moved for good.
    FilterIsOff {
        /// How fast their residuals move, units per second: a velocity error, for positions.
        drift: Vector3<f64>,
    },
    /// One place each: they scatter by more than they state.
    TheyScatter {
        /// Variances about their common line.
        scatter: Vector3<f64>,
    },
}

/// A run of refused measurements: a straight line through their residuals, and what they scatter about it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Doubt {
    votes: u32,
    begin: Option<Time>,
    n: f64,
    t: f64,
    tt: f64,
    r: Vector3<f64>,
    tr: Vector3<f64>,
    rr: Vector3<f64>,
    last: Vector3<f64>,
}

impl Doubt {
    /// A measurement was accepted.
    pub fn accepted(&mut self) {
        self.votes = self.votes.saturating_sub(TAKEN_BACK);
        if self.votes == 0 {
            *self = Doubt::default();
        }
    }

    /// A measurement was refused; a vote when there are enough of them.
    pub fn refused(&mut self, time: Time, residual: &Vector3<f64>) -> Option<Vote> {
        let t = time.since(*self.begin.get_or_insert(time));
        self.votes = self.votes.saturating_add(1);
        self.n += 1.0;
        self.t += t;
        self.tt += t * t;
        self.r += residual;
        self.tr += residual * t;
        self.rr += residual.component_mul(residual);
        self.last = *residual;
        (self.votes >= VOTES && t >= LEAST_TIME).then(|| self.vote())
    }

    /// Begin anew.
    pub fn settle(&mut self) {
        *self = Doubt::default();
    }

    /// What the solution may be off by while nobody knows: the last refused residual as a covariance.
    pub fn covariance(&self) -> Matrix3<f64> {
        if self.votes < DOUBTFUL {
            return Matrix3::zeros();
        }
        self.last * self.last.transpose()
    }

    fn vote(&self) -> Vote {
        let (mean, mean_t) = (self.r / self.n, self.t / self.n);
        let spread_t = self.tt / self.n - mean_t * mean_t;
        let covariance = self.tr / self.n - mean * mean_t;
        let drift = covariance / spread_t.max(1e-6);
        let variance = self.rr / self.n - mean.component_mul(&mean);
        let about_line = variance - drift.component_mul(&covariance);
        // A line through n points takes two of their degrees of freedom.
        let scatter = about_line.map(|v| v.max(0.0)) * (self.n / (self.n - 2.0).max(1.0));
        if mean.norm_squared() > AGREEMENT * AGREEMENT * scatter.sum() {
            Vote::FilterIsOff { drift }
        } else {
            Vote::TheyScatter { scatter }
        }
    }
}
