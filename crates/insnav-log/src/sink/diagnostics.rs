//! Once a second: how well the run is going, for dashboards.

use insnav_core::filter::{Update, Verdict};
use insnav_core::solution::{Epoch, Motion};
use insnav_core::time::Time;
use serde::{Deserialize, Serialize};
use std::fmt::Write;

/// Counts what happened since the last report, and makes one every second.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Diagnostics {
    next: Option<Time>,
    accepted: u32,
    inflated: u32,
    rejected: u32,
    last_aided: Option<Time>,
}

/// One report.
pub(super) struct Report {
    pub(super) level: u8,
    pub(super) message: String,
    pub(super) values: Vec<(&'static str, String)>,
}

impl Diagnostics {
    pub(super) fn count(&mut self, update: &Update) {
        match update.verdict {
            Verdict::Accepted => self.accepted += 1,
            Verdict::Inflated | Verdict::Reset => self.inflated += 1,
            Verdict::Rejected | Verdict::Frozen => self.rejected += 1,
        }
        if update.verdict.is_used() && update.measurement.starts_with("gnss") {
            self.last_aided = Some(update.time);
        }
    }

    pub(super) fn due(&mut self, epoch: &Epoch) -> Option<Report> {
        let time = epoch.nav.time;
        if self.next.is_some_and(|next| time < next) {
            return None;
        }
        self.next = Some(Time((time.0.div_euclid(1_000_000_000) + 1) * 1_000_000_000));
        let p = epoch.covariance.diagonal();
        let horizontal = (p[0] + p[1]).max(0.0).sqrt();
        let unaided = self.last_aided.map(|last| time.since(last));
        let mut message = String::with_capacity(80);
        if let Motion::Stationary { since } = epoch.motion {
            let _ = write!(message, "standing for {:.0} s, ", time.since(since));
        }
        // Receivers report at 1 Hz or faster: three seconds without one is an outage, not a slow receiver.
        let level = match unaided {
            Some(gap) if gap < 3.0 => {
                message.push_str("aided by GNSS");
                0
            }
            Some(gap) => {
                let _ = write!(message, "no GNSS for {gap:.0} s, dead reckoning");
                1
            }
            None => {
                message.push_str("no GNSS yet");
                1
            }
        };
        let mut values = Vec::with_capacity(8);
        values.extend([
            ("sigma_horizontal_m", format!("{horizontal:.3}")),
            ("sigma_height_m", format!("{:.3}", p[2].max(0.0).sqrt())),
            (
                "sigma_heading_deg",
                format!("{:.3}", epoch.heading_sigma().to_degrees()),
            ),
            (
                "motion",
                if epoch.motion == Motion::Moving {
                    "moving"
                } else {
                    "stationary"
                }
                .to_owned(),
            ),
            ("updates_accepted", self.accepted.to_string()),
            ("updates_inflated", self.inflated.to_string()),
            ("updates_rejected", self.rejected.to_string()),
        ]);
        if let Motion::Stationary { since } = epoch.motion {
            values.push(("standing_since_unix_s", format!("{:.3}", since.seconds())));
        }
        (self.accepted, self.inflated, self.rejected) = (0, 0, 0);
        Some(Report {
            level,
            message,
            values,
        })
    }
}
