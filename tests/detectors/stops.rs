//! Where the stops of a drive begin and end for the filter.

use crate::drive::{Drive, configured};
use crate::unit::knows_nothing;
use core::f64::consts::TAU;
use insnav::config::StationaryConfig;
use insnav::sample::{GnssVelocity, Sample, Speed};
use insnav::solution::Motion;
use insnav::stationary::StopDetector;
use insnav::time::Time;
use nalgebra::Vector3;

#[test]
fn a_start_is_seen_before_the_filter_comes_to_it() {
    // Gentle to brisk; a curb that tilts, a turn on the spot.
    for (force, rate) in [
        (Vector3::x() * 0.7, Vector3::zeros()),
        (Vector3::x() * 2.0, Vector3::zeros()),
        (Vector3::zeros(), Vector3::z() * 0.1),
    ] {
        let mut drive = Drive::new();
        drive.rest(20.0).go(1.0, force, rate);
        // By then the filter knows; a constant acceleration is no motion to an inertial unit alone.
        drive.belief.velocity_n = Vector3::new(2.0, 0.0, 0.0);
        drive.go(4.0, force, rate);
        let stops = drive.stops();
        assert_eq!(stops.len(), 1, "{stops:?}");
        println!("{force:?} {rate:?}: {stops:?}");
        assert!(stops[0].1 < 20.0, "the filter saw motion: {stops:?}");
        assert!(stops[0].1 > 19.0, "{stops:?}");
        let since = drive
            .told
            .iter()
            .find(|t| t.1 != Motion::Moving)
            .expect("a stop")
            .1;
        assert!(matches!(since, Motion::Stationary { since } if since < Time::from_seconds(1.5)));
    }
}

/// 3° in 15 s: too little for any variance, plain against the bias.
#[test]
fn a_slow_true_turn_ends_a_stop() {
    let mut drive = Drive::new();
    drive
        .rest(20.0)
        .go(15.0, Vector3::zeros(), Vector3::z() * 0.2f64.to_radians())
        .rest(10.0);
    let stops = drive.stops();
    println!("turn from 20 to 35 s: {stops:?}");
    let turning: f64 = stops
        .iter()
        .map(|(a, b)| (b.min(35.0) - a.max(20.0)).max(0.0))
        .sum();
    // It takes up to a window for the mean to show it.
    assert!(turning < 2.0, "{stops:?}");
    assert!(stops.last().is_some_and(|s| s.1 > 44.0), "{stops:?}");
}

/// A person gets in: 2°.
#[test]
fn a_tilt_in_mid_stop_ends_it_and_another_follows() {
    let mut drive = Drive::new();
    drive
        .rest(20.0)
        .go(20.0, Vector3::x() * 0.342, Vector3::zeros());
    let stops = drive.stops();
    println!("tilt at 20 s: {stops:?}");
    assert_eq!(stops.len(), 2, "{stops:?}");
    assert!(stops[0].1 < 20.05 && stops[1].0 < 24.0, "{stops:?}");
}

#[test]
fn a_hole_in_the_inertial_data_ends_a_stop() {
    let mut drive = Drive::new();
    drive.rest(20.0);
    drive.t += 0.3;
    drive.rest(10.0);
    let stops = drive.stops();
    assert_eq!(stops.len(), 2, "{stops:?}");
    assert!(stops[0].1 <= 20.0 && stops[1].0 > 21.0, "{stops:?}");
    // 0.1 s are none.
    let mut drive = Drive::new();
    drive.rest(20.0);
    drive.t += 0.1;
    drive.rest(10.0);
    assert_eq!(drive.stops().len(), 1);
}

#[test]
fn gnss_and_wheels_end_a_stop_and_an_outage_does_not() {
    let fix = |t: f64, north: f64| {
        Sample::GnssVelocity(GnssVelocity {
            time: Time::from_seconds(t),
            velocity_n: Vector3::new(north, 0.01 * t.sin(), 0.0),
            covariance_n: None,
        })
    };
    let wheels = |t: f64, speed: f64| {
        Sample::Speed(Speed {
            time: Time::from_seconds(t),
            speed,
        })
    };
    for by_wheels in [false, true] {
        let mut drive = Drive::new();
        let say = |t: f64, v: f64| if by_wheels { wheels(t, v) } else { fix(t, v) };
        for i in 0..10 {
            drive.says(say(f64::from(i), 0.0)).rest(1.0);
        }
        // The filter knows nothing any more, and nobody speaks.
        drive.belief = knows_nothing();
        drive.rest(20.0);
        assert_eq!(drive.stops().len(), 1, "{:?}", drive.stops());
        assert!(drive.stops()[0].1 > 29.0);
        // Smooth motion that no inertial unit sees.
        for i in 30..40 {
            drive.says(say(f64::from(i), 0.6)).rest(1.0);
        }
        let stops = drive.stops();
        println!("moves from 30 s: {stops:?}");
        assert_eq!(stops.len(), 1);
        assert!(stops[0].1 < 30.1, "{stops:?}");
    }
}

/// Stances of 0.3 s between swings: each is told where it is, although the look ahead is longer than a stance.
#[test]
fn stances_of_a_foot_are_told_where_they_are() {
    let config = StationaryConfig::default().for_vehicle(insnav::config::VehicleKind::Foot);
    let mut drive = configured(config);
    for _ in 0..20 {
        drive.rest(0.3);
        for k in 0..30 {
            let phase = TAU * f64::from(k) / 30.0;
            drive.go(
                0.01,
                Vector3::new(15.0 * phase.sin(), 0.0, 8.0 * phase.cos()),
                Vector3::y() * 5.0 * phase.cos(),
            );
        }
    }
    drive.rest(1.0);
    let stops = drive.stops();
    println!("{stops:.2?}");
    // All but the first, in which the sampling rate is still unknown.
    assert!(stops.len() >= 20, "{}", stops.len());
    for (begin, end) in &stops {
        let step = ((begin + 0.01) / 0.6).floor() * 0.6;
        // Rest ends 0.3 s into each cycle of 0.6 s; a swing's first sample is still slow.
        assert!(end - step < 0.33 || *begin > 11.9, "{begin} {end}");
        assert!(end - begin > 0.15 || *begin > 11.9, "{begin} {end}");
    }
}

/// Saved in mid-stop, read back, the same to the last bit.
#[test]
fn a_saved_detector_goes_on_bit_for_bit() {
    let mut drive = Drive::new();
    drive.rest(1.7);
    let bytes = |detector: &StopDetector| postcard::to_stdvec(detector).expect("plain data");
    let saved = bytes(&drive.detector);
    println!("{} bytes", saved.len());
    let again: StopDetector = postcard::from_bytes(&saved).expect("what was written");
    assert_eq!(bytes(&again), saved);
    let mut other = Drive {
        detector: again,
        told: Vec::new(),
        source: drive.source.clone(),
        ..Drive::new()
    };
    other.t = drive.t;
    drive.told.clear();
    drive.rest(10.0);
    other.rest(10.0);
    // The bytes, since a NaN equals nothing.
    assert_eq!(bytes(&drive.detector), bytes(&other.detector));
    assert_eq!(drive.told, other.told);
}
