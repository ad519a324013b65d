//! What was simulated.

use super::{entry, span, way};
use crate::command::Simulated;

/// The report of `simulate`.
pub(crate) fn simulated(s: &Simulated) -> String {
    let mut text = format!("{} → {}\n", s.input.display(), s.output.display());
    let mut add = |label, line: String| text.push_str(&entry(label, &line));
    add(
        "drive",
        format!(
            "{}, {}; seed {}",
            span(s.duration_s),
            way(s.distance_m),
            s.seed
        ),
    );
    add(
        "imu",
        format!(
            "{} grade, {} samples at {} Hz",
            s.imu_grade.name(),
            s.imu_samples,
            s.scenario.imu.rate_hz
        ),
    );
    add(
        "gnss",
        format!(
            "{} positions, {} velocities",
            s.gnss_positions, s.gnss_velocities
        ),
    );
    let mut next = format!("insnav run {}", s.output.display());
    if s.scenario.gnss.position_colour_sigma_m == [0.0; 3] {
        // Real receivers filter, so a run weighs fixes down that come fast; simulated ones are independent.
        next.push_str(" --set gnss.correlation_time_s=0");
    }
    if let Some(truth) = &s.truth {
        add("truth", truth.display().to_string());
        next.push_str(&format!(
            "\ninsnav compare {} {}",
            s.output.with_extension("insnav.mcap").display(),
            truth.display()
        ));
    }
    add("next", next);
    text
}
