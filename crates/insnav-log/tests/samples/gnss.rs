//! GNSS messages: what is a fix, and what its covariance is worth.

use crate::recorder::{Recorder, T0};
use insnav_core::earth::Geodetic;
use insnav_core::sample::Sample;
use insnav_core::time::Time;
use insnav_log::ReadOptions;
use insnav_log::ros2::*;
use nalgebra::{Matrix3, Vector3};

#[test]
fn fixes_that_are_none_are_dropped_and_counted() {
    let mut recorder = Recorder::new();
    recorder.imu("/imu", T0, T0);
    recorder.fix(T0 + 1, |fix| fix.status = -1);
    recorder.fix(T0 + 2, |fix| fix.latitude_deg = f64::NAN);
    recorder.fix(T0 + 3, |fix| {
        (fix.latitude_deg, fix.longitude_deg) = (0.0, 0.0)
    });
    recorder.fix(T0 + 4, |fix| fix.latitude_deg = 91.0);
    recorder.fix(T0 + 5, |fix| {
        fix.status = -2; // Not set by the driver: no reason to drop.
        fix.position_covariance = [1.0; 9]; // Type "unknown": numbers without meaning.
    });
    recorder.fix(T0 + 6, |fix| {
        fix.position_covariance_type = CovarianceType::Known;
        fix.position_covariance = [4.0, 1.0, 2.0, 1.0, 9.0, 3.0, 2.0, 3.0, 16.0];
    });
    recorder.fix(T0 + 7, |fix| {
        fix.position_covariance_type = CovarianceType::DiagonalKnown
    }); // All zero: not known.
    let log = recorder
        .open(ReadOptions {
            geoid_height_m: 22.5,
            ..ReadOptions::default()
        })
        .unwrap();
    assert_eq!(log.first_fix().unwrap().unwrap().time, Time(T0 + 5));
    let mut samples = log.samples().unwrap();
    let all: Vec<Sample> = samples.by_ref().map(Result::unwrap).collect();
    let counts = samples.counts();
    assert_eq!(
        (
            counts.dropped_no_fix,
            counts.dropped_not_finite,
            counts.dropped_zero_position
        ),
        (1, 2, 1)
    );
    assert_eq!((counts.gnss_position, counts.imu), (3, 1));
    let [
        Sample::Imu(_),
        Sample::GnssPosition(a),
        Sample::GnssPosition(b),
        Sample::GnssPosition(c),
    ] = all.as_slice()
    else {
        panic!("{all:?}")
    };
    assert_eq!((a.covariance_n, c.covariance_n), (None, None));
    // ENU (ee, en, eu, nn, nu, uu) = (4, 1, 2, 9, 3, 16) in NED.
    assert_eq!(
        b.covariance_n,
        Some(Matrix3::new(
            9.0, 1.0, -3.0, 1.0, 4.0, -2.0, -3.0, -2.0, 16.0
        ))
    );
    assert_eq!(a.position, Geodetic::from_degrees(59.0, 18.0, 52.5));

    let statistics = log.statistics().unwrap();
    let fix = statistics.iter().find(|s| s.topic == "/fix").unwrap();
    assert_eq!(
        (fix.count, fix.no_fix, fix.not_finite, fix.zero_position),
        (7, 1, 2, 1)
    );
    let first = fix.first_no_place_deg;
    assert_eq!((fix.no_place, first), (1, Some([91.0, 18.0])));
}

#[test]
fn velocities_keep_what_was_measured() {
    let mut covariance = [0.0; 36];
    (covariance[0], covariance[7], covariance[14]) = (0.04, 0.09, 0.16);
    let mut absent = covariance;
    absent[0] = -1.0;
    let put = |linear: [f64; 3], covariance: [f64; 36]| {
        let mut recorder = Recorder::new();
        recorder.imu("/imu", T0, T0);
        let header = Header {
            stamp: Time(T0 + 1),
            frame_id: "gps",
        };
        let twist = Twist {
            linear: linear.into(),
            angular: Vector3::zeros(),
        };
        recorder.put(
            "/vel",
            T0 + 1,
            &TwistWithCovarianceStamped {
                header,
                twist,
                covariance,
            },
        );
        let log = recorder.open(ReadOptions::default()).unwrap();
        let mut samples = log.samples().unwrap();
        let velocity = samples.by_ref().find_map(|s| match s.unwrap() {
            Sample::GnssVelocity(v) => Some((v.velocity_n, v.covariance_n.map(|p| p.diagonal()))),
            _ => None,
        });
        velocity.ok_or(samples.counts().dropped_velocity_not_finite)
    };
    let ned = Vector3::new(0.09, 0.04, 0.16);
    assert_eq!(
        put([1.0, 2.0, 3.0], covariance),
        Ok((Vector3::new(2.0, 1.0, -3.0), Some(ned)))
    );
    assert_eq!(
        put([1.0, 2.0, 3.0], absent),
        Ok((Vector3::new(2.0, 1.0, -3.0), None))
    );
    assert_eq!(
        put([1.0, 2.0, 3.0], [0.0; 36]),
        Ok((Vector3::new(2.0, 1.0, -3.0), None))
    );
    // A vertical of exactly zero is a measurement only if it has a variance, or if nothing moves.
    assert_eq!(put([1.0, 2.0, 0.0], covariance).unwrap().0.z, 0.0);
    assert!(put([1.0, 2.0, 0.0], [0.0; 36]).unwrap().0.z.is_nan());
    assert_eq!(put([0.0, 0.0, 0.0], [0.0; 36]).unwrap().0, Vector3::zeros());
    let (horizontal, variances) = put([1.0, 2.0, f64::NAN], covariance).unwrap();
    assert!(horizontal.z.is_nan() && horizontal.xy() == nalgebra::Vector2::new(2.0, 1.0));
    assert_eq!(variances, Some(Vector3::new(0.09, 0.04, 0.09)));
    assert_eq!(put([f64::NAN, 2.0, 0.0], covariance), Err(1));
}
