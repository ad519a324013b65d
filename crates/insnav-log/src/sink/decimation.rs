//! Fewer epochs than inertial samples.

use insnav_core::time::Time;
use serde::{Deserialize, Serialize};

/// Picks, at a rate, the samples nearest to an even grid.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Decimation {
    period_ns: i64,
    due: Option<Time>,
    last: Option<Time>,
}

impl Decimation {
    pub(super) fn new(rate_hz: f64) -> Self {
        let period_ns = if rate_hz > 0.0 {
            (1e9 / rate_hz) as i64
        } else {
            0
        };
        Decimation {
            period_ns,
            due: None,
            last: None,
        }
    }

    pub(super) fn wants(&mut self, time: Time) -> bool {
        if self.period_ns == 0 {
            return true;
        }
        let Some(due) = self.due else {
            self.due = Some(Time(time.0.saturating_add(self.period_ns)));
            self.last = Some(time);
            return true;
        };
        // A sample just short of its place counts: the next one would be further off.
        let step = self.last.map_or(0, |last| time.0 - last.0);
        self.last = Some(time);
        if time.0.saturating_add(step / 2) < due.0 {
            return false;
        }
        let late = (time.0 - due.0).max(0) / self.period_ns;
        self.due = Some(Time(
            due.0
                .saturating_add(self.period_ns.saturating_mul(1 + late)),
        ));
        true
    }
}
