//! How the body turned over the last samples, for a field that is older than the gyros.

use crate::attitude::exp;
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Samples that are kept: 0.2 s at 300 Hz; what is older is taken as turning on at the oldest rate.
const KEPT: usize = 64;

#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
struct Turn {
    /// Attitude at the end of the sample against an arbitrary one, gyros only.
    chain: UnitQuaternion<f64>,
    /// Rate over the sample, body, rad/s.
    rate: Vector3<f64>,
    /// Its length, s.
    interval: f64,
}

/// A ring of the last turns.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct History {
    #[serde(with = "halves")]
    turns: [Turn; KEPT],
    last: usize,
    count: usize,
}

/// serde knows arrays up to 32.
mod halves {
    use super::{KEPT, Turn};
    use serde::ser::Error;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    const HALF: usize = KEPT / 2;

    pub(super) fn serialize<S: Serializer>(turns: &[Turn; KEPT], s: S) -> Result<S::Ok, S::Error> {
        let halves: (&[Turn; HALF], &[Turn; HALF]) = turns
            .first_chunk()
            .zip(turns.last_chunk())
            .ok_or_else(|| S::Error::custom("two halves are no whole"))?;
        halves.serialize(s)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(d: D) -> Result<[Turn; KEPT], D::Error> {
        let (first, last) = <([Turn; HALF], [Turn; HALF])>::deserialize(d)?;
        Ok(core::array::from_fn(|i| match i.checked_sub(HALF) {
            None => first[i],
            Some(i) => last[i],
        }))
    }
}

impl History {
    pub(super) fn new() -> Self {
        let still = Turn {
            chain: UnitQuaternion::identity(),
            rate: Vector3::zeros(),
            interval: 0.0,
        };
        History {
            turns: [still; KEPT],
            last: 0,
            count: 0,
        }
    }

    pub(super) fn push(&mut self, turn: &UnitQuaternion<f64>, rate: Vector3<f64>, interval: f64) {
        let mut chain = self.turns[self.last].chain * turn;
        chain.renormalize_fast();
        self.last = (self.last + 1) % KEPT;
        self.count = (self.count + 1).min(KEPT);
        self.turns[self.last] = Turn {
            chain,
            rate,
            interval,
        };
    }

    /// The rotation from the body `age` seconds ago to the body now, and the rate then; negative ages foretell at the last rate.
    pub(super) fn since(&self, age: f64) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let newest = &self.turns[self.last];
        let mut left = age;
        for back in 0..self.count {
            let turn = &self.turns[(self.last + KEPT - back) % KEPT];
            if left <= turn.interval || back + 1 == self.count {
                let then = turn.chain * exp(&(-turn.rate * left));
                return (newest.chain.conjugate() * then, turn.rate);
            }
            left -= turn.interval;
        }
        (UnitQuaternion::identity(), newest.rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_back_is_what_was_turned() {
        let mut history = History::new();
        let rate = |i: usize| Vector3::new(0.3 * i as f64, 1.0, -0.2 * i as f64);
        let mut attitudes = std::vec![UnitQuaternion::identity()];
        for i in 0..100 {
            let turn = exp(&(rate(i) * 0.01));
            attitudes.push(attitudes[i] * turn);
            history.push(&turn, rate(i), 0.01);
        }
        let now = attitudes[100];
        for (age, expected) in [
            (0.0, now),
            (0.03, attitudes[97]),
            (0.035, attitudes[96] * exp(&(rate(96) * 0.005))),
            (-0.005, now * exp(&(rate(99) * 0.005))),
        ] {
            let (turn, _) = history.since(age);
            assert!((now * turn).angle_to(&expected) < 1e-9, "{age}");
        }
    }
}
