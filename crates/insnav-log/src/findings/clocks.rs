//! Clocks that differ, as the motion shows them.

use super::{Finding, Severity};
use crate::Estimate;
use insnav_core::config::Config;

/// Differences below this are not worth a word, s: at 30 m/s, 0.3 m.
const NEGLIGIBLE: f64 = 0.01;

pub(super) fn find(
    offset: Option<Estimate>,
    lag: Option<Estimate>,
    config: &Config,
) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut compare = |code, what: &str, key: &str, estimate: Option<Estimate>, set: f64| {
        let Some(Estimate {
            value,
            sigma: Some(sigma),
        }) = estimate
        else {
            return;
        };
        if (value - set).abs() <= (3.0 * sigma).max(NEGLIGIBLE) {
            return;
        }
        found.push(
            Finding::new(
                code,
                Severity::Warning,
                format!("{what} {value:.4} ± {sigma:.4} s, and the run takes {set:.4} s"),
                format!(
                    "at 20 m/s every position would be off by {:.1} m along the way",
                    20.0 * (value - set).abs()
                ),
            )
            .flag("--time-offset auto")
            .and(&format!(", or set {key} = {value:.4}")),
        );
    };
    compare(
        "time_offset",
        "to meet the clock of GNSS positions, IMU stamps need",
        "gnss.time_offset_s",
        offset,
        config.gnss.time_offset_s,
    );
    compare(
        "velocity_lag",
        "GNSS velocity is stamped later than its position, by",
        "gnss.velocity_lag_s",
        lag,
        config.gnss.velocity_lag_s,
    );
    found
}
