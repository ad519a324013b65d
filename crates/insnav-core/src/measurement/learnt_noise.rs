//! How large a receiver's errors are by what they do to the residuals, against what it states.

use crate::time::Time;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// A judgement is made of so many measurements at least …
const WINDOW: u32 = 30;
/// … over so long, s: residuals closer than the receiver's own correlation time repeat each other.
const WINDOW_S: f64 = 5.0;
/// Share of what a window finds that is taken: together a memory of about a hundred measurements.
const SLOW: f64 = 0.3;
/// Beyond this ratio of variances a window is believed in full: thirty measurements of the right size never show it.
const OBVIOUS: f64 = 4.0;
/// The most that one window may change a variance by.
const MOST_PER_WINDOW: f64 = 10.0;
/// Squared residuals count up to so many variances, three sigmas: tails are heavier than normal ones.
const MOST_OF_ONE: f64 = 9.0;
/// Where less than this share of S is the receiver's, its residuals tell of the prediction and not of it.
const LEAST_SHARE: f64 = 0.15;
/// Stated sigmas are believed as they stand until they are off by this factor …
const TOLERATED: f64 = 1.5;
/// … and again when the factor has come back to this.
const FORGIVEN: f64 = 1.25;
/// Factors beyond these are other faults than a wrong sigma: a repeated fix, a position of another place.
const BOUNDS: (f64, f64) = (1e-3, 1e3);

/// What one residual says, axis by axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evidence {
    /// Measured minus predicted, NED.
    pub residual: Vector3<f64>,
    /// Variance of the prediction, the diagonal of H P Hᵀ.
    pub predicted: Vector3<f64>,
    /// Variance of the measurement as stated, no better than the floor.
    pub stated: Vector3<f64>,
}

/// Factors on stated sigmas, horizontal and vertical, learnt slowly from the residuals of accepted measurements.
///
/// A residual has the variance S = H P Hᵀ + k² R: k is what makes the mean of r²/S one (innovation-based adaptive estimation,
/// \[Mehra70\], reduced to one number by axis). Only accepted measurements teach, so outliers do not; since the accepted ones
/// of a receiver that understates its errors fill the gate evenly, they still show more than one. When everything is refused,
/// [`LearntNoise::raise`] gives the scatter of what was refused.
///
/// Residuals do not see errors that stay: the filter follows them. A factor below one is therefore what the *fast* part of the
/// error is, and [`LearntNoise::unseen`] keeps the rest of what the receiver states for the sigma of the solution.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearntNoise {
    /// Least factor: 1 where only understatement is to be mended.
    least: f64,
    axes: [Axis; 2],
    begin: Option<Time>,
}

/// Horizontal or vertical.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Axis {
    /// Variance ratio as learnt.
    ratio: f64,
    /// Factor on sigmas as used.
    used: f64,
    count: u32,
    sum: f64,
    share: f64,
}

impl Default for LearntNoise {
    fn default() -> Self {
        let axis = Axis {
            ratio: 1.0,
            used: 1.0,
            count: 0,
            sum: 0.0,
            share: 0.0,
        };
        LearntNoise {
            least: BOUNDS.0,
            axes: [axis; 2],
            begin: None,
        }
    }
}

impl LearntNoise {
    /// One that never makes sigmas smaller.
    pub fn upward() -> Self {
        LearntNoise {
            least: 1.0,
            ..LearntNoise::default()
        }
    }

    /// Factors on stated sigmas as used, horizontal and vertical.
    pub fn scale(&self) -> [f64; 2] {
        self.axes.map(|a| a.used)
    }

    /// A stated covariance with the factors in it and no variance below the square of `floor`.
    /// Only with `fall`, factors below one are used.
    pub fn apply(&self, stated: &Matrix3<f64>, floor: f64, fall: bool) -> Matrix3<f64> {
        let least = if fall { 0.0 } else { 1.0 };
        scaled(stated, &self.scale().map(|k| k.max(least)), floor)
    }

    /// Whether the horizontal factor is below one.
    pub fn is_less_than_stated(&self) -> bool {
        self.axes[0].used < 1.0
    }

    /// Covariance of the errors that the residuals do not show: what is stated beyond what was learnt; zero unless the
    /// factors are below one.
    pub fn unseen(&self, stated: &Matrix3<f64>) -> Matrix3<f64> {
        let [h, v] = self.scale().map(|k| (1.0 - k * k).max(0.0).sqrt());
        let d = Matrix3::from_diagonal(&Vector3::new(h, h, v));
        d * stated * d
    }

    /// Take what an accepted measurement says. `floor` as in [`LearntNoise::apply`]; without `fall`, factors do not go below
    /// one, and those that are there wait.
    pub fn learn(&mut self, time: Time, evidence: &Evidence, floor: f64, fall: bool) {
        if !fall && self.axes.iter().any(|a| a.used < 1.0) {
            return;
        }
        let begin = *self.begin.get_or_insert(time);
        for i in 0..3 {
            let axis = &mut self.axes[i / 2];
            let stated = evidence.stated[i].max(floor * floor);
            let own = (axis.ratio * stated).max(floor * floor);
            let s = evidence.predicted[i].max(0.0) + own;
            axis.count += 1;
            axis.sum += (evidence.residual[i] * evidence.residual[i] / s).min(MOST_OF_ONE);
            axis.share += own / s;
        }
        let whole = self.axes[1].count >= WINDOW && time.since(begin) >= WINDOW_S;
        if whole {
            let stated = evidence.stated.map(|r| r.max(floor * floor));
            for (axis, stated) in self.axes.iter_mut().zip([stated.xy().mean(), stated.z]) {
                // Below the floor there is nothing to be had.
                let bound = if fall { self.least } else { 1.0 };
                let least = (floor * floor / stated).max(bound * bound);
                axis.judge(least.min(1.0));
            }
            self.begin = None;
        }
    }

    /// Errors have at least the variances `scatter`, where `stated` is what the receiver says: taken at once.
    pub fn raise(&mut self, scatter: &Vector3<f64>, stated: &Vector3<f64>) {
        let horizontal = scatter.xy().sum() / stated.xy().sum();
        for (axis, ratio) in self.axes.iter_mut().zip([horizontal, scatter.z / stated.z]) {
            if ratio > axis.ratio {
                axis.ratio = ratio.min(BOUNDS.1 * BOUNDS.1);
                axis.decide();
            }
        }
        *self = LearntNoise {
            begin: None,
            axes: self.axes.map(|a| a.emptied()),
            ..*self
        };
    }
}

impl Axis {
    fn emptied(self) -> Self {
        Axis {
            count: 0,
            sum: 0.0,
            share: 0.0,
            ..self
        }
    }

    fn judge(&mut self, least: f64) {
        let count = f64::from(self.count.max(1));
        let (mean, share) = (self.sum / count, self.share / count);
        *self = self.emptied();
        if share < LEAST_SHARE {
            return;
        }
        let most = MOST_PER_WINDOW.ln();
        let step = mean.max(1e-9).ln().clamp(-most, most);
        // A change of k² changes S by its share only.
        let obvious = !(OBVIOUS.recip()..OBVIOUS).contains(&mean);
        let gain = if obvious { 1.0 } else { SLOW };
        let step = (gain * step / share).clamp(-most, most);
        self.ratio = (self.ratio * step.exp()).clamp(least, BOUNDS.1 * BOUNDS.1);
        self.decide();
    }

    fn decide(&mut self) {
        let k = self.ratio.sqrt();
        let beyond = |limit: f64| k > limit || k < limit.recip();
        let trusted = self.used == 1.0;
        self.used = if beyond(if trusted { TOLERATED } else { FORGIVEN }) {
            k
        } else {
            1.0
        };
    }
}

/// A covariance with factors on its sigmas, horizontal and vertical, and no variance below the square of `floor`.
///
/// A factor above one works on the floor too: zero is stated by receivers that know nothing.
pub(super) fn scaled(stated: &Matrix3<f64>, scale: &[f64; 2], floor: f64) -> Matrix3<f64> {
    let k = Vector3::new(scale[0], scale[0], scale[1]);
    let d = Matrix3::from_diagonal(&k);
    let mut r = d * stated * d;
    for i in 0..3 {
        let least = floor * k[i].max(1.0);
        r[(i, i)] = r[(i, i)].max(least * least);
    }
    r
}
