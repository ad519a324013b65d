//! The errors of a comparison instant by instant, for who draws them.

use super::comparison::CompareOptions;
use super::errors::{PointError, squared};
use super::reference::ReferencePoint;
use super::track::Track;
use crate::time::Time;
use nalgebra::{Matrix3, Vector3};

/// Solution minus reference at one instant, and what is stated of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorInstant {
    /// The instant.
    pub time: Time,
    /// The errors.
    pub error: PointError,
    /// What the solution states of the position error, together with the reference's own sigma, NED, m.
    pub position_sigma_n: Option<Vector3<f64>>,
    /// Likewise of the velocity error, m/s.
    pub velocity_sigma_n: Option<Vector3<f64>>,
    /// What the solution states of the attitude error as a small rotation in NED, rad.
    pub attitude_sigma_n: Option<Vector3<f64>>,
    /// Whether the body stands, by the reference or else by the solution's speed.
    pub standing: Option<bool>,
}

/// The errors of which [`compare`](super::compare()) gives the statistics under `all`, in the order of the reference.
pub fn error_series(
    track: &Track,
    reference: &[ReferencePoint],
    options: &CompareOptions,
) -> Vec<ErrorInstant> {
    let reference = options.inside(reference);
    let (pairs, mounting) = options.pairs(track, &reference);
    let sigma = |p: Option<Matrix3<f64>>, own: Vector3<f64>| {
        p.map(|p| (p + squared(&own)).diagonal().map(f64::sqrt))
    };
    pairs
        .iter()
        .map(|pair| ErrorInstant {
            time: pair.reference.time,
            error: pair.error(mounting),
            position_sigma_n: sigma(
                pair.at.position_covariance_n,
                pair.reference.position_sigma_n,
            ),
            velocity_sigma_n: sigma(
                pair.at_velocity.velocity_covariance_n,
                pair.reference.velocity_sigma_n,
            ),
            attitude_sigma_n: sigma(pair.at.attitude_covariance_n, Vector3::zeros()),
            standing: pair.standing(),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{Euler, exp};
    use crate::earth::Geodetic;
    use crate::metrics::{AttitudeReference, SolutionPoint, compare};

    const AT: Geodetic = Geodetic {
        latitude: 0.8,
        longitude: 0.1,
        height: 20.0,
    };

    /// Errors that are known, in every second instant of a solution at 10 Hz.
    fn case() -> (Track, Vec<ReferencePoint>) {
        let error = |i: i32| Vector3::new(1.0, -2.0, 0.5) * f64::from(i % 5);
        let q = Euler::from_degrees(3.0, -4.0, 170.0).to_quaternion();
        let points = (0..=100).map(|i| SolutionPoint {
            time: Time::from_seconds(0.1 * f64::from(i)),
            position: Some(AT.offset(&error(i))),
            velocity_n: Some(Vector3::new(5.0, 0.0, 0.0) + error(i) * 0.1),
            q_nb: Some(exp(&(error(i) * 0.01)) * q),
            position_covariance_n: Some(Matrix3::identity() * 4.0),
            attitude_covariance_n: Some(Matrix3::identity() * 1e-4),
            ..SolutionPoint::default()
        });
        let reference = (0..=60).map(|i| ReferencePoint {
            time: Time::from_seconds(0.2 * f64::from(i)),
            position: Some(AT),
            position_sigma_n: Vector3::new(1.5, 0.0, 0.0),
            velocity_n: Some(Vector3::new(5.0, 0.0, 0.0)),
            attitude: AttitudeReference::Quaternion(q),
            ..ReferencePoint::default()
        });
        (Track::new(points.collect()), reference.collect())
    }

    #[test]
    fn errors_and_sigmas_are_those_put_in() {
        let (track, reference) = case();
        let series = error_series(&track, &reference, &CompareOptions::default());
        assert_eq!(series.len(), 51, "what is outside is left out");
        for (k, at) in series.iter().enumerate() {
            let error = Vector3::new(1.0, -2.0, 0.5) * (2 * k % 5) as f64;
            // Metres there and back by way of latitude and longitude: 1e-9 rad² of a metre.
            assert!((at.error.position_n.unwrap() - error).norm() < 1e-5);
            assert!((at.error.velocity_n.unwrap() - error * 0.1).norm() < 1e-12);
            assert!((at.error.rotation_n.unwrap() - error * 0.01).norm() < 1e-12);
            assert_eq!(at.position_sigma_n.unwrap(), Vector3::new(2.5, 2.0, 2.0));
            assert_eq!(at.velocity_sigma_n, None);
            assert!((at.attitude_sigma_n.unwrap() - Vector3::repeat(0.01)).norm() < 1e-15);
            assert_eq!(at.standing, Some(false));
            let nees = at.error.nees();
            let by_hand = (error.x.powi(2) / 6.25 + error.yz().norm_squared() / 4.0) / 3.0;
            assert!((nees.position.unwrap() - by_hand).abs() < 1e-5 * (1.0 + by_hand));
            assert_eq!(nees.velocity, None);
        }
    }

    #[test]
    fn the_statistics_are_those_of_the_series() {
        let (track, reference) = case();
        let options = CompareOptions {
            from: Some(Time::from_seconds(1.0)),
            to: Some(Time::from_seconds(7.1)),
            remove_mounting: true,
            ..CompareOptions::default()
        };
        let series = error_series(&track, &reference, &options);
        let all = compare(&track, &reference, &options).all;
        assert_eq!(all.count, series.len());
        assert_eq!(series[0].time, Time::from_seconds(1.0));
        let mean =
            |of: fn(&ErrorInstant) -> f64| series.iter().map(of).sum::<f64>() / series.len() as f64;
        let near = |a: Option<f64>, b: f64| assert!((a.unwrap() - b).abs() < 1e-9, "{a:?} {b}");
        near(
            all.horizontal_rms_m,
            mean(|e| e.error.position_n.unwrap().xy().norm_squared()).sqrt(),
        );
        near(
            all.nees.position,
            mean(|e| e.error.nees().position.unwrap()),
        );
        near(
            all.nees.attitude,
            mean(|e| e.error.nees().attitude.unwrap()),
        );
        // With the mounting in, the attitude errors are others.
        let plain = CompareOptions {
            remove_mounting: false,
            ..options
        };
        let with = error_series(&track, &reference, &plain);
        assert!(
            (with[2].error.rotation_n.unwrap() - series[2].error.rotation_n.unwrap()).norm() > 1e-3
        );
    }
}
