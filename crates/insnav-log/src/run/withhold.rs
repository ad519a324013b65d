//! Fixes kept from the navigator, so that the solution can be judged by them.

use super::report::Warning;
use insnav_core::time::Time;
use std::str::FromStr;

/// Which fixes a run does not use. Positions and velocities of an epoch are withheld together: a velocity alone would carry
/// the solution through most of the gap.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Withhold {
    /// None.
    #[default]
    Nothing,
    /// All inside these intervals, seconds from the time origin, ends included: outages.
    Intervals(Vec<(f64, f64)>),
    /// One in so many epochs; the first is used.
    Every(usize),
}

impl FromStr for Withhold {
    type Err = String;

    /// `120:150,300:330` or `every:2`.
    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(n) = text.strip_prefix("every:") {
            return match n.parse() {
                Ok(n) if n >= 2 => Ok(Withhold::Every(n)),
                _ => Err(format!(
                    "every:{n}: a whole number of at least 2 is needed (every:2 withholds each second fix)"
                )),
            };
        }
        let interval = |part: &str| -> Option<(f64, f64)> {
            let (begin, end) = part.split_once(':')?;
            let (begin, end): (f64, f64) = (begin.trim().parse().ok()?, end.trim().parse().ok()?);
            (begin.is_finite() && end.is_finite() && begin < end).then_some((begin, end))
        };
        text.split(',')
            .map(|part| {
                interval(part).ok_or_else(|| format!("{part:?} is not begin:end in seconds, such as 120:150, with begin before end"))
            })
            .collect::<Result<_, _>>()
            .map(Withhold::Intervals)
    }
}

impl Withhold {
    /// A warning of intervals of which nothing lies in the inertial data, which last over `span`.
    pub(super) fn outside(
        &self,
        origin: Time,
        span: (Time, Time),
        more_follows: bool,
    ) -> Option<Warning> {
        let Withhold::Intervals(intervals) = self else {
            return None;
        };
        let (begin, end) = (span.0.since(origin), span.1.since(origin));
        let apart = |&&(a, b): &&(f64, f64)| b < begin || (a > end && !more_follows);
        let listed: Vec<String> = intervals
            .iter()
            .filter(apart)
            .map(|(a, b)| format!("{a}:{b}"))
            .collect();
        (!listed.is_empty()).then(|| Warning {
            code: "withhold_outside",
            message: format!(
                "nothing is withheld in {} s: the data last from {begin:.1} to {end:.1} s",
                listed.join(", ")
            ),
            remedy: "intervals count in seconds from the log's zero, which `insnav info` prints; check `--withhold`".into(),
        })
    }
}

impl std::fmt::Display for Withhold {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Withhold::Nothing => Ok(()),
            Withhold::Every(n) => write!(f, "every:{n}"),
            Withhold::Intervals(intervals) => {
                let parts: Vec<String> =
                    intervals.iter().map(|(a, b)| format!("{a}:{b}")).collect();
                f.write_str(&parts.join(","))
            }
        }
    }
}

/// Decides fix by fix.
#[derive(Clone, Debug)]
pub(super) struct Withholding {
    rule: Withhold,
    origin: Time,
    /// Stamps of all position fixes, in order.
    epochs: Vec<Time>,
    /// Half the usual distance of epochs, s: what is further from any epoch belongs to none.
    reach: f64,
}

impl Withholding {
    /// `epochs`: stamps of all position fixes, from which velocities learn where they belong.
    pub(super) fn new(rule: Withhold, origin: Time, mut epochs: Vec<Time>) -> Self {
        epochs.sort_unstable();
        epochs.dedup();
        let mut steps: Vec<f64> = epochs.windows(2).map(|w| w[1].since(w[0])).collect();
        steps.sort_by(f64::total_cmp);
        let reach = 0.5 * steps.get(steps.len() / 2).copied().unwrap_or(f64::INFINITY);
        Withholding {
            rule,
            origin,
            epochs,
            reach,
        }
    }

    /// Whether the fix with this stamp, position or velocity, is withheld.
    pub(super) fn takes(&self, time: Time) -> bool {
        match &self.rule {
            Withhold::Nothing => false,
            Withhold::Intervals(intervals) => {
                let t = time.since(self.origin);
                intervals
                    .iter()
                    .any(|(begin, end)| (*begin..=*end).contains(&t))
            }
            Withhold::Every(n) => self.epoch(time).is_some_and(|i| i % n == n - 1),
        }
    }

    /// Whether the velocity with this stamp is withheld, valid `lag` seconds before it.
    ///
    /// In an interval neither its stamp nor its instant may lie: a velocity stamped after an outage may be of its end. An
    /// epoch has one velocity, the one with its stamp: taking the neighbour's as well would leave none at all when the lag is
    /// about half the interval of the fixes.
    pub(super) fn takes_velocity(&self, time: Time, lag: f64) -> bool {
        let by_instant = matches!(self.rule, Withhold::Intervals(_)) && self.takes(time.plus(-lag));
        by_instant || self.takes(time)
    }

    /// Number of the epoch nearest to a stamp.
    fn epoch(&self, time: Time) -> Option<usize> {
        let after = self.epochs.partition_point(|&e| e < time);
        let distance = |i: usize| self.epochs.get(i).map(|e| (e.since(time).abs(), i));
        let (d, i) = [after.checked_sub(1).and_then(distance), distance(after)]
            .into_iter()
            .flatten()
            .min_by(|a, b| a.0.total_cmp(&b.0))?;
        (d <= self.reach).then_some(i)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(t: f64) -> Time {
        Time::from_seconds(t)
    }

    #[test]
    fn reads_what_it_writes_and_refuses_nonsense() {
        for text in ["120:150,300:330.5", "every:2", "-3:4"] {
            assert_eq!(text.parse::<Withhold>().unwrap().to_string(), text);
        }
        for text in ["", "every:1", "every:x", "150:120", "1:2,", "1:nan", "5"] {
            assert!(text.parse::<Withhold>().is_err(), "{text}");
        }
    }

    #[test]
    fn every_second_epoch_with_its_velocity() {
        let epochs: Vec<Time> = (0..10).map(|i| at(0.25 * f64::from(i))).collect();
        let w = Withholding::new(Withhold::Every(2), at(0.0), epochs.clone());
        let taken: Vec<bool> = epochs.iter().map(|&e| w.takes(e)).collect();
        assert_eq!(
            taken,
            [
                false, true, false, true, false, true, false, true, false, true
            ]
        );
        // A velocity stamped 20 ms beside its position, and one of an epoch without position.
        assert!(w.takes(at(0.27)) && !w.takes(at(0.48)) && !w.takes(at(9.0)));
    }

    #[test]
    fn intervals_count_from_the_origin() {
        let w = Withholding::new("2:3".parse().unwrap(), at(100.0), Vec::new());
        assert_eq!(
            [101.9, 102.0, 102.5, 103.0, 103.1].map(|t| w.takes(at(t))),
            [false, true, true, true, false]
        );
    }

    #[test]
    fn intervals_outside_the_data_are_told() {
        let told = |rule: &str, more_follows| {
            let rule: Withhold = rule.parse().unwrap();
            let span = (at(100.0), at(160.0));
            rule.outside(at(100.0), span, more_follows)
                .map(|w| w.message)
        };
        let message = told("10:20,1000:2000", false).expect("a warning");
        assert!(message.contains("in 1000:2000 s") && message.contains("0.0 to 60.0 s"));
        assert!(told("-20:-10", true).is_some());
        // What reaches into the data, or what the next part of a drive may have.
        for rule in ["50:70", "-5:5", "every:2"] {
            assert_eq!(told(rule, false), None, "{rule}");
        }
        assert_eq!(told("1000:2000", true), None);
    }

    #[test]
    fn a_lag_of_half_an_interval_leaves_every_second_velocity() {
        let epochs: Vec<Time> = (0..100).map(|i| at(0.25 * f64::from(i))).collect();
        let w = Withholding::new(Withhold::Every(2), at(0.0), epochs.clone());
        for lag in [0.0, 0.077, 0.125, 0.128, 0.24] {
            let taken = epochs.iter().filter(|&&e| w.takes_velocity(e, lag)).count();
            assert_eq!(taken, 50, "lag {lag}");
        }
    }

    #[test]
    fn an_outage_has_no_velocity_by_stamp_nor_by_instant() {
        let w = Withholding::new("2:3".parse().unwrap(), at(0.0), Vec::new());
        // Stamped before, inside, and after but valid inside; then valid after.
        let taken = [1.9, 2.05, 2.5, 3.05, 3.2].map(|t| w.takes_velocity(at(t), 0.128));
        assert_eq!(taken, [false, true, true, true, false]);
    }
}
