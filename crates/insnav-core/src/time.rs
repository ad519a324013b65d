//! Time on the log's clock.

use core::fmt;
use serde::{Deserialize, Serialize};

/// An instant on the log's clock, in integer nanoseconds (since the Unix epoch for ROS logs).
///
/// Integer, so that stamps survive a round trip exactly and sums never drift. Spans between instants are `f64` seconds:
/// a span is short where it is used in arithmetic.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize,
)]
pub struct Time(pub i64);

impl Time {
    /// The instant `seconds` after the clock's zero, rounded to the nanosecond.
    ///
    /// A `f64` holds today's Unix time to about 0.2 µs only: keep nanoseconds where a stamp must be exact.
    pub fn from_seconds(seconds: f64) -> Self {
        Time(round_to_nanos(seconds))
    }

    /// Seconds since the clock's zero, rounded to what a `f64` holds.
    pub fn seconds(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// Seconds from `earlier` to `self`; negative if `self` is the earlier one.
    pub fn since(self, earlier: Time) -> f64 {
        (self.0.wrapping_sub(earlier.0)) as f64 * 1e-9
    }

    /// The instant `seconds` later, saturating at the ends of the clock.
    pub fn plus(self, seconds: f64) -> Self {
        Time(self.0.saturating_add(round_to_nanos(seconds)))
    }
}

/// Nanoseconds nearest to `seconds`; `as` saturates, and NaN becomes zero.
fn round_to_nanos(seconds: f64) -> i64 {
    let nanos = seconds * 1e9;
    (if nanos < 0.0 {
        nanos - 0.5
    } else {
        nanos + 0.5
    }) as i64
}

impl fmt::Display for Time {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (sign, nanos) = if self.0 < 0 {
            ("-", self.0.unsigned_abs())
        } else {
            ("", self.0 as u64)
        };
        write!(
            f,
            "{sign}{}.{:06} s",
            nanos / 1_000_000_000,
            nanos % 1_000_000_000 / 1000
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_exact_at_unix_time() {
        let t = Time(1_600_000_000_123_456_789);
        assert_eq!(t.plus(0.005), Time(1_600_000_000_128_456_789));
        assert_eq!(t.plus(0.005).since(t), 0.005);
        assert_eq!(t.plus(-0.005).since(t), -0.005);
    }

    #[test]
    fn displays_seconds_and_microseconds() {
        assert_eq!(std::format!("{}", Time(1_312_400_000_000)), "1312.400000 s");
        assert_eq!(std::format!("{}", Time(-1_500_000_000)), "-1.500000 s");
    }
}
