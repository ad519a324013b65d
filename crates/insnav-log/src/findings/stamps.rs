//! What is wrong with the stamps of topics, and messages that hold nothing.

use super::fit::quantile;
use super::{Finding, Severity, SourceFacts, why_no_place};
use crate::{Role, TimeSource, TopicStatistics};
use insnav_core::config::VehicleKind;
use insnav_core::navigator::longest_bridged;
use insnav_core::time::Time;

/// Clocks of two topics that differ by more against the recorder's have different sources, s.
const DIFFERENT_CLOCKS: f64 = 0.5;
/// Inertial gaps from here on are told, s.
const IMU_GAP: f64 = 0.1;
/// Gaps of GNSS from here on: shorter ones are every street's.
const GNSS_GAP: f64 = 10.0;
/// A topic that ends this much before another, s.
const EARLY: f64 = 5.0;
/// Beyond this share of lost messages there is something to mend.
const LOST: f64 = 0.02;

pub(super) fn find(source: &SourceFacts, origin: Time) -> Vec<Finding> {
    let mut found = Vec::new();
    let header = source
        .options
        .as_ref()
        .is_none_or(|o| o.time_source == TimeSource::Header);
    for (role, s) in &source.topics {
        found.extend(unusable(*role, s));
        if header {
            found.extend(clock(s, origin));
        }
        found.extend(order(*role, s));
        found.extend(lost(*role, s));
    }
    if header {
        found.extend(different_clocks(&source.topics));
    }
    found.extend(gaps(&source.topics, origin));
    found.extend(early(&source.topics, origin));
    found
}

/// Messages that hold nothing a navigator can use.
fn unusable(role: Role, s: &TopicStatistics) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut tell = |code, count: u64, what: &str, consequence: &str, remedy: &str| {
        if count > 0 {
            found.push(
                Finding::new(
                    code,
                    Severity::Note,
                    format!("{}: {count} of {} messages {what}", s.topic, s.count),
                    consequence,
                )
                .remedy(remedy),
            );
        }
    };
    let dropped = "they are dropped";
    tell(
        "no_fix",
        s.no_fix,
        "say that the receiver has no fix",
        dropped,
        "nothing, if the sky was obstructed there",
    );
    tell(
        "zero_position",
        s.zero_position,
        "have latitude and longitude zero",
        dropped,
        "mark them as no fix in the driver",
    );
    if let Some([latitude, longitude]) = s.first_no_place_deg {
        tell(
            "no_place",
            s.no_place,
            &format!(
                "are no place on Earth, the first latitude {latitude}, longitude {longitude}: {}",
                why_no_place(latitude, longitude)
            ),
            dropped,
            "mend them in the driver",
        );
    }
    tell(
        if role == Role::Imu {
            "imu_not_finite"
        } else {
            "not_finite"
        },
        s.not_finite - s.no_place,
        "have NaN or infinity in them",
        dropped,
        if role == Role::Imu {
            "check the driver"
        } else {
            "mark them as no fix in the driver"
        },
    );
    tell(
        "undecodable",
        s.undecodable,
        "are not what their type says",
        "a run ends at the first",
        "check that the recorder's message definitions match the publisher's",
    );
    if s.unstamped > 0 {
        let finding = Finding::new(
            "unstamped",
            Severity::Note,
            format!(
                "{}: {} of {} messages have no stamp (zero)",
                s.topic, s.unstamped, s.count
            ),
            "their log time is taken, which is later by the transport and not as even",
        );
        found.push(if s.unstamped == s.count {
            finding.flag("--time log").and(
                " to take all topics' times from the recorder, so that they agree; or let the driver stamp its messages",
            )
        } else {
            finding.remedy(
                "let the driver stamp its messages, or take all times from the recorder with `--time log`",
            )
        });
    }
    found
}

/// Stamps against the recorder's clock.
fn clock(s: &TopicStatistics, origin: Time) -> Option<Finding> {
    if let Some(step) = s.clock_step {
        return Some(
            Finding::new(
                "clock_step",
                Severity::Warning,
                format!(
                    "{}: at {:.1} s the stamps jump by {:+.2} s against the recorder's clock, and stay there",
                    s.topic,
                    step.at.since(origin),
                    step.size_s
                ),
                "before it or after it, this sensor is off by that much against the others",
            )
            .flag("--time log"),
        );
    }
    let drift = s.clock_drift?;
    Some(
        Finding::new(
            "clock_drift",
            Severity::Warning,
            format!(
                "{}: the stamps run {:.0} ppm {} than the recorder's clock, {:.2} s over the log",
                s.topic,
                1e6 * drift.rate.abs(),
                if drift.rate > 0.0 { "faster" } else { "slower" },
                drift.total_s.abs()
            ),
            "no constant offset brings this sensor together with the others",
        )
        .flag("--time log"),
    )
}

/// Stamps that do not go forward.
fn order(role: Role, s: &TopicStatistics) -> Vec<Finding> {
    let mut found = Vec::new();
    if s.backward_steps > 0 {
        found.push(
            Finding::new(
                "backward_steps",
                Severity::Note,
                format!(
                    "{}: {} of {} messages have an earlier stamp than the one before",
                    s.topic, s.backward_steps, s.count
                ),
                "within a second they are put into their place; beyond it a run ends there",
            )
            .remedy("check the driver's clock and the recorder's queue; `--time log` takes the recorder's"),
        );
    }
    // A receiver may well say the same twice; an inertial unit may not.
    if s.duplicates > 0 && role == Role::Imu {
        found.push(
            Finding::new(
                "duplicate_stamps",
                Severity::Note,
                format!(
                    "{}: {} of {} messages repeat the stamp before them",
                    s.topic, s.duplicates, s.count
                ),
                "the second of each pair is not used",
            )
            .remedy("record the topic once only, and check the driver's stamps"),
        );
    }
    found
}

/// Messages that are missing by ones and twos.
fn lost(role: Role, s: &TopicStatistics) -> Option<Finding> {
    let missing = s.missing as f64 / (s.count + s.missing) as f64;
    (role == Role::Imu && missing > LOST).then(|| {
        Finding::new(
            "imu_messages_lost",
            Severity::Note,
            format!(
                "{}: {} messages are missing between the others, {:.0} % at {:.0} Hz",
                s.topic,
                s.missing,
                100.0 * missing,
                s.rate_hz.unwrap_or_default()
            ),
            "motion between samples is lost there: attitude wanders faster",
        )
        .remedy("record with a larger queue for the IMU topic")
    })
}

/// Clocks of different topics, by the recorder's.
fn different_clocks(topics: &[(Role, TopicStatistics)]) -> Vec<Finding> {
    let against = |wanted: Role| {
        topics
            .iter()
            .find(|(role, s)| *role == wanted && s.clock_step.is_none())
            .and_then(|(_, s)| Some((s, s.header_minus_log_s?.median)))
    };
    let Some((imu, imu_offset)) = against(Role::Imu) else {
        return Vec::new();
    };
    [Role::GnssPosition, Role::GnssVelocity]
        .into_iter()
        .filter_map(against)
        .filter(|(_, offset)| (offset - imu_offset).abs() > DIFFERENT_CLOCKS)
        .map(|(s, offset)| {
            let apart = offset - imu_offset;
            let leap = if (apart.abs() - 18.0).abs() < 0.5 {
                ": GPS time is 18 s ahead of UTC"
            } else {
                ""
            };
            Finding::new(
                "different_clocks",
                Severity::Warning,
                format!(
                    "{} is stamped {:+.2} s and {} {:+.2} s against the recorder's clock: {:.2} s apart{leap}",
                    s.topic,
                    offset,
                    imu.topic,
                    imu_offset,
                    apart.abs()
                ),
                "the sensors would be put together at the wrong times, or not overlap at all",
            )
            .flag("--time log")
        })
        .collect()
}

/// Long holes.
fn gaps(topics: &[(Role, TopicStatistics)], origin: Time) -> Vec<Finding> {
    let mut found = Vec::new();
    let imu = topics.iter().find(|(role, _)| *role == Role::Imu);
    let span = |(from, to): &(Time, Time)| {
        format!(
            "{:.1}–{:.1} s ({:.2} s)",
            from.since(origin),
            to.since(origin),
            to.since(*from)
        )
    };
    let list = |gaps: &[(Time, Time)]| {
        let mut order = gaps.to_vec();
        order.sort_by_key(|(from, to)| from.0 - to.0);
        let shown: Vec<String> = order.iter().take(3).map(span).collect();
        let more = order.len().saturating_sub(3);
        let rest = if more > 0 {
            format!(" and {more} more")
        } else {
            String::new()
        };
        format!("{}{rest}", shown.join(", "))
    };
    let length = |gap: &(Time, Time)| gap.1.since(gap.0);
    let of_imu: Vec<(Time, Time)> = imu.map_or_else(Vec::new, |(_, s)| {
        s.gaps
            .iter()
            .copied()
            .filter(|g| length(g) > IMU_GAP)
            .collect()
    });
    // Every other topic silent as well: the recording itself stood still.
    let silent = |gap: &(Time, Time)| {
        topics.len() > 1
            && length(gap) > 1.0
            && topics.iter().all(|(_, s)| {
                s.gaps
                    .iter()
                    .any(|(a, b)| (*a).max(gap.0) < (*b).min(gap.1))
            })
    };
    let (all, alone): (Vec<_>, Vec<_>) = of_imu.into_iter().partition(silent);
    let [of_cars, of_others] = [VehicleKind::Car, VehicleKind::Any].map(longest_bridged);
    let bridged = |gaps: &[(Time, Time)]| {
        if gaps.iter().any(|g| length(g) > of_cars) {
            format!(
                "over more than {of_cars} s ({of_others} s of what is no car) the navigation starts anew; shorter gaps are bridged with widened sigmas"
            )
        } else {
            "bridged with widened sigmas".to_owned()
        }
    };
    if !all.is_empty() {
        found.push(
            Finding::new(
                "recording_gap",
                Severity::Warning,
                format!("no topic has messages in {}", list(&all)),
                bridged(&all),
            )
            .remedy("check the recorder's disk; nothing brings back what was not recorded"),
        );
    }
    if let Some((_, s)) = imu.filter(|_| !alone.is_empty()) {
        found.push(
            Finding::new(
                "imu_gaps",
                Severity::Warning,
                format!("{}: no messages in {}", s.topic, list(&alone)),
                bridged(&alone),
            )
            .remedy("record with a larger queue for the IMU topic"),
        );
    }
    if let Some((_, s)) = topics.iter().find(|(role, _)| *role == Role::GnssPosition) {
        let own: Vec<_> = s
            .gaps
            .iter()
            .copied()
            .filter(|g| length(g) > GNSS_GAP && !all.iter().any(|a| a.0 < g.1 && g.0 < a.1))
            .collect();
        if !own.is_empty() {
            found.push(
                Finding::new(
                    "gnss_gaps",
                    Severity::Note,
                    format!("{}: no messages in {}", s.topic, list(&own)),
                    "the solution drifts there, as its sigmas say",
                )
                .remedy("nothing, if the sky was obstructed there"),
            );
        }
    }
    found
}

/// Topics that end before the others.
fn early(topics: &[(Role, TopicStatistics)], origin: Time) -> Vec<Finding> {
    let end = topics.iter().filter_map(|(_, s)| s.last).max();
    let mut found = Vec::new();
    for (role, s) in topics {
        let (Some(end), Some(last), Some(interval)) = (end, s.last, s.interval_median_s) else {
            continue;
        };
        let missing = end.since(last);
        if missing > EARLY.max(20.0 * interval) {
            let consequence = match role {
                Role::Imu => "the solution ends there",
                Role::GnssPosition => "from there on the solution drifts, as its sigmas say",
                _ => "from there on positions alone hold the solution",
            };
            found.push(
                Finding::new(
                    "ends_early",
                    Severity::Warning,
                    format!(
                        "{} ends at {:.1} s, {missing:.1} s before the others",
                        s.topic,
                        last.since(origin)
                    ),
                    consequence,
                )
                .remedy("check whether its driver stopped"),
            );
        }
    }
    found
}

/// A level of the clock that changes once, from the least delays of each second.
///
/// `levels`: log time and stamp minus log time, s.
pub(crate) fn step_of(levels: &[(Time, f64)]) -> Option<(Time, f64)> {
    const LEAST: f64 = 0.2;
    const SIDE: usize = 3;
    if levels.len() < 2 * SIDE {
        return None;
    }
    // The split with the largest difference of the means, weighed as a change point is.
    let n = levels.len();
    let total: f64 = levels.iter().map(|l| l.1).sum();
    let (mut before, mut best) = (0.0, (0, 0.0));
    for (i, level) in levels.iter().enumerate().take(n - SIDE) {
        before += level.1;
        let k = (i + 1) as f64;
        let rest = n as f64 - k;
        let apart = before / k - (total - before) / rest;
        let score = apart * apart * k * rest;
        if i + 1 >= SIDE && score > best.1 {
            best = (i + 1, score);
        }
    }
    let (left, right) = levels.split_at(best.0);
    let spread = |side: &[(Time, f64)]| {
        let mut values: Vec<f64> = side.iter().map(|l| l.1).collect();
        let middle = quantile(&mut values, 0.5);
        (
            middle,
            quantile(&mut values, 0.95) - quantile(&mut values, 0.05),
        )
    };
    if left.is_empty() || right.is_empty() {
        return None;
    }
    let ((a, noise_a), (b, noise_b)) = (spread(left), spread(right));
    let size = b - a;
    (size.abs() > LEAST && noise_a.max(noise_b) < 0.4 * size.abs()).then(|| (right[0].0, size))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn levels(of: impl Fn(f64) -> f64) -> Vec<(Time, f64)> {
        (0..100)
            .map(|i| {
                let t = f64::from(i);
                (
                    Time::from_seconds(t),
                    -0.01 + 0.002 * (t * 1.7).sin() + of(t),
                )
            })
            .collect()
    }

    #[test]
    fn a_step_is_found_and_a_stall_or_a_drift_is_none() {
        let step = |t: f64| if t < 60.0 { 0.0 } else { 1.0 };
        let (at, size) = step_of(&levels(step)).unwrap();
        assert!((at.seconds() - 60.0).abs() < 1.5 && (size - 1.0).abs() < 0.01);
        let back = |t: f64| if t < 20.0 { 0.0 } else { -1.0 };
        assert!((step_of(&levels(back)).unwrap().1 + 1.0).abs() < 0.01);
        assert_eq!(step_of(&levels(|_| 0.0)), None);
        // The recorder was held up for five seconds.
        let stall = |t: f64| if (50.0..55.0).contains(&t) { -2.0 } else { 0.0 };
        assert_eq!(step_of(&levels(stall)), None);
        assert_eq!(step_of(&levels(|t| 0.01 * t)), None);
    }
}
