//! Thresholds learnt from stops that speed confirms.
//!
//! While GNSS or wheels have said for five seconds that the body stands, the logarithms of LPMV and LPGV are taken once a
//! second; threshold = exp(median + 4 · 1.4826 · MAD). Road motion is kept out four times over: the speed must be below
//! half the limit, a value counts only when that still holds two seconds later, the threshold is capped at
//! a hundred times the fixed one (ten times its amplitude), and it is used for entering a stop only while GNSS or wheels
//! speak: without them the fixed thresholds hold.

use crate::time::Time;
use heapless::Deque;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

/// Speed must have confirmed the stop for so long, s.
const CONFIRMED_FOR: f64 = 5.0;
/// A value a second.
const EVERY: f64 = 1.0;
/// Values that wait until what follows confirms them.
const WAITING: usize = 2;
/// Fewer values than this say nothing.
const FEWEST: u32 = 5;
/// The most that a threshold rises, a factor.
const CAP: f64 = 100.0;
/// From the median absolute deviation to the standard deviation of a normal distribution.
const SIGMA_PER_MAD: f64 = 1.4826;

/// Median and median absolute deviation, one value at a time: steps towards each value ([Robbins51] for quantiles), which
/// shrink as 1/n down to a fiftieth, so that an engine that warms up is followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Median {
    count: u32,
    median: f64,
    mad: f64,
}

impl Median {
    fn push(&mut self, x: f64) {
        self.count = self.count.saturating_add(1);
        if self.count == 1 {
            // Of the logarithm of a chi-square of some 60 degrees of freedom.
            (self.median, self.mad) = (x, 0.12);
            return;
        }
        let step = (2.0 / f64::from(self.count)).max(0.02) * (4.0 * self.mad).max(0.1);
        let off = x - self.median;
        self.median += off.clamp(-step, step);
        let wider = off.abs() - self.mad;
        self.mad += wider.clamp(-0.5 * step, 0.5 * step);
        self.mad = self.mad.max(0.02);
    }

    fn threshold(&self) -> Option<f64> {
        (self.count >= FEWEST).then(|| (self.median + 4.0 * SIGMA_PER_MAD * self.mad).exp())
    }
}

/// Learns the two.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Learnt {
    confirmed_since: Option<Time>,
    last: Option<Time>,
    waiting: Deque<[f64; 2], WAITING>,
    values: [Median; 2],
}

impl Learnt {
    /// Take the statistics of the window that ends now.
    pub(super) fn observe(&mut self, now: Time, confirmed: bool, statistics: [f64; 2]) {
        if !confirmed {
            self.interrupt();
            return;
        }
        let since = *self.confirmed_since.get_or_insert(now);
        let due = self.last.is_none_or(|last| now.since(last) >= EVERY);
        if now.since(since) < CONFIRMED_FOR || !due {
            return;
        }
        self.last = Some(now);
        if self.waiting.is_full()
            && let Some(old) = self.waiting.pop_front()
        {
            for (median, statistic) in self.values.iter_mut().zip(old) {
                median.push(statistic.max(1e-6).ln());
            }
        }
        let _ = self.waiting.push_back(statistics);
    }

    /// The body moves, or nobody knows: what waits is dropped.
    pub(super) fn interrupt(&mut self) {
        self.confirmed_since = None;
        self.waiting.clear();
    }

    /// The thresholds: the fixed one, or what was learnt where that is more.
    pub(super) fn raise(&self, fixed: f64) -> [f64; 2] {
        self.values.map(|median| {
            let learnt = median.threshold().unwrap_or(0.0);
            learnt.clamp(fixed, CAP * fixed)
        })
    }
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::*;
    use crate::sim::{Source, Stream};

    /// Against the true median and MAD of what is fed, with one value in ten far off.
    #[test]
    fn median_and_mad_are_followed_in_spite_of_outliers() {
        let mut source = Source::new(3, Stream::Initial);
        let mut median = Median::default();
        for i in 0..2000 {
            let outlier = if i % 10 == 0 { 3.0 } else { 0.0 };
            median.push(1.5 + 0.4 * source.normal() + outlier);
        }
        // The median moves up by the 10 % of outliers: normal quantile of 0.5/0.9, 0.14 sigma; MAD of 0.4: 0.27.
        assert!((median.median - 1.556).abs() < 0.12, "{median:?}");
        assert!((0.2..0.4).contains(&median.mad), "{median:?}");
    }

    fn fed(confirmed: impl Fn(i32) -> bool, statistic: impl Fn(i32) -> f64) -> Learnt {
        let mut learnt = Learnt::default();
        for i in 0..600 {
            let value = statistic(i);
            learnt.observe(
                Time::from_seconds(0.1 * f64::from(i)),
                confirmed(i),
                [value; 2],
            );
        }
        learnt
    }

    #[test]
    fn an_idling_engine_raises_the_threshold_up_to_the_cap() {
        let learnt = fed(|_| true, |i| 40.0 + 4.0 * (0.7 * f64::from(i)).sin());
        let [threshold, _] = learnt.raise(7.0);
        assert!((44.0..120.0).contains(&threshold), "{threshold}");
        assert_eq!(fed(|_| true, |_| 1e6).raise(7.0), [700.0; 2]);
        assert_eq!(fed(|_| true, |_| 3.0).raise(7.0), [7.0; 2]);
    }

    /// Short stops, and starts in the last window of each.
    #[test]
    fn what_speed_does_not_confirm_for_long_is_not_learnt() {
        assert_eq!(fed(|i| i % 40 != 0, |_| 50.0).raise(7.0), [7.0; 2]);
        let starts = fed(
            |i| i % 300 < 200,
            |i| if i % 300 < 185 { 3.0 } else { 500.0 },
        );
        assert_eq!(starts.raise(7.0), [7.0; 2]);
    }
}
