//! A bounded window that puts samples into the order of their stamps.

use insnav_core::time::Time;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Holds what was read for a while of log time, in order of stamps.
///
/// The window is measured on the recorder's clock, not on the stamps: two sensors whose clocks differ by seconds must not
/// push each other out. A sorted queue rather than a heap, since nearly every sample belongs at its end.
#[derive(Clone, Debug)]
pub(crate) struct Reorder<T> {
    window_ns: i64,
    now: Time,
    /// Stamp, log time, value; by stamp, equal stamps in order of arrival.
    queue: VecDeque<(Time, Time, T)>,
    reordered: u64,
}

/// What waits in a window, as it can be kept.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Waiting<T> {
    now: Time,
    queue: VecDeque<(Time, Time, T)>,
    reordered: u64,
}

impl<T> Default for Waiting<T> {
    fn default() -> Self {
        Waiting {
            now: Time(i64::MIN),
            queue: VecDeque::new(),
            reordered: 0,
        }
    }
}

impl<T: Clone> Reorder<T> {
    /// What waits now.
    pub(crate) fn waiting(&self) -> Waiting<T> {
        Waiting {
            now: self.now,
            queue: self.queue.clone(),
            reordered: self.reordered,
        }
    }

    /// Wait as another window did.
    pub(crate) fn restore(&mut self, waiting: &Waiting<T>) {
        self.now = waiting.now;
        self.queue.clone_from(&waiting.queue);
        self.reordered = waiting.reordered;
    }
}

impl<T> Reorder<T> {
    pub(crate) fn new(window_s: f64) -> Self {
        let window_ns = (window_s.max(0.0) * 1e9) as i64;
        Reorder {
            window_ns,
            now: Time(i64::MIN),
            queue: VecDeque::new(),
            reordered: 0,
        }
    }

    pub(crate) fn push(&mut self, stamp: Time, log_time: Time, value: T) {
        self.now = self.now.max(log_time);
        match self.queue.back() {
            Some((last, ..)) if stamp < *last => {
                let place = self.queue.partition_point(|(other, ..)| *other <= stamp);
                self.queue.insert(place, (stamp, log_time, value));
                self.reordered += 1;
            }
            _ => self.queue.push_back((stamp, log_time, value)),
        }
    }

    /// The earliest, once it has waited for the whole window or nothing more will come.
    pub(crate) fn pop(&mut self, no_more: bool) -> Option<T> {
        let (_, log_time, _) = self.queue.front()?;
        if no_more || self.now.0.saturating_sub(log_time.0) >= self.window_ns {
            self.queue.pop_front().map(|(_, _, value)| value)
        } else {
            None
        }
    }

    /// How many came after one with a later stamp.
    pub(crate) fn reordered(&self) -> u64 {
        self.reordered
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn run(window_s: f64, arrivals: &[(i64, i64)]) -> Vec<i64> {
        let mut reorder = Reorder::new(window_s);
        let mut out = Vec::new();
        for &(stamp, log) in arrivals {
            reorder.push(Time(stamp), Time(log), stamp);
            out.extend(std::iter::from_fn(|| reorder.pop(false)));
        }
        out.extend(std::iter::from_fn(|| reorder.pop(true)));
        out
    }

    proptest! {
        #[test]
        fn delays_within_the_window_come_out_sorted(delays in proptest::collection::vec(0i64..1_000_000_000, 1..200)) {
            let mut arrivals: Vec<(i64, i64)> =
                delays.iter().enumerate().map(|(i, d)| (i as i64 * 10_000_000, i as i64 * 10_000_000 + d)).collect();
            arrivals.sort_by_key(|(_, log)| *log);
            let out = run(1.0, &arrivals);
            prop_assert!(out.is_sorted());
            prop_assert_eq!(out.len(), delays.len());
        }
    }

    #[test]
    fn a_delay_beyond_the_window_does_not_come_out_sorted() {
        let second = 1_000_000_000;
        let arrivals = [
            (0, 0),
            (2 * second, 2 * second),
            (3 * second, 3 * second),
            (second, 4 * second),
        ];
        assert_eq!(run(1.0, &arrivals), [0, 2 * second, second, 3 * second]);
        assert!(run(3.0, &arrivals).is_sorted());
    }

    #[test]
    fn a_clock_that_is_ahead_waits_for_the_others() {
        // A receiver on GPS time, 18 s ahead of the IMU's UTC, both recorded as they come.
        let second = 1_000_000_000;
        let mut arrivals = Vec::new();
        for i in 0..40 {
            arrivals.push((i * second, i * second));
            arrivals.push(((i + 18) * second, i * second));
        }
        assert!(run(1.0, &arrivals).is_sorted());
    }
}
