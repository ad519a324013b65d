//! A receiver that repeats its position while the vehicle moves.

use super::{Facts, Finding, Severity};
use insnav_core::time::Time;

/// Repeats of fewer seconds do no harm.
const SHORTEST: f64 = 2.0;
/// The vehicle must have gone this far meanwhile, m, by the receiver's velocity or by where the position goes on.
const WAY: f64 = 10.0;

pub(super) fn find(facts: &Facts<'_>) -> Option<Finding> {
    let frozen = stretches(facts);
    let (longest, way) = frozen
        .iter()
        .map(|(from, to, way)| (to.since(*from), *way))
        .max_by(|a, b| a.0.total_cmp(&b.0))?;
    let intervals: Vec<String> = frozen
        .iter()
        // The fix that froze is good: the next is not. Half a second on either side is no loss.
        .map(|(from, to, _)| {
            format!(
                "{:.2}:{:.2}",
                facts.seconds(*from) + 0.05,
                facts.seconds(*to) + 0.01
            )
        })
        .collect();
    Some(
        Finding::new(
            "gnss_frozen",
            Severity::Warning,
            format!(
                "the position stands still to the last digit for {longest:.1} s while the vehicle goes {way:.0} m ({} such: {} s)",
                frozen.len(),
                intervals.join(", ")
            ),
            "the filter would be held back, or reject what comes after",
        )
        .flag(format!("--withhold {}", intervals.join(","))),
    )
}

/// From the fix that is repeated to its last repetition, and the way meanwhile.
fn stretches(facts: &Facts<'_>) -> Vec<(Time, Time, f64)> {
    let fixes = &facts.survey.positions;
    let mut found = Vec::new();
    let mut begin = 0;
    while begin < fixes.len() {
        let same = |i: usize| {
            let (a, b) = (&fixes[begin].position, &fixes[i].position);
            a.latitude == b.latitude && a.longitude == b.longitude
        };
        let mut end = begin;
        while end + 1 < fixes.len() && same(end + 1) {
            end += 1;
        }
        let (from, to) = (fixes[begin].time, fixes[end].time);
        if to.since(from) > SHORTEST {
            let way = way(facts, from, to, end);
            if way > WAY {
                found.push((from, to, way));
            }
        }
        begin = end + 1;
    }
    found
}

/// Way by the receiver's velocity; without one, by the fix after the last repetition.
fn way(facts: &Facts<'_>, from: Time, to: Time, last: usize) -> f64 {
    let velocities = &facts.survey.velocities;
    let begin = velocities.partition_point(|v| v.time < from);
    let end = velocities.partition_point(|v| v.time <= to);
    let inside = &velocities[begin.min(end)..end];
    if inside.len() >= 2 {
        return inside
            .windows(2)
            .map(|w| w[0].velocity_n.xy().norm() * w[1].time.since(w[0].time))
            .sum();
    }
    let fixes = &facts.survey.positions;
    fixes.get(last + 1).map_or(0.0, |after| {
        let jump = fixes[last].position.offset_to(&after.position).xy().norm();
        // A jump that the interval of the fixes explains is none.
        let usual = 2.0 * after.time.since(fixes[last].time) * 15.0;
        if jump > usual.max(WAY) { jump } else { 0.0 }
    })
}
