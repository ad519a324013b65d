//! The delayed horizon: a fixed-capacity ring of samples, in the order of their stamps.
//!
//! Samples come in at the head as they arrive and are used at the tail, a fixed time later, so that a late one falls into
//! its place and nothing is ever recomputed.

use crate::sample::Sample;
use crate::time::Time;
use heapless::Deque;
use serde::{Deserialize, Serialize};

/// Samples that fit: a second at 1 kHz, or half a second and the difference of two clocks, with room for aiding. When the ring is full, the oldest is used early.
pub const HORIZON_CAPACITY: usize = 1024;

/// Samples between the newest stamp and the tail.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Horizon {
    ring: Deque<Sample, HORIZON_CAPACITY>,
    delay: f64,
    /// Newest inertial stamp.
    head: Option<Time>,
    /// How many of the oldest samples the look ahead has shown already.
    seen: usize,
}

/// Why a sample was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NotTaken {
    /// An inertial sample of the same stamp is there already.
    Duplicate,
    /// No room.
    Full,
}

/// Aiding before inertial at the same instant: an update at the end of an interval comes before that interval's epoch. Kinds
/// of aiding have an order too, so that the solution does not depend on which of them arrived first.
fn order(s: &Sample) -> (Time, u8) {
    let kind = match s {
        Sample::GnssPosition(_) => 0,
        Sample::GnssVelocity(_) => 1,
        Sample::Heading(_) => 2,
        Sample::Standstill(_) => 3,
        Sample::Speed(_) => 4,
        Sample::Magnetic(_) => 5,
        Sample::Imu(_) | Sample::ImuIncrement(_) => u8::MAX,
    };
    (s.time(), kind)
}

impl Horizon {
    pub(super) fn new(delay: f64) -> Self {
        Horizon {
            ring: Deque::new(),
            delay,
            head: None,
            seen: 0,
        }
    }

    pub(super) fn is_full(&self) -> bool {
        self.ring.is_full()
    }

    /// Put a sample in its place.
    pub(super) fn push(&mut self, sample: Sample) -> Result<(), NotTaken> {
        let mut i = self.ring.len();
        while i > 0 && self.ring.get(i - 1).map(order) > Some(order(&sample)) {
            i -= 1;
        }
        if sample.is_inertial() {
            if i > 0 && self.ring.get(i - 1).map(order) == Some(order(&sample)) {
                return Err(NotTaken::Duplicate);
            }
            self.head = self.head.max(Some(sample.time()));
        }
        self.ring.push_back(sample).map_err(|_| NotTaken::Full)?;
        for j in (i + 1..self.ring.len()).rev() {
            self.ring.swap(j - 1, j);
        }
        // Later than the look ahead: it is used, but was not foreseen.
        if i < self.seen {
            self.seen += 1;
        }
        Ok(())
    }

    /// The next inertial sample, if it is old enough for the tail, or whatever its age when `flush` is set.
    pub(super) fn next_inertial(&self, flush: bool) -> Option<&Sample> {
        let next = self.ring.iter().find(|s| s.is_inertial())?;
        (flush || self.head?.since(next.time()) >= self.delay).then_some(next)
    }

    /// Wait for a new newest stamp.
    #[cfg(feature = "std")]
    pub(super) fn forget_head(&mut self) {
        self.head = None;
    }

    /// The next sample that was not looked at yet, up to an instant.
    pub(super) fn look_ahead(&mut self, until: Time) -> Option<&Sample> {
        let next = self.ring.get(self.seen).filter(|s| s.time() <= until)?;
        self.seen += 1;
        Some(next)
    }

    /// The oldest sample.
    pub(super) fn pop(&mut self) -> Option<Sample> {
        self.seen = self.seen.saturating_sub(1);
        self.ring.pop_front()
    }

    /// The oldest sample, if it is an aiding one.
    pub(super) fn pop_aiding(&mut self) -> Option<Sample> {
        let popped = self.ring.pop_front_if(|s| !s.is_inertial());
        self.seen = self.seen.saturating_sub(usize::from(popped.is_some()));
        popped
    }

    /// All samples, oldest first.
    pub(super) fn iter(&self) -> impl Iterator<Item = &Sample> {
        self.ring.iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Heading, ImuSample};
    use nalgebra::Vector3;

    fn imu(t: f64) -> Sample {
        let (time, zero) = (Time::from_seconds(t), Vector3::zeros());
        Sample::Imu(ImuSample {
            time,
            angular_rate_b: zero,
            specific_force_b: zero,
        })
    }

    fn aid(t: f64) -> Sample {
        Sample::Heading(Heading {
            time: Time::from_seconds(t),
            heading: 0.0,
            sigma: 1.0,
        })
    }

    #[test]
    fn late_samples_fall_into_place_and_wait_for_the_delay() {
        let mut horizon = Horizon::new(0.5);
        for s in [imu(0.0), imu(0.2), imu(0.4), aid(0.2), imu(0.1), aid(0.15)] {
            horizon.push(s).unwrap();
        }
        assert!(
            horizon.next_inertial(false).is_none(),
            "0.4 s is younger than the delay"
        );
        horizon.push(imu(0.6)).unwrap();
        assert_eq!(horizon.next_inertial(false), Some(&imu(0.0)));
        let all: std::vec::Vec<Sample> = core::iter::from_fn(|| horizon.pop()).collect();
        assert_eq!(
            all,
            [
                imu(0.0),
                imu(0.1),
                aid(0.15),
                aid(0.2),
                imu(0.2),
                imu(0.4),
                imu(0.6)
            ]
        );
    }

    #[test]
    fn a_full_ring_says_so_and_a_second_sample_of_one_stamp_too() {
        let mut horizon = Horizon::new(0.5);
        for i in 0..HORIZON_CAPACITY {
            horizon.push(imu(i as f64)).unwrap();
        }
        assert_eq!(horizon.push(imu(3.0)), Err(NotTaken::Duplicate));
        assert!(horizon.is_full());
        assert_eq!(horizon.push(imu(1e4)), Err(NotTaken::Full));
    }
}
