//! One entry for one stop: somebody who gets in, or a door, breaks what the filter holds, but the vehicle has not moved.
//!
//! The filter lets go of a stop at the first sign of motion, as it must, and holds the next piece some seconds later. What a
//! user calls a stop lasts on where whoever measures the speed, receiver or wheels, has said all the time in between that the
//! vehicle stands, and the heading is the same on both sides.

use super::report::StopReport;
use insnav_core::stationary::StopEnd;
use insnav_core::time::Time;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// A voice that is silent for longer says nothing about the time between, s.
const SILENCE: f64 = 1.0;
/// What turns by more between two pieces has moved, degrees: a robot may turn on the spot.
pub(super) const TURNED_DEG: f64 = 0.5;
/// Stretches that are kept: those since the last stop are asked for.
const KEPT: usize = 64;

/// When receiver or wheels have said without a break that the vehicle stands.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct SlowStretches {
    stretches: VecDeque<(Time, Time)>,
    /// Whether the last one may go on.
    open: bool,
}

impl SlowStretches {
    /// A measured speed, m/s; above `limit` nobody stands.
    pub(super) fn hear(&mut self, time: Time, speed: f64, limit: f64) {
        if speed >= limit || !speed.is_finite() {
            self.open = false;
            return;
        }
        match self.stretches.back_mut() {
            Some((_, end)) if self.open && time.since(*end) <= SILENCE => *end = time.max(*end),
            _ => {
                if self.stretches.len() >= KEPT {
                    self.stretches.pop_front();
                }
                self.stretches.push_back((time, time));
            }
        }
        self.open = true;
    }

    fn cover(&self, from: Time, to: Time) -> bool {
        let covers = |(begin, end): &(Time, Time)| *begin <= from && to <= *end;
        self.stretches.iter().any(covers)
    }
}

/// Put a stop into the list; as one more piece of the last where it is that. `origin` is the zero of the reports' seconds.
pub(super) fn put(
    stops: &mut Vec<StopReport>,
    next: StopReport,
    slow: &SlowStretches,
    origin: Time,
) {
    match stops.last_mut() {
        Some(last) if goes_on(last, &next, slow, origin) => last.join(&next),
        _ => stops.push(next),
    }
}

fn goes_on(last: &StopReport, next: &StopReport, slow: &SlowStretches, origin: Time) -> bool {
    last.ended_by == StopEnd::Motion
        && last.evidence.witness == next.evidence.witness
        && last.turn_until_deg(next).abs() < TURNED_DEG
        && slow.cover(origin.plus(last.end_s), origin.plus(next.begin_s))
}

#[cfg(test)]
mod tests {
    use super::*;
    use insnav_core::config::StationaryMode;
    use insnav_core::stationary::{Evidence, StopRecord, Witness};
    use nalgebra::Vector3;

    const LIMIT: f64 = 0.25;

    fn stop(begin: f64, end: f64, heading_deg: [f64; 2]) -> StopReport {
        let deg = f64::to_radians;
        let at = Time::from_seconds;
        let record = StopRecord {
            begin: at(begin),
            held_from: at(begin + 2.0),
            end: at(end),
            ended_by: StopEnd::Motion,
            mode: StationaryMode::Static,
            evidence: Evidence {
                witness: Witness::Detector,
                ..Evidence::default()
            },
            heading_before: deg(heading_deg[0]),
            sigma_heading_before: deg(0.5),
            heading_at_entry: deg(0.01),
            heading_growth: deg(0.02),
            heading_corrections: deg(heading_deg[1] - heading_deg[0] - 0.03),
            heading_after: deg(heading_deg[1]),
            sigma_heading_after: deg(0.4),
            gyro_bias: Vector3::repeat(begin * 1e-6),
            sigma_gyro_bias: Vector3::repeat(1e-6),
            gyro_step: Vector3::zeros(),
            gyro_repeats: [false; 3],
        };
        StopReport::new(&record, at(0.0))
    }

    /// Five speeds a second.
    fn heard(speed: impl Fn(f64) -> Option<f64>) -> SlowStretches {
        let mut slow = SlowStretches::default();
        for i in 0..500 {
            let t = 0.2 * f64::from(i);
            if let Some(speed) = speed(t) {
                slow.hear(Time::from_seconds(t), speed, LIMIT);
            }
        }
        slow
    }

    fn listed(stops: &[StopReport], slow: &SlowStretches) -> Vec<StopReport> {
        let mut list = Vec::new();
        for stop in stops {
            put(&mut list, *stop, slow, Time::from_seconds(0.0));
        }
        list
    }

    #[test]
    fn pieces_between_which_the_vehicle_stood_are_one_stop_whose_sums_close() {
        let pieces = [
            stop(10.0, 20.0, [359.9, 0.1]),
            stop(20.5, 25.0, [0.15, 0.2]),
            stop(26.0, 40.0, [0.2, 0.3]),
        ];
        let list = listed(&pieces, &heard(|t| Some(if t > 9.0 { 0.1 } else { 5.0 })));
        let [one] = &list[..] else {
            panic!("one stop: {list:#?}");
        };
        assert_eq!(
            (one.begin_s, one.held_from_s, one.end_s),
            (10.0, 12.0, 40.0)
        );
        assert_eq!(one.pieces, 3);
        assert!((one.heading_change_deg() - 0.4).abs() < 1e-9);
        let sum = one.heading_at_entry_deg + one.heading_growth_deg + one.heading_corrections_deg;
        assert!(
            (sum + one.heading_between_deg - 0.4).abs() < 1e-9,
            "{one:#?}"
        );
        assert!((one.heading_between_deg - 0.05).abs() < 1e-9, "{one:#?}");
        assert!((one.heading_growth_deg - 0.06).abs() < 1e-9, "{one:#?}");
        assert_eq!(one.gyro_bias_deg_per_hour, pieces[2].gyro_bias_deg_per_hour);
    }

    #[test]
    fn two_stops_stay_two() {
        let two = [stop(10.0, 20.0, [5.0; 2]), stop(23.0, 30.0, [5.0; 2])];
        let count = |slow: &SlowStretches| listed(&two, slow).len();
        assert_eq!(count(&heard(|_| Some(0.0))), 1);
        let crept = heard(|t| Some(if (21.0..22.0).contains(&t) { 0.4 } else { 0.0 }));
        assert_eq!(count(&crept), 2, "it crept on");
        let silent = heard(|t| (!(20.5..22.0).contains(&t)).then_some(0.0));
        assert_eq!(count(&silent), 2, "nobody knows");
        assert_eq!(count(&SlowStretches::default()), 2, "nobody ever says");
        let turned = [two[0], stop(23.0, 30.0, [6.0; 2])];
        assert_eq!(listed(&turned, &heard(|_| Some(0.0))).len(), 2);
        let mut gap = two;
        gap[0].ended_by = StopEnd::Gap;
        assert_eq!(listed(&gap, &heard(|_| Some(0.0))).len(), 2);
    }
}
