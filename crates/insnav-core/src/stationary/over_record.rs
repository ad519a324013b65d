//! Stops of a record, found by the detector alone.

use super::{Belief, Evidence, LOOK_AHEAD, StopDetector, Witness};
use crate::sample::Sample;
use crate::solution::Motion;
use crate::time::Time;
use std::vec::Vec;

/// A stop that the detector has found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectedStop {
    /// Since when it agrees: before it was believed.
    pub begin: Time,
    /// Its end, or that of the record.
    pub end: Time,
    /// Who said so when it was believed.
    pub witness: Witness,
    /// What spoke for it then.
    pub evidence: Evidence,
    /// Whether it lasts to the end of the record.
    pub lasts: bool,
}

/// What a detector says of a record.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DetectedStops {
    /// In the order of time.
    pub stops: Vec<DetectedStop>,
    /// Stamps of the inertial samples.
    pub times: Vec<Time>,
    /// What spoke for standing at each, half a second ahead of what is believed then.
    pub evidence: Vec<Evidence>,
    /// Whether each lies in a stop.
    pub standing: Vec<bool>,
}

/// Shows a record to a detector, sample by sample in the order of time, with what is believed of rate and velocity throughout.
///
/// A navigator knows better what to believe, sample by sample, and finds more: this is for studies of the detector, and for records
/// without a solution.
pub fn detect_stops(
    detector: &mut StopDetector,
    samples: &[Sample],
    belief: &Belief,
) -> DetectedStops {
    let mut found = DetectedStops::default();
    let mut open: Option<DetectedStop> = None;
    let mut follow = |detector: &StopDetector, now: Time, stops: &mut Vec<DetectedStop>| match (
        detector.motion(),
        &mut open,
    ) {
        (Motion::Stationary { since }, None) => {
            let evidence = detector.evidence();
            open = Some(DetectedStop {
                begin: since,
                end: now,
                witness: evidence.witness,
                evidence,
                lasts: false,
            });
        }
        (Motion::Stationary { .. }, Some(stop)) => stop.end = now,
        (_, Some(stop)) => {
            stops.push(DetectedStop { end: now, ..*stop });
            open = None;
        }
        _ => {}
    };
    for sample in samples {
        detector.observe(sample, belief);
        if !sample.is_inertial() {
            continue;
        }
        let now = sample.time();
        found.times.push(now);
        found.evidence.push(detector.evidence());
        follow(detector, now.plus(-LOOK_AHEAD), &mut found.stops);
    }
    // What is believed of the last half second.
    if let Some(&last) = found.times.last() {
        let first = found
            .times
            .partition_point(|t| last.since(*t) >= LOOK_AHEAD);
        for &time in &found.times[first..] {
            detector.advance(time);
            follow(detector, time, &mut found.stops);
        }
        if let Some(stop) = open {
            found.stops.push(DetectedStop {
                end: last,
                lasts: true,
                ..stop
            });
        }
    }
    let mut at = 0;
    found.standing = found
        .times
        .iter()
        .map(|time| {
            while found
                .stops
                .get(at)
                .is_some_and(|s| s.end < *time || (s.end == *time && !s.lasts))
            {
                at += 1;
            }
            found.stops.get(at).is_some_and(|s| s.begin <= *time)
        })
        .collect();
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{DetectorKind, Intervals, StationaryConfig};
    use crate::imu::{ImuGrade, STANDARD_GRAVITY};
    use crate::sample::ImuSample;
    use crate::sim::{Source, Stream};
    use nalgebra::{Matrix3, Vector3};

    /// Rest to 20 s, shaking to 40 s, rest to 60 s; white noise of a consumer's unit.
    fn record() -> Vec<Sample> {
        let noise = ImuGrade::Consumer.noise();
        let mut source = Source::new(5, Stream::AccelWhite);
        let root = 10.0;
        (0..6000)
            .map(|i| {
                let t = 0.01 * f64::from(i);
                let shake = if (20.0..40.0).contains(&t) { 1.0 } else { 0.0 };
                let along = Vector3::new((9.0 * t).sin(), (7.0 * t).cos(), 0.3) * shake;
                Sample::Imu(ImuSample {
                    time: Time::from_seconds(t),
                    angular_rate_b: source.normal3() * (noise.gyro_white * root) + along * 0.1,
                    specific_force_b: Vector3::new(0.0, 0.0, -STANDARD_GRAVITY)
                        + source.normal3() * (noise.accel_white * root)
                        + along,
                })
            })
            .collect()
    }

    #[test]
    fn the_stops_of_a_record_and_nothing_else() {
        let noise = ImuGrade::Consumer.noise();
        let mut detector = StopDetector::new(&StationaryConfig::default(), &noise);
        detector.never_by_gnss(false);
        let belief = Belief {
            rate_b: Vector3::zeros(),
            rate_covariance_b: Matrix3::from_diagonal_element(noise.gyro_bias_sigma.powi(2)),
            velocity_n: Vector3::zeros(),
            velocity_covariance_n: Matrix3::from_diagonal_element(100.0),
        };
        let samples = record();
        let found = detect_stops(&mut detector, &samples, &belief);
        assert_eq!(found.stops.len(), 2, "{:?}", found.stops);
        let [first, second] =
            [found.stops[0], found.stops[1]].map(|s| [s.begin, s.end].map(Time::seconds));
        // Ends half a second early, so that no filter sees the start; begins where the shaking has left the low-pass.
        assert!(
            first[0] < 1.0 && (19.0..=20.0).contains(&first[1]),
            "{first:?}"
        );
        assert!(
            (40.0..42.5).contains(&second[0]) && second[1] == 59.99,
            "{second:?}"
        );
        assert!(found.stops[1].lasts && !found.stops[0].lasts);
        for (time, standing) in found.times.iter().zip(&found.standing) {
            let inside = found
                .stops
                .iter()
                .any(|s| s.begin <= *time && (*time < s.end || s.lasts && *time == s.end));
            assert_eq!(*standing, inside, "{time}");
        }
        assert_eq!(found.evidence.len(), samples.len());
    }

    #[test]
    fn a_declared_interval_is_exact() {
        let config = StationaryConfig {
            detector: DetectorKind::None,
            intervals_s: Intervals::new(&[[3.0, 7.0]]).expect("room"),
            ..StationaryConfig::default()
        };
        let noise = ImuGrade::Consumer.noise();
        let mut detector = StopDetector::new(&config, &noise);
        let belief = Belief {
            rate_b: Vector3::zeros(),
            rate_covariance_b: Matrix3::identity(),
            velocity_n: Vector3::zeros(),
            velocity_covariance_n: Matrix3::from_diagonal_element(100.0),
        };
        let found = detect_stops(&mut detector, &record()[..1200], &belief);
        assert_eq!(found.stops.len(), 1);
        let stop = found.stops[0];
        assert_eq!((stop.begin.seconds(), stop.end.seconds()), (3.0, 7.0));
        assert_eq!(stop.witness, Witness::Interval);
        let standing = found.standing.iter().filter(|s| **s).count();
        assert_eq!(standing, 400);
    }
}
