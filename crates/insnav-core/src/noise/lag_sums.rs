//! Lag covariances of innovations as they come, of a size that is known at run time.

use super::lag_accumulator::Weights;
use super::{LagCovariance, Refusal};
use serde::{Deserialize, Serialize};
use std::vec;
use std::vec::Vec;

/// [`LagAccumulator`](super::LagAccumulator) with its sizes at run time: the same sums, bit for bit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LagSums {
    channels: usize,
    lags: usize,
    /// The last samples of this run, newest first, axis after axis.
    history: Vec<f64>,
    filled: usize,
    /// Sums of ν(k+j)\[a\] ν(k)\[b\], at (b channels + a) lags + j.
    sums: Vec<f64>,
    weights: Weights<Vec<f64>>,
    squares: Weights<Vec<f64>>,
    retention: f64,
}

impl LagSums {
    /// Empty sums of `channels` components and `lags` lags whose products lose the factor `retention` (0 … 1) with each sample; 1
    /// remembers everything.
    ///
    /// # Errors
    /// [`Refusal::Setting`] without a channel or a lag, or for a retention that is none.
    pub fn new(channels: usize, lags: usize, retention: f64) -> Result<Self, Refusal> {
        let refuse = |what, value, expected| {
            Err(Refusal::Setting {
                what,
                value,
                expected,
            })
        };
        if channels == 0 {
            return refuse("number of channels", 0.0, "at least one");
        }
        if lags == 0 {
            return refuse("number of lags", 0.0, "at least one");
        }
        if !(0.0..=1.0).contains(&retention) {
            return refuse("retention", retention, "between 0 and 1");
        }
        Ok(LagSums {
            channels,
            lags,
            history: vec![0.0; channels * lags],
            filled: 0,
            sums: vec![0.0; channels * channels * lags],
            weights: Weights::new(vec![0.0; lags]),
            squares: Weights::new(vec![0.0; lags]),
            retention,
        })
    }

    /// Number of components of an innovation.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Number of lags.
    pub fn lags(&self) -> usize {
        self.lags
    }

    /// Take the next innovation. One that is not finite ends the run and is not used.
    ///
    /// # Errors
    /// [`Refusal::Shape`] for another number of components; the sums are as before.
    pub fn push(&mut self, innovation: &[f64]) -> Result<(), Refusal> {
        if innovation.len() != self.channels {
            return Err(Refusal::Shape {
                what: "innovation",
                found: std::format!("{} components", innovation.len()),
                expected: std::format!("{}", self.channels),
            });
        }
        if innovation.iter().any(|v| !v.is_finite()) {
            self.end_run();
            return Ok(());
        }
        let lags = self.lags;
        for (axis, value) in self.history.chunks_exact_mut(lags).zip(innovation) {
            axis.copy_within(..lags - 1, 1);
            axis[0] = *value;
        }
        self.filled = (self.filled + 1).min(lags);
        let w = self.retention;
        let mut sums = self.sums.chunks_exact_mut(lags);
        for older in self.history.chunks_exact(lags) {
            for (newest, sums) in innovation.iter().zip(&mut sums) {
                for (sum, value) in sums.iter_mut().zip(older) {
                    *sum = w * *sum + newest * value;
                }
            }
        }
        self.weights.push(self.filled, w);
        self.squares.push(self.filled, w * w);
        Ok(())
    }

    /// The next sample does not follow the last one: a gap, another log, a change of the gain.
    pub fn end_run(&mut self) {
        self.history.fill(0.0);
        self.filled = 0;
    }

    /// Add what others have gathered.
    ///
    /// # Errors
    /// [`Refusal::Shape`] for other sizes.
    pub fn merge(&mut self, other: &Self) -> Result<(), Refusal> {
        let size = |s: &Self| std::format!("{} channels, {} lags", s.channels, s.lags);
        if (self.channels, self.lags) != (other.channels, other.lags) {
            return Err(Refusal::Shape {
                what: "sums to merge",
                found: size(other),
                expected: size(self),
            });
        }
        for (sum, more) in self.sums.iter_mut().zip(&other.sums) {
            *sum += more;
        }
        self.weights.add(&other.weights);
        self.squares.add(&other.squares);
        Ok(())
    }

    /// Means of νₖ₊ⱼ νₖᵀ, element (a, b) of lag j at j p² + b p + a; zero before the first product of a lag.
    pub fn covariances(&self) -> Vec<f64> {
        let (p, lags) = (self.channels, self.lags);
        let mut out = Vec::with_capacity(self.sums.len());
        for lag in 0..lags {
            let weight = self.weights.at(lag).max(f64::MIN_POSITIVE);
            out.extend((0..p * p).map(|ab| self.sums[ab * lags + lag] / weight));
        }
        out
    }

    /// Of how many products of full weight the mean at each lag is as good as: (Σw)² / Σw².
    pub fn counts(&self) -> Vec<f64> {
        (0..self.lags)
            .map(|lag| self.weights.count(&self.squares, lag))
            .collect()
    }

    /// Both, for [`als_solve`](super::als_solve).
    ///
    /// # Errors
    /// Those of [`LagCovariance::new`].
    pub fn covariance(&self) -> Result<LagCovariance, Refusal> {
        LagCovariance::new(self.channels, self.covariances(), self.counts())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::LagAccumulator;
    use nalgebra::Vector2;

    #[test]
    fn sums_are_those_of_the_fixed_size_bit_for_bit() {
        for retention in [1.0, 0.97] {
            let mut fixed = LagAccumulator::<2, 5>::forgetting(retention);
            let mut sums = LagSums::new(2, 5, retention).expect("sizes");
            let mut other = sums.clone();
            for k in 0..60 {
                let t = f64::from(k);
                let mut nu = Vector2::new((1.7 * t).sin(), (0.9 * t * t).cos());
                if k == 33 {
                    nu.x = f64::NAN;
                }
                fixed.push(&nu);
                sums.push(nu.as_slice()).expect("two components");
                other.push(nu.as_slice()).expect("two components");
                let (values, counts) = (sums.covariances(), sums.counts());
                for lag in 0..5 {
                    assert_eq!(
                        values[lag * 4..lag * 4 + 4],
                        *fixed.covariance(lag).as_slice(),
                        "{k} {lag}"
                    );
                    assert_eq!(counts[lag], fixed.count(lag), "{k} {lag}");
                }
            }
            let copy = fixed.clone();
            fixed.merge(&copy);
            sums.merge(&other).expect("same sizes");
            assert_eq!(sums.covariances()[..4], *fixed.covariance(0).as_slice());
            assert_eq!(sums.counts()[4], fixed.count(4));
        }
    }

    #[test]
    fn other_sizes_are_refused() {
        assert!(LagSums::new(0, 3, 1.0).is_err() && LagSums::new(1, 0, 1.0).is_err());
        assert!(LagSums::new(1, 3, f64::NAN).is_err());
        let mut sums = LagSums::new(2, 3, 1.0).expect("sizes");
        let before = sums.clone();
        assert!(sums.push(&[1.0]).is_err());
        assert!(
            sums.merge(&LagSums::new(2, 4, 1.0).expect("sizes"))
                .is_err()
        );
        assert_eq!(sums, before);
    }
}
