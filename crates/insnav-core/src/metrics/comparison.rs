//! The whole comparison: classes of instants, mounting, course, stops.

use super::course::{Course, heading_minus_course};
use super::errors::{ErrorStatistics, PointError};
use super::mounting::mean_rotation;
use super::orientation::{
    OrientationErrors, OrientationPair, align, orientation_errors, to_enu_flu,
};
use super::reference::{AttitudeReference, ReferencePoint};
use super::standing::{DetectedStop, false_standing_s, stop_delays};
use super::track::{SolutionPoint, Track};
use crate::attitude::{Euler, wrap_angle};
use crate::stationary::STANDING_SPEED;
use crate::time::Time;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::Serialize;

/// What was kept from the navigator, to be compared with.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Withheld {
    /// Nothing.
    #[default]
    Nothing,
    /// All fixes inside intervals: the reference's points inside them are judged apart.
    Intervals(Vec<(Time, Time)>),
    /// Single fixes: they are a reference of their own, at the antenna.
    Fixes(Vec<ReferencePoint>),
}

/// How to compare.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CompareOptions {
    /// Zero of the seconds in the result.
    pub origin: Time,
    /// Leave out what is before.
    pub from: Option<Time>,
    /// Leave out what is after.
    pub to: Option<Time>,
    /// Antenna from the solution's point, forward-right-down, m.
    pub lever_arm_b: Vector3<f64>,
    /// Whether the reference is of the antenna (GNSS fixes) or of the solution's own point.
    pub reference_at_antenna: bool,
    /// How far the stamp of a reference velocity is behind its instant, s.
    pub velocity_lag: f64,
    /// Take the mean rotation between the axes of both out of the attitude errors.
    pub remove_mounting: bool,
    /// Take the constant rotation between the earth frames of both out of the orientation errors: of a reference that does not
    /// count from north.
    pub align_earth: bool,
    /// Compare heading with the reference's course.
    pub course: bool,
    /// What was withheld.
    pub withheld: Withheld,
}

/// The result, with the keys of the command's JSON.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Comparison {
    /// All reference instants inside the solution.
    pub all: ErrorStatistics,
    /// Those at which the reference stands.
    pub standing: ErrorStatistics,
    /// Those at which it moves.
    pub moving: ErrorStatistics,
    /// Those that were withheld from the navigator.
    pub withheld: ErrorStatistics,
    /// Reference instants outside the solution, not compared.
    pub outside: usize,
    /// Heading minus course, if asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub course: Option<Course>,
    /// The reference's stops.
    pub stops: Vec<DetectedStop>,
    /// Seconds of standing by the solution while the reference moves.
    pub false_standing_s: Option<f64>,
    /// Orientation errors, where the reference is one of quaternions.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub orientation: Option<OrientationErrors>,
    /// Angle between the earth frames, degrees, if it was taken out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub earth_rotation_deg: Option<f64>,
}

/// A constant attitude difference, whole or angle by angle.
#[derive(Clone, Copy)]
pub(super) enum Mounting {
    Rotation(UnitQuaternion<f64>),
    Angles(Vector3<f64>),
}

/// A reference instant with the solution there.
pub(super) struct Pair<'a> {
    pub(super) reference: &'a ReferencePoint,
    pub(super) at: SolutionPoint,
    pub(super) at_velocity: SolutionPoint,
}

impl Pair<'_> {
    pub(super) fn standing(&self) -> Option<bool> {
        // A reference of positions alone cannot tell: then the solution's own speed has to.
        self.reference
            .standing()
            .or_else(|| Some(self.at.velocity_n?.xy().norm() < STANDING_SPEED))
    }

    pub(super) fn error(&self, mounting: Option<Mounting>) -> PointError {
        let mut at = self.at;
        if let (Some(Mounting::Rotation(m)), Some(q)) = (mounting, at.q_nb) {
            at.q_nb = Some(q * m.inverse());
        }
        let mut e = PointError::new(&at, &self.at_velocity, self.reference);
        if let (Some(Mounting::Angles(m)), Some(a)) = (mounting, e.angles) {
            e.angles = Some((a - m).map(wrap_angle));
        }
        e
    }
}

impl CompareOptions {
    /// What is not left out.
    pub(super) fn inside(&self, reference: &[ReferencePoint]) -> Vec<ReferencePoint> {
        let inside = |r: &&ReferencePoint| {
            self.from.is_none_or(|from| r.time >= from) && self.to.is_none_or(|to| r.time <= to)
        };
        reference.iter().filter(inside).copied().collect()
    }

    /// The solution at the instants of the reference, and the mounting that is taken out, if any.
    pub(super) fn pairs<'a>(
        &self,
        track: &Track,
        reference: &'a [ReferencePoint],
    ) -> (Vec<Pair<'a>>, Option<Mounting>) {
        let arm = if self.reference_at_antenna {
            self.lever_arm_b
        } else {
            Vector3::zeros()
        };
        let pairs = pairs(track, reference, &arm, self.velocity_lag);
        let mounting = if self.remove_mounting {
            mounting_of(pairs.iter())
        } else {
            None
        };
        (pairs, mounting)
    }
}

/// Compare a solution with a reference (in order of time).
pub fn compare(
    track: &Track,
    reference: &[ReferencePoint],
    options: &CompareOptions,
) -> Comparison {
    let reference = options.inside(reference);
    let (pairs, mounting) = options.pairs(track, &reference);
    let statistics = |of: &mut dyn Iterator<Item = &Pair<'_>>| {
        let chosen: Vec<&Pair<'_>> = of.collect();
        let errors: Vec<PointError> = chosen.iter().map(|p| p.error(mounting)).collect();
        ErrorStatistics {
            mounting_deg: in_degrees(mounting_of(chosen.iter().copied())),
            ..ErrorStatistics::of(&errors)
        }
    };
    let withheld = match &options.withheld {
        Withheld::Nothing => ErrorStatistics::default(),
        Withheld::Intervals(intervals) => statistics(&mut pairs.iter().filter(|p| {
            intervals
                .iter()
                .any(|i| (i.0..=i.1).contains(&p.reference.time))
        })),
        Withheld::Fixes(fixes) => {
            let fixes = options.inside(fixes);
            statistics(
                &mut self::pairs(track, &fixes, &options.lever_arm_b, options.velocity_lag).iter(),
            )
        }
    };
    let mut oriented = orientation_pairs(&pairs);
    let earth = match oriented.is_empty() {
        true => None,
        false => align(&mut oriented, options.align_earth, options.remove_mounting),
    };
    Comparison {
        all: statistics(&mut pairs.iter()),
        standing: statistics(&mut pairs.iter().filter(|p| p.standing() == Some(true))),
        moving: statistics(&mut pairs.iter().filter(|p| p.standing() == Some(false))),
        withheld,
        outside: reference.len() - pairs.len(),
        course: options
            .course
            .then(|| heading_minus_course(track, &reference, options.velocity_lag)),
        stops: stop_delays(track, &reference, options.origin, options.velocity_lag),
        false_standing_s: false_standing_s(track, &reference, options.velocity_lag),
        orientation: (!oriented.is_empty()).then(|| orientation_errors(&oriented)),
        earth_rotation_deg: earth.map(f64::to_degrees),
    }
}

fn pairs<'a>(
    track: &Track,
    reference: &'a [ReferencePoint],
    arm: &Vector3<f64>,
    lag: f64,
) -> Vec<Pair<'a>> {
    reference
        .iter()
        .filter_map(|reference| {
            let at = track.at(reference.time)?.moved(arm);
            let at_velocity = if lag == 0.0 {
                at
            } else {
                // At the very begin the lagging velocity may lie before the solution: it is then not compared.
                track
                    .at(reference.time.plus(-lag))
                    .map(|p| p.moved(arm))
                    .unwrap_or_default()
            };
            Some(Pair {
                reference,
                at,
                at_velocity,
            })
        })
        .collect()
}

fn mounting_of<'a, 'b: 'a>(pairs: impl Iterator<Item = &'a Pair<'b>>) -> Option<Mounting> {
    let errors: Vec<PointError> = pairs.map(|p| p.error(None)).collect();
    let rotations: Vec<UnitQuaternion<f64>> = errors.iter().filter_map(|e| e.rotation).collect();
    if let Some(mean) = mean_rotation(&rotations) {
        return Some(Mounting::Rotation(mean));
    }
    let mean = |i: usize| {
        let angles: Vec<f64> = errors
            .iter()
            .filter_map(|e| Some(e.angles?[i]))
            .filter(|a| a.is_finite())
            .collect();
        if angles.is_empty() {
            return f64::NAN;
        }
        angles
            .iter()
            .map(|a| a.sin())
            .sum::<f64>()
            .atan2(angles.iter().map(|a| a.cos()).sum())
    };
    let mean = Vector3::new(mean(0), mean(1), mean(2));
    mean.iter()
        .any(|m| m.is_finite())
        .then_some(Mounting::Angles(mean))
}

fn in_degrees(mounting: Option<Mounting>) -> [Option<f64>; 3] {
    let angles = match mounting {
        None => return [None; 3],
        Some(Mounting::Angles(a)) => a,
        Some(Mounting::Rotation(q)) => {
            let e = Euler::from_quaternion(&q);
            Vector3::new(e.roll, e.pitch, e.heading)
        }
    };
    [0, 1, 2].map(|i| angles[i].is_finite().then(|| angles[i].to_degrees()))
}

/// Over the instants that the benchmark scores: moving, with a valid truth.
fn orientation_pairs(pairs: &[Pair<'_>]) -> Vec<OrientationPair> {
    // NED → ENU as a matrix, for the covariance.
    let enu_ned = Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0);
    pairs
        .iter()
        .filter(|p| p.reference.moving != Some(false))
        .filter_map(|p| {
            let AttitudeReference::Quaternion(truth) = p.reference.attitude else {
                return None;
            };
            let covariance =
                p.at.attitude_covariance_n
                    .map(|c| enu_ned * c * enu_ned.transpose());
            Some(OrientationPair {
                estimate: to_enu_flu(&p.at.q_nb?),
                truth: to_enu_flu(&truth),
                covariance,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::Geodetic;

    const START: Geodetic = Geodetic {
        latitude: 0.7,
        longitude: 2.0,
        height: 10.0,
    };

    /// North at 2 m/s from 10 s on, standing before; looking 30° with a unit mounted at (1, −6.8, 5.35)°.
    fn truth(t: f64) -> (Geodetic, Vector3<f64>, UnitQuaternion<f64>) {
        let moved = (t - 10.0).max(0.0) * 2.0;
        let speed = if t >= 10.0 { 2.0 } else { 0.0 };
        // The vehicle rolls, so that a mounting is no constant of the Euler angles.
        let attitude = Euler::from_degrees(20.0 * (0.3 * t).sin(), 5.0, 30.0 + 3.0 * t);
        (
            START.offset(&Vector3::new(moved, 0.0, 0.0)),
            Vector3::new(speed, 0.0, 0.0),
            attitude.to_quaternion(),
        )
    }

    fn track(arm_b: Vector3<f64>, mounting: UnitQuaternion<f64>) -> Track {
        Track::new(
            (0..=1000)
                .map(|i| {
                    let t = 0.02 * f64::from(i);
                    let (p, v, q) = truth(t);
                    let q_nb = q * mounting;
                    SolutionPoint {
                        time: Time::from_seconds(t),
                        position: Some(p.offset(&(q_nb * -arm_b))),
                        velocity_n: Some(v),
                        q_nb: Some(q_nb),
                        position_covariance_n: Some(Matrix3::identity()),
                        ..SolutionPoint::default()
                    }
                })
                .collect(),
        )
    }

    fn reference(error_n: impl Fn(f64) -> f64) -> Vec<ReferencePoint> {
        (0..=220)
            .map(|i| {
                let t = 0.1 * f64::from(i);
                let (p, v, q) = truth(t);
                let e = Euler::from_quaternion(&q);
                ReferencePoint {
                    time: Time::from_seconds(t),
                    position: Some(p.offset(&Vector3::new(error_n(t), 0.0, 0.0))),
                    velocity_n: Some(v),
                    attitude: AttitudeReference::Angles {
                        roll: e.roll,
                        pitch: e.pitch,
                        heading: e.heading,
                    },
                    ..ReferencePoint::default()
                }
            })
            .collect()
    }

    #[test]
    fn classes_share_the_instants() {
        let mounting = UnitQuaternion::identity();
        let options = CompareOptions {
            withheld: Withheld::Intervals(vec![(
                Time::from_seconds(4.95),
                Time::from_seconds(6.05),
            )]),
            ..CompareOptions::default()
        };
        let r = reference(|t| if t < 9.95 { 1.0 } else { 2.0 });
        let c = compare(&track(Vector3::zeros(), mounting), &r, &options);
        assert_eq!(
            (
                c.all.count,
                c.standing.count,
                c.moving.count,
                c.withheld.count,
                c.outside
            ),
            (201, 100, 101, 11, 20)
        );
        let near = |x: Option<f64>, y: f64| assert!((x.unwrap() - y).abs() < 1e-6, "{x:?} {y}");
        near(c.standing.horizontal_rms_m, 1.0);
        near(c.moving.horizontal_rms_m, 2.0);
        near(c.withheld.horizontal_rms_m, 1.0);
        near(c.all.horizontal_rms_m, ((100.0 + 404.0) / 201.0_f64).sqrt());
        near(c.all.nees.position, (100.0 + 404.0) / 201.0 / 3.0);
        assert_eq!(c.stops.len(), 1);
        assert_eq!((c.course, c.orientation), (None, None));
    }

    #[test]
    fn from_and_to_cut_the_reference() {
        let options = CompareOptions {
            from: Some(Time::from_seconds(2.0)),
            to: Some(Time::from_seconds(3.0)),
            ..CompareOptions::default()
        };
        let c = compare(
            &track(Vector3::zeros(), UnitQuaternion::identity()),
            &reference(|_| 0.0),
            &options,
        );
        assert_eq!(c.all.count, 11);
    }

    #[test]
    fn a_mounting_is_found_and_removed_as_a_rotation() {
        let mounting = Euler::from_degrees(1.0, -6.8, 5.35).to_quaternion();
        let track = track(Vector3::zeros(), mounting);
        let mut options = CompareOptions::default();
        let c = compare(&track, &reference(|_| 0.0), &options);
        for (got, want) in c.all.mounting_deg.iter().zip([1.0, -6.8, 5.35]) {
            assert!((got.unwrap() - want).abs() < 1e-6, "{got:?}");
        }
        assert!(c.all.pitch_rms_deg.unwrap() > 6.0);
        options.remove_mounting = true;
        let c = compare(&track, &reference(|_| 0.0), &options);
        assert!(c.all.pitch_rms_deg.unwrap() < 1e-6 && c.all.roll_rms_deg.unwrap() < 1e-6);
        assert!(
            (c.all.mounting_deg[1].unwrap() + 6.8).abs() < 1e-6,
            "still reported"
        );
    }

    #[test]
    fn a_heading_alone_has_a_mounting_too() {
        let mut r = reference(|_| 0.0);
        for p in &mut r {
            let AttitudeReference::Angles { heading, .. } = p.attitude else {
                unreachable!("built so above")
            };
            p.attitude = AttitudeReference::Angles {
                roll: f64::NAN,
                pitch: f64::NAN,
                heading: heading - 0.1,
            };
        }
        let options = CompareOptions {
            remove_mounting: true,
            ..CompareOptions::default()
        };
        let c = compare(
            &track(Vector3::zeros(), UnitQuaternion::identity()),
            &r,
            &options,
        );
        assert_eq!(c.all.mounting_deg[0], None);
        assert!((c.all.mounting_deg[2].unwrap() - 0.1_f64.to_degrees()).abs() < 1e-6);
        assert!(c.all.heading_rms_deg.unwrap() < 1e-6);
        assert_eq!(c.all.roll_rms_deg, None);
    }

    #[test]
    fn the_antenna_is_where_its_arm_says() {
        let arm = Vector3::new(1.0, 0.5, -0.8);
        let track = track(arm, UnitQuaternion::identity());
        let mut options = CompareOptions {
            lever_arm_b: arm,
            ..CompareOptions::default()
        };
        let without = compare(&track, &reference(|_| 0.0), &options)
            .all
            .horizontal_rms_m
            .unwrap();
        assert!(without > 0.5, "{without}");
        options.reference_at_antenna = true;
        let with = compare(&track, &reference(|_| 0.0), &options)
            .all
            .horizontal_rms_m
            .unwrap();
        assert!(with < 1e-4, "{with}");
        // Withheld fixes are always of the antenna.
        options.reference_at_antenna = false;
        options.withheld = Withheld::Fixes(reference(|_| 0.0));
        let fixes = compare(&track, &reference(|_| 0.0), &options).withheld;
        assert!(
            fixes.count == 201 && fixes.horizontal_rms_m.unwrap() < 1e-4,
            "{fixes:?}"
        );
    }

    #[test]
    fn a_lagging_velocity_is_judged_at_its_own_instant() {
        let lag = 0.5;
        let mut r = reference(|_| 0.0);
        for p in &mut r {
            p.velocity_n = Some(truth(p.time.seconds() - lag).1);
        }
        let mut options = CompareOptions::default();
        let track = track(Vector3::zeros(), UnitQuaternion::identity());
        assert!(
            compare(&track, &r, &options)
                .all
                .velocity_rms_m_per_s
                .unwrap()
                > 0.2
        );
        options.velocity_lag = lag;
        // The step at 10 s is one sample of 20 ms wide.
        assert!(
            compare(&track, &r, &options)
                .all
                .velocity_rms_m_per_s
                .unwrap()
                < 0.02
        );
    }

    #[test]
    fn quaternions_give_the_benchmark_keys() {
        let mut r = reference(|_| 0.0);
        for p in &mut r {
            let q = p.q_nb().expect("angles are whole");
            p.attitude = AttitudeReference::Quaternion(
                crate::attitude::exp(&Vector3::new(0.0, 0.0, 0.1)) * q,
            );
        }
        let c = compare(
            &track(Vector3::zeros(), UnitQuaternion::identity()),
            &r,
            &CompareOptions::default(),
        );
        let o = c.orientation.unwrap();
        assert!(
            (o.heading_rmse_deg.unwrap().to_radians() - 0.1).abs() < 1e-6,
            "{o:?}"
        );
        assert!(o.inclination_rmse_deg.unwrap() < 1e-5);
        let json = serde_json::to_value(&c).unwrap();
        assert!(json["total_rmse_deg"].is_number() && json["all"]["nees"]["position"].is_number());
        assert!(json.get("course").is_none());
    }
}
