//! Stops: intervals in which a body is said to stand, and how a solution's stops agree with a reference's.

use super::reference::ReferencePoint;
use super::track::Track;
use crate::stationary::STANDING_SPEED;
use crate::time::Time;
use serde::{Deserialize, Serialize};

/// A stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stop {
    /// First instant of standing.
    pub begin: Time,
    /// Last instant of standing.
    pub end: Time,
}

/// A stop of a reference, and when the solution saw it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DetectedStop {
    /// Begin in the reference, s from the time origin.
    pub reference_begin_s: f64,
    /// How much later the solution said so; `None` if it never did.
    pub delay_s: Option<f64>,
    /// When the stop began by what the solution then said, s from the time origin; it is sure of a stop only after a while.
    pub reported_begin_s: Option<f64>,
}

/// Finds stops in a stream of horizontal speeds: at least two seconds below 0.1 m/s, with interruptions of up to a second
/// overlooked, since a standing receiver's speed crosses any such limit now and then.
#[derive(Clone, Debug, Default)]
pub struct StopFinder {
    open: Option<Stop>,
    stops: Vec<Stop>,
}

const LEAST_DURATION: f64 = 2.0;
const LONGEST_INTERRUPTION: f64 = 1.0;

impl StopFinder {
    /// The speed at an instant, m/s.
    pub fn push_speed(&mut self, time: Time, horizontal_speed: f64) {
        self.push(time, horizontal_speed < STANDING_SPEED);
    }

    /// Whether the body stands at an instant.
    pub fn push(&mut self, time: Time, standing: bool) {
        if let Some(stop) = &mut self.open {
            if time.since(stop.end) > LONGEST_INTERRUPTION {
                let stop = *stop;
                self.close(stop);
                self.open = None;
            } else if standing {
                stop.end = time;
            }
        }
        if standing && self.open.is_none() {
            self.open = Some(Stop {
                begin: time,
                end: time,
            });
        }
    }

    fn close(&mut self, stop: Stop) {
        if stop.end.since(stop.begin) >= LEAST_DURATION {
            self.stops.push(stop);
        }
    }

    /// The stops, in order of time.
    pub fn finish(mut self) -> Vec<Stop> {
        if let Some(stop) = self.open.take() {
            self.close(stop);
        }
        self.stops
    }
}

/// The stops of a reference, each with the delay of the solution's first standing instant in it, from its begin or from that
/// of the solution if it is later. `lag` (s) is how far the stamp of a reference velocity is behind its instant.
pub fn stop_delays(
    track: &Track,
    reference: &[ReferencePoint],
    origin: Time,
    lag: f64,
) -> Vec<DetectedStop> {
    let mut finder = StopFinder::default();
    for r in reference {
        if let Some(standing) = r.standing() {
            finder.push(r.time.plus(-lag), standing);
        }
    }
    let points = track.points();
    let begin = points.first().map_or(Time(i64::MIN), |p| p.time);
    finder
        .finish()
        .into_iter()
        .map(|stop| {
            let from = points.partition_point(|p| p.time < stop.begin);
            let seen = points[from..]
                .iter()
                .take_while(|p| p.time <= stop.end)
                .find(|p| p.stationary == Some(true));
            DetectedStop {
                reference_begin_s: stop.begin.since(origin),
                delay_s: seen.map(|p| p.time.since(stop.begin.max(begin))),
                reported_begin_s: seen
                    .and_then(|p| p.standing_since)
                    .map(|since| since.since(origin)),
            }
        })
        .collect()
}

/// Seconds for which the solution says "standing" while the reference moves; `None` when either never says.
/// `lag` as in [`stop_delays`].
pub fn false_standing_s(track: &Track, reference: &[ReferencePoint], lag: f64) -> Option<f64> {
    let mut total = None;
    for pair in reference.windows(2) {
        let dt = pair[1].time.since(pair[0].time);
        let (Some(standing), Some(at)) = (pair[0].standing(), track.at(pair[0].time.plus(-lag)))
        else {
            continue;
        };
        let Some(said) = at.stationary else { continue };
        // A hole in the reference says nothing about the time inside it.
        let wrong = if said && !standing {
            dt.min(LONGEST_INTERRUPTION)
        } else {
            0.0
        };
        total = Some(total.unwrap_or(0.0) + wrong);
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::SolutionPoint;

    fn at(seconds: f64) -> Time {
        Time::from_seconds(seconds)
    }

    /// 10 Hz: standing 10–20 s (with a flicker at 15 s), a pause of 1.5 s at 30 s, moving otherwise, until 40 s.
    fn speeds() -> impl Iterator<Item = (Time, f64)> {
        (0..=400).map(|i| {
            let standing = (100..=200).contains(&i) && i != 150 || (300..=315).contains(&i);
            (at(0.1 * f64::from(i)), if standing { 0.02 } else { 3.0 })
        })
    }

    fn reference() -> Vec<ReferencePoint> {
        speeds()
            .map(|(time, speed)| ReferencePoint {
                time,
                velocity_n: Some(nalgebra::Vector3::new(speed, 0.0, 0.0)),
                ..ReferencePoint::default()
            })
            .collect()
    }

    #[test]
    fn one_stop_and_neither_flicker_nor_pause() {
        let mut finder = StopFinder::default();
        speeds().for_each(|(t, v)| finder.push_speed(t, v));
        assert_eq!(
            finder.finish(),
            [Stop {
                begin: at(10.0),
                end: at(20.0)
            }]
        );
    }

    #[test]
    fn a_stop_at_the_end_counts() {
        let mut finder = StopFinder::default();
        (0..30).for_each(|i| finder.push_speed(at(0.1 * f64::from(i)), 0.0));
        assert_eq!(
            finder.finish(),
            [Stop {
                begin: at(0.0),
                end: at(2.9)
            }]
        );
    }

    #[test]
    fn delay_and_false_standing() {
        let track = Track::new(
            (0..=4000)
                .map(|i| {
                    let t = 0.01 * f64::from(i);
                    let stationary = Some((11.0..=22.0).contains(&t));
                    SolutionPoint {
                        time: at(t),
                        stationary,
                        standing_since: (stationary == Some(true)).then(|| at(10.25)),
                        ..SolutionPoint::default()
                    }
                })
                .collect(),
        );
        let stops = stop_delays(&track, &reference(), at(5.0), 0.0);
        assert_eq!(stops.len(), 1);
        assert!((stops[0].reference_begin_s - 5.0).abs() < 1e-9);
        assert!((stops[0].delay_s.unwrap() - 1.0).abs() < 1e-9);
        assert!((stops[0].reported_begin_s.unwrap() - 5.25).abs() < 1e-9);
        let late = stop_delays(&track, &reference(), at(5.0), 0.4);
        assert!((late[0].reference_begin_s - 4.6).abs() < 1e-9, "{late:?}");
        assert!((late[0].delay_s.unwrap() - 1.4).abs() < 1e-9, "{late:?}");
        // 20.1 to 22.0 s in steps of 0.1 s, and the flicker at 15 s.
        let wrong = false_standing_s(&track, &reference(), 0.0).unwrap();
        assert!((wrong - 2.1).abs() < 1e-6, "{wrong}");
        assert_eq!(
            false_standing_s(&Track::new(Vec::new()), &reference(), 0.0),
            None
        );
    }
}
