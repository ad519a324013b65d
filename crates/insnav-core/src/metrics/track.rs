//! A solution as a function of time: interpolation between its points.

use crate::attitude::{exp, log, skew};
use crate::earth::Geodetic;
use crate::time::Time;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// One instant of a solution. What a solution does not have is `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SolutionPoint {
    /// The instant.
    pub time: Time,
    /// Position.
    pub position: Option<Geodetic>,
    /// Velocity over ground, NED, m/s.
    pub velocity_n: Option<Vector3<f64>>,
    /// Rotation from body (forward-right-down) to NED.
    pub q_nb: Option<UnitQuaternion<f64>>,
    /// Turn rate of the body against n, resolved in b, rad/s.
    pub rate_b: Option<Vector3<f64>>,
    /// Covariance of the position, NED, m².
    pub position_covariance_n: Option<Matrix3<f64>>,
    /// Covariance of the velocity, NED, m²/s².
    pub velocity_covariance_n: Option<Matrix3<f64>>,
    /// Covariance of the attitude as a small rotation in NED, rad².
    pub attitude_covariance_n: Option<Matrix3<f64>>,
    /// Covariance of position (rows) with attitude (columns), m·rad.
    pub position_attitude_covariance_n: Option<Matrix3<f64>>,
    /// Whether the solution takes the body to stand.
    pub stationary: Option<bool>,
    /// Begin of the stop, where it stands.
    pub standing_since: Option<Time>,
}

impl SolutionPoint {
    /// The same instant at the point `lever_arm_b` (m, forward-right-down) from this one.
    ///
    /// The velocity gains ω × l where the turn rate is known. The covariance of the position follows the arm,
    /// J = [I, −(C l)×]; that of the velocity is kept, for what the arm adds to it is the gyro noise times the arm.
    #[must_use]
    pub fn moved(mut self, lever_arm_b: &Vector3<f64>) -> Self {
        let Some(q_nb) = self.q_nb else { return self };
        let arm_n = q_nb * lever_arm_b;
        self.position = self.position.map(|p| p.offset(&arm_n));
        if let (Some(v), Some(rate_b)) = (self.velocity_n, self.rate_b) {
            self.velocity_n = Some(v + q_nb * rate_b.cross(lever_arm_b));
        }
        if let (Some(p), Some(a), Some(pa)) = (
            self.position_covariance_n,
            self.attitude_covariance_n,
            self.position_attitude_covariance_n,
        ) {
            let s = skew(&arm_n);
            self.position_covariance_n =
                Some(p - pa * s.transpose() - s * pa.transpose() + s * a * s.transpose());
        }
        self
    }
}

/// A solution in order of time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    points: Vec<SolutionPoint>,
    longest_gap_s: f64,
}

impl Track {
    /// From points in any order; of several at one instant the first is kept.
    ///
    /// A hole is an interval longer than five times the median one (and than half a second): nothing is interpolated
    /// across it.
    pub fn new(mut points: Vec<SolutionPoint>) -> Self {
        points.sort_by_key(|p| p.time);
        points.dedup_by_key(|p| p.time);
        let mut steps: Vec<f64> = points
            .windows(2)
            .map(|w| w[1].time.since(w[0].time))
            .collect();
        steps.sort_by(f64::total_cmp);
        let median = steps.get(steps.len() / 2).copied().unwrap_or(0.0);
        Track {
            points,
            longest_gap_s: (5.0 * median).max(0.5),
        }
    }

    /// The points, in order of time.
    pub fn points(&self) -> &[SolutionPoint] {
        &self.points
    }

    /// The solution at an instant; `None` before its begin, after its end and inside a hole.
    ///
    /// Position by the cubic Hermite polynomial of both ends where both velocities are known, else on a straight line;
    /// attitude by turning at a constant rate; velocity, turn rate and covariances linearly.
    pub fn at(&self, time: Time) -> Option<SolutionPoint> {
        let after = self.points.partition_point(|p| p.time < time);
        let b = self.points.get(after)?;
        if b.time == time {
            return Some(*b);
        }
        let a = self.points.get(after.checked_sub(1)?)?;
        let dt = b.time.since(a.time);
        if dt > self.longest_gap_s {
            return None;
        }
        Some(between(a, b, time, dt))
    }
}

fn between(a: &SolutionPoint, b: &SolutionPoint, time: Time, dt: f64) -> SolutionPoint {
    let s = time.since(a.time) / dt;
    let mix = |x: Option<Matrix3<f64>>, y: Option<Matrix3<f64>>| Some(x? * (1.0 - s) + y? * s);
    let mix_vector =
        |x: Option<Vector3<f64>>, y: Option<Vector3<f64>>| Some(x? * (1.0 - s) + y? * s);
    let position = a.position.zip(b.position).map(|(pa, pb)| {
        let whole = pa.offset_to(&pb);
        let part = match a.velocity_n.zip(b.velocity_n) {
            Some((va, vb)) if va.iter().chain(vb.iter()).all(|v| v.is_finite()) => {
                let (s2, s3) = (s * s, s * s * s);
                whole * (3.0 * s2 - 2.0 * s3) + (va * (s3 - 2.0 * s2 + s) + vb * (s3 - s2)) * dt
            }
            _ => whole * s,
        };
        pa.offset(&part)
    });
    SolutionPoint {
        time,
        position,
        velocity_n: mix_vector(a.velocity_n, b.velocity_n),
        q_nb: a
            .q_nb
            .zip(b.q_nb)
            .map(|(qa, qb)| qa * exp(&(log(&(qa.inverse() * qb)) * s))),
        rate_b: mix_vector(a.rate_b, b.rate_b),
        position_covariance_n: mix(a.position_covariance_n, b.position_covariance_n),
        velocity_covariance_n: mix(a.velocity_covariance_n, b.velocity_covariance_n),
        attitude_covariance_n: mix(a.attitude_covariance_n, b.attitude_covariance_n),
        position_attitude_covariance_n: mix(
            a.position_attitude_covariance_n,
            b.position_attitude_covariance_n,
        ),
        stationary: if s < 0.5 { a.stationary } else { b.stationary },
        standing_since: if s < 0.5 {
            a.standing_since
        } else {
            b.standing_since
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Euler;
    use crate::earth::LocalFrame;

    const START: Geodetic = Geodetic {
        latitude: 0.8,
        longitude: 0.2,
        height: 100.0,
    };

    /// A car on a circle of 50 m at 10 m/s, exact.
    fn on_circle(t: f64) -> SolutionPoint {
        let (radius, speed) = (50.0, 10.0);
        let angle = speed / radius * t;
        let frame = LocalFrame::new(START);
        SolutionPoint {
            time: Time::from_seconds(t),
            position: Some(frame.to_geodetic(&Vector3::new(
                radius * angle.sin(),
                radius * (1.0 - angle.cos()),
                0.0,
            ))),
            velocity_n: Some(Vector3::new(speed * angle.cos(), speed * angle.sin(), 0.0)),
            q_nb: Some(
                Euler {
                    roll: 0.1,
                    pitch: 0.05,
                    heading: angle,
                }
                .to_quaternion(),
            ),
            rate_b: Some(Vector3::new(0.0, 0.0, speed / radius)),
            ..SolutionPoint::default()
        }
    }

    #[test]
    fn hermite_position_has_the_remainder_of_the_fourth_derivative() {
        let track = Track::new((0..=40).map(|i| on_circle(0.5 * f64::from(i))).collect());
        let mut worst = 0.0_f64;
        for i in 0..400 {
            let exact = on_circle(0.05 * f64::from(i));
            let got = track.at(exact.time).expect("inside the track");
            worst = worst.max(
                exact
                    .position
                    .unwrap()
                    .offset_to(&got.position.unwrap())
                    .norm(),
            );
        }
        // Remainder of cubic Hermite: h⁴/384 × |x⁗| = h⁴/384 × R ω⁴ = 0.5⁴/384 × 50 × 0.2⁴ = 1.3e-5 m; the flat-Earth
        // frame of the truth against radii of curvature adds d²/R_earth ≈ 1e-3 of a step's 5 m twice over: below 1e-5 m.
        assert!(worst < 2.5e-5, "{worst}");
        assert!(
            worst > 1e-6,
            "{worst}: a straight line or a copied truth would not show this"
        );
    }

    #[test]
    fn without_velocity_the_position_is_on_the_chord() {
        let strip = |mut p: SolutionPoint| {
            p.velocity_n = None;
            p
        };
        let track = Track::new(vec![strip(on_circle(0.0)), strip(on_circle(0.5))]);
        let middle = track.at(Time::from_seconds(0.25)).unwrap();
        let sagitta = on_circle(0.25)
            .position
            .unwrap()
            .offset_to(&middle.position.unwrap())
            .norm();
        // R (1 − cos(ω h/2)) = 50 × (1 − cos 0.05) = 0.0625 m.
        assert!((sagitta - 0.0625).abs() < 2e-4, "{sagitta}");
    }

    #[test]
    fn attitude_turns_at_constant_rate_across_north() {
        let point = |t: f64, heading_deg: f64| SolutionPoint {
            time: Time::from_seconds(t),
            q_nb: Some(Euler::from_degrees(0.0, 0.0, heading_deg).to_quaternion()),
            ..SolutionPoint::default()
        };
        let track = Track::new(vec![point(0.0, 350.0), point(0.1, 20.0)]);
        let q = track.at(Time::from_seconds(0.05)).unwrap().q_nb.unwrap();
        assert!((Euler::from_quaternion(&q).heading_deg() - 5.0).abs() < 1e-9);
    }

    #[test]
    fn nothing_outside_and_nothing_in_a_hole() {
        let mut points: Vec<_> = (0..100).map(|i| on_circle(0.02 * f64::from(i))).collect();
        points.extend((0..100).map(|i| on_circle(10.0 + 0.02 * f64::from(i))));
        let track = Track::new(points);
        assert!(track.at(Time::from_seconds(-0.001)).is_none());
        assert!(track.at(Time::from_seconds(5.0)).is_none());
        assert!(track.at(Time::from_seconds(11.99)).is_none());
        assert!(track.at(Time::from_seconds(11.98)).is_some());
        assert!(Track::new(Vec::new()).at(Time(0)).is_none());
    }

    #[test]
    fn the_lever_arm_carries_position_velocity_and_covariance() {
        let mut p = on_circle(3.0);
        p.q_nb = Some(Euler::from_degrees(0.0, 0.0, 90.0).to_quaternion());
        p.position_covariance_n = Some(Matrix3::identity() * 4.0);
        p.attitude_covariance_n = Some(Matrix3::identity() * 0.01);
        p.position_attitude_covariance_n = Some(Matrix3::zeros());
        let moved = p.moved(&Vector3::new(2.0, 0.0, 0.0));
        // Forward is east; turning right at 0.2 rad/s moves the nose south at 0.4 m/s.
        let d = p.position.unwrap().offset_to(&moved.position.unwrap());
        assert!((d - Vector3::new(0.0, 2.0, 0.0)).norm() < 1e-8, "{d}");
        let dv = moved.velocity_n.unwrap() - p.velocity_n.unwrap();
        assert!((dv - Vector3::new(-0.4, 0.0, 0.0)).norm() < 1e-12, "{dv}");
        // 2 m × 0.1 rad across and vertically, nothing along the arm.
        let c = moved.position_covariance_n.unwrap();
        assert!(
            (c - Matrix3::from_diagonal(&Vector3::new(4.04, 4.0, 4.04))).norm() < 1e-12,
            "{c}"
        );
    }
}
