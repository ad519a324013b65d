//! How much a body that stands has rocked of late: what rocks goes on, what starts grows.

use heapless::Deque;
use serde::{Deserialize, Serialize};

/// Seconds that are remembered: the slowest rocking of a body on its wheels takes five or so.
const SECONDS: usize = 10;
/// Of these so many of the newest do not count yet: a start must not hide itself.
const NEWEST: usize = 2;
/// Rocking may grow by so much on what it was, a factor on LPMV and LPGV (twice the amplitude).
const GROWS: f64 = 4.0;

/// Largest LPMV and LPGV of each of the last seconds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct RockingLevel {
    seconds: Deque<[f64; 2], SECONDS>,
    open: [f64; 2],
    elapsed: f64,
}

impl RockingLevel {
    /// It moves.
    pub(super) fn clear(&mut self) {
        self.seconds.clear();
        self.open = [0.0; 2];
        self.elapsed = 0.0;
    }

    /// Take the statistics of a window that has moved on by `dt` seconds.
    pub(super) fn observe(&mut self, dt: f64, variances: [f64; 2]) {
        self.open = larger(self.open, variances);
        self.elapsed += dt;
        if self.elapsed + 0.5 * dt < 1.0 {
            return;
        }
        if self.seconds.is_full() {
            self.seconds.pop_front();
        }
        let _ = self.seconds.push_back(core::mem::take(&mut self.open));
        self.elapsed = 0.0;
    }

    /// The largest of all that is remembered.
    pub(super) fn most(&self) -> [f64; 2] {
        self.seconds.iter().copied().fold(self.open, larger)
    }

    /// What it may show now, once it is known for long enough.
    pub(super) fn bound(&self) -> Option<[f64; 2]> {
        let known = self.seconds.len().checked_sub(NEWEST)?;
        let before = self.seconds.iter().take(known).copied();
        self.seconds
            .is_full()
            .then(|| before.fold([0.0; 2], larger).map(|v| GROWS * v))
    }
}

fn larger(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].max(b[0]), a[1].max(b[1])]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fed(level: &mut RockingLevel, seconds: u32, of: impl Fn(f64) -> f64) {
        for i in 0..10 * seconds {
            let v = of(0.1 * f64::from(i));
            level.observe(0.1, [v, 2.0 * v]);
        }
    }

    #[test]
    fn what_grows_does_not_hide_itself() {
        let mut level = RockingLevel::default();
        fed(&mut level, 9, |_| 50.0);
        assert_eq!(level.bound(), None, "not known for long enough");
        fed(&mut level, 40, |t| 50.0 + 49.0 * (1.2 * t).sin());
        let [bound, _] = level.bound().expect("known");
        // Four times the largest of a swing of five seconds.
        assert!((380.0..=396.0).contains(&bound), "{bound}");
        // A start that grows by a factor of e each half second is above it before it counts.
        fed(&mut level, 2, |t| 50.0 * (2.0 * t).exp());
        assert!(level.bound().expect("known")[0] <= 396.0);
        assert!(level.most()[0] > 1500.0);
    }

    #[test]
    fn what_has_calmed_down_is_forgotten() {
        let mut level = RockingLevel::default();
        fed(&mut level, 1, |_| 1e5);
        fed(&mut level, 9, |_| 3.0);
        assert_eq!(level.most()[0], 1e5);
        fed(&mut level, 1, |_| 3.0);
        assert_eq!(level.most(), [3.0, 6.0]);
        level.clear();
        assert_eq!(level.most(), [0.0; 2]);
    }
}
