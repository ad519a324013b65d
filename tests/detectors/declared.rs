//! Stops that somebody declares.

use crate::drive::{Drive, configured};
use crate::unit::{knows_nothing, stands};
use insnav::config::{DetectorKind, Intervals, StationaryConfig};
use insnav::sample::{Sample, Speed, Standstill};
use insnav::stationary::{Belief, Notice, Witness};
use insnav::time::Time;
use nalgebra::Vector3;

fn declared_only(intervals: &[[f64; 2]]) -> Drive {
    configured(StationaryConfig {
        detector: DetectorKind::None,
        intervals_s: Intervals::new(intervals).expect("few"),
        ..StationaryConfig::default()
    })
}

fn topic(t: f64, standing: bool) -> Sample {
    Sample::Standstill(Standstill {
        time: Time::from_seconds(t),
        standing,
    })
}

#[test]
fn declared_intervals_hold_to_the_sample() {
    let mut drive = declared_only(&[[2.0, 5.0], [5.5, 7.25]]);
    drive.rest(10.0);
    let stops = drive.stops();
    // At the end itself it moves.
    let expected = [(2.0, 4.99), (5.5, 7.24)];
    assert_eq!(stops.len(), 2, "{stops:?}");
    for (found, expected) in stops.iter().zip(expected) {
        assert!(
            (found.0 - expected.0).abs() < 1e-6 && (found.1 - expected.1).abs() < 1e-6,
            "{stops:?}"
        );
    }
    assert_eq!(drive.detector.take_notice(), None);
}

#[test]
fn a_topic_holds_to_its_ends_and_flaps_are_told() {
    let mut drive = declared_only(&[]);
    drive
        .rest(3.0)
        .says(topic(3.0, true))
        .rest(2.0)
        .says(topic(5.0, false))
        .rest(0.2);
    drive
        .says(topic(5.2, true))
        .rest(0.3)
        .says(topic(5.5, false))
        .rest(3.0);
    let stops = drive.stops();
    assert_eq!(stops.len(), 1, "{stops:?}");
    // Half a second before what says "moving": the filter is there when it is heard.
    assert!(
        (stops[0].0 - 3.0).abs() < 1e-6 && (stops[0].1 - 4.5).abs() < 1e-6,
        "{stops:?}"
    );
    let time = Time::from_seconds(5.5);
    assert_eq!(drive.detector.take_notice(), Some(Notice::Flaps { time }));
    assert_eq!(drive.detector.take_notice(), None);
}

#[test]
fn a_declaration_that_the_filter_contradicts_is_told_and_not_used() {
    let moving = Belief {
        velocity_n: Vector3::new(8.0, 0.0, 0.0),
        ..stands()
    };
    let mut drive = declared_only(&[[2.0, 5.0]]);
    drive.belief = moving;
    drive.rest(8.0).says(topic(8.0, true)).rest(3.0);
    assert!(drive.stops().is_empty(), "{:?}", drive.stops());
    for begin in [2.0, 8.0] {
        let notice = drive.detector.take_notice();
        assert!(
            matches!(notice, Some(Notice::Contradicted { time, nis }) if time == Time::from_seconds(begin) && nis > 16.3),
            "{notice:?}"
        );
    }
    // The control: a filter that does not know its speed has nothing to say against it.
    let mut drive = declared_only(&[[2.0, 5.0]]);
    drive.belief = knows_nothing();
    drive.rest(8.0);
    assert_eq!(drive.stops().len(), 1);
}

/// A hole also separates two parts of a declared stop; and a topic that says "moving" forbids the detector nothing.
#[test]
fn declarations_and_the_detector_go_together() {
    let mut drive = declared_only(&[[2.0, 12.0]]);
    drive.rest(6.0);
    drive.t += 0.5;
    drive.rest(8.0);
    assert_eq!(drive.stops().len(), 2, "{:?}", drive.stops());
    let mut drive = configured(StationaryConfig::default());
    drive.says(topic(0.0, false)).rest(10.0);
    assert_eq!(drive.stops().len(), 1);
    assert_eq!(drive.detector.evidence().witness, Witness::Detector);
    // Wheels that turn overrule a topic.
    let mut drive = declared_only(&[]);
    drive.says(topic(0.0, true));
    for i in 0..50 {
        let time = Time::from_seconds(0.1 * f64::from(i));
        drive
            .says(Sample::Speed(Speed { time, speed: 1.0 }))
            .rest(0.1);
    }
    assert!(drive.stops().is_empty());
}
