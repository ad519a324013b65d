//! The drive that \[Lobusov14\] means: two positions to align in, then an hour with a stop every five minutes, and no receiver.

use super::drive::{Body, BodyRocking, Drive, Leg, Wave};
use super::gnss::{GnssModel, Span};
use super::imu::{ImuErrorModel, ImuModel, ImuOutput};
use super::noise::{Source, Stream};
use super::scenario::{START_S, Scenario, Way, between};
use crate::imu::{ImuNoise, STANDARD_GRAVITY};
use std::vec::Vec;

/// Each of the two positions that the drive begins with, s.
const ALIGNING: f64 = 300.0;
/// The turn in place between them, s and degrees.
const TURN: (f64, f64) = (60.0, 180.0);
/// Pulling away, and coming to rest at the end of a leg, s.
const BRAKING: f64 = 12.0;

/// A drive with stops to correct an inertial unit at, as settings of a [`Scenario`].
///
/// Standing, a turn by 180° in place, standing again, then legs of car driving that each end in a stop.
///
/// ```
/// use insnav_core::sim::NavigationDrive;
/// let drive = NavigationDrive::default();
/// let scenario = drive.scenario();
/// assert_eq!(scenario.duration_s, 660.0 + 9.0 * 400.0);
/// assert_eq!(drive.stops().len(), 2 + 9);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavigationDrive {
    /// Legs, each with its stop.
    pub legs: u32,
    /// Length of a leg, s: at least 60.
    pub leg_s: f64,
    /// Length of the stop after it, s.
    pub stop_s: f64,
    /// Which way: the same number gives the same way, whatever the seed of the noise.
    pub route: u64,
    /// Whether the body rocks: tones of 0.01° to 0.1° about all axes, the unit a metre from where they are about.
    pub rocking: bool,
    /// Samples per second.
    pub rate_hz: f64,
    /// Errors of the unit.
    pub errors: ImuErrorModel,
}

impl Default for NavigationDrive {
    /// Nine legs of 300 s with stops of 100 s, without rocking, at 100 Hz, with [`NavigationDrive::errors`].
    fn default() -> Self {
        NavigationDrive {
            legs: 9,
            leg_s: 300.0,
            stop_s: 100.0,
            route: 0,
            rocking: false,
            rate_hz: 100.0,
            errors: Self::errors(None),
        }
    }
}

impl NavigationDrive {
    /// A navigation-grade unit: 0.001 °/√h, 5 µg/√Hz, and biases of 0.02 °/h and 50 µg: drawn once for each seed with these
    /// standard deviations, or, with a correlation time in s, wandering with them.
    pub fn errors(wander_s: Option<f64>) -> ImuErrorModel {
        let tau = wander_s.unwrap_or(f64::INFINITY);
        ImuErrorModel::from_noise(ImuNoise {
            gyro_white: 0.001f64.to_radians() / 60.0,
            accel_white: 5e-6 * STANDARD_GRAVITY,
            gyro_bias_sigma: 0.02f64.to_radians() / 3600.0,
            accel_bias_sigma: 50e-6 * STANDARD_GRAVITY,
            gyro_bias_tau: tau,
            accel_bias_tau: tau,
        })
    }

    /// As increments at latitude 60°, without a receiver.
    pub fn scenario(&self) -> Scenario {
        let mut route = Source::new(self.route, Stream::Route);
        let mut legs = Vec::new();
        let mut stand = |duration_s: f64, turn_deg: f64| {
            legs.push(Leg {
                duration_s,
                turn_deg,
                ..Leg::default()
            });
        };
        stand(ALIGNING, 0.0);
        stand(TURN.0, TURN.1);
        stand(ALIGNING, 0.0);
        for _ in 0..self.legs {
            legs.extend(self.leg(&mut route));
            legs.push(Leg {
                duration_s: self.stop_s,
                ..Leg::default()
            });
        }
        Scenario {
            duration_s: self.first_leg_s() + f64::from(self.legs) * (self.leg_s + self.stop_s),
            drive: Drive {
                start_s: START_S,
                latitude_deg: 60.0,
                longitude_deg: 30.0,
                height_m: 100.0,
                heading_deg: 45.0,
                speed_m_per_s: 0.0,
                legs,
                body: Body {
                    rocking: self.rocks(),
                    ..Body::car()
                },
            },
            imu: ImuModel {
                rate_hz: self.rate_hz,
                output: ImuOutput::Increments,
                errors: self.errors,
            },
            gnss: GnssModel {
                position_rate_hz: 0.0,
                velocity_rate_hz: 0.0,
                ..GnssModel::default()
            },
        }
    }

    /// When it stands, s after the start: the two positions of the alignment, then the stop after each leg.
    pub fn stops(&self) -> Vec<Span> {
        let first = self.first_leg_s();
        let span = |begin_s: f64, length: f64| Span {
            begin_s,
            end_s: begin_s + length,
        };
        let mut stops = std::vec![span(0.0, ALIGNING), span(first - ALIGNING, ALIGNING)];
        stops.extend((0..self.legs).map(|leg| {
            let begin = first + f64::from(leg) * (self.leg_s + self.stop_s) + self.leg_s;
            span(begin, self.stop_s)
        }));
        stops
    }

    fn first_leg_s(&self) -> f64 {
        2.0 * ALIGNING + TURN.0
    }

    /// From rest to rest: away, bends and hills at changing speed, to rest.
    fn leg(&self, route: &mut Source) -> Vec<Leg> {
        let mut way = Way::default();
        way.add(BRAKING, between(route, 10.0, 15.0), 0.0, 0.0);
        // A bend takes 15 s to 35 s; what is left is the last.
        while way.length_s < self.leg_s - BRAKING - 50.0 {
            way.bend(route);
        }
        let (speed, turn) = (between(route, 10.0, 14.0), between(route, -60.0, 60.0));
        way.add(self.leg_s - BRAKING - way.length_s, speed, turn, 0.0);
        // To the hundredth of a second, so that stops begin where they are said to.
        way.add(self.leg_s - way.length_s, 0.0, 0.0, 0.0);
        way.legs
    }

    fn rocks(&self) -> BodyRocking {
        if !self.rocking {
            return BodyRocking::default();
        }
        let wave = |amplitude_deg, frequency_hz, phase_deg| Wave {
            amplitude_deg,
            frequency_hz,
            phase_deg,
        };
        BodyRocking {
            roll: std::vec![
                wave(0.1, 0.31, 20.0),
                wave(0.03, 0.83, 130.0),
                wave(0.01, 1.9, 250.0)
            ],
            pitch: std::vec![wave(0.06, 0.23, 80.0), wave(0.02, 1.1, 310.0)],
            yaw: std::vec![wave(0.01, 0.17, 200.0)],
            lever_b_m: [0.5, 0.5, -1.0],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::Trajectory;

    /// It stands where it says, moves like a car elsewhere, and nothing jumps where a stop begins or ends.
    #[test]
    fn it_stands_where_it_says_it_stands() {
        for rocking in [false, true] {
            let drive = NavigationDrive {
                rocking,
                ..NavigationDrive::default()
            };
            let scenario = drive.scenario();
            let trajectory = Trajectory::new(&scenario.drive).expect("valid");
            assert!((trajectory.duration() - scenario.duration_s).abs() < 1e-6);
            let stops = drive.stops();
            let stands = |t: f64| stops.iter().any(|s| t >= s.begin_s && t <= s.end_s);
            // 0.06° at 0.23 Hz and so on, a metre away: 0.2° × 2π × 0.5 Hz × 1.2 m at most.
            let swing = if rocking { 0.02 } else { 1e-12 };
            let (mut way, mut fastest) = (0.0, 0f64);
            let dt = 0.02;
            for i in 1..=(scenario.duration_s / dt) as u32 {
                let t = f64::from(i) * dt;
                let k = trajectory.after(t);
                let speed = k.nav.velocity_n.norm();
                let turning = (ALIGNING..ALIGNING + TURN.0).contains(&t);
                if stands(t) {
                    assert!(speed <= swing, "{t}: {speed}");
                } else if !turning {
                    way += speed * dt;
                    fastest = fastest.max(speed);
                }
            }
            for edge in stops.iter().flat_map(|s| [s.begin_s, s.end_s]) {
                let [before, after] = [edge - 1e-6, edge + 1e-6].map(|t| trajectory.after(t));
                let force = (before.specific_force_b - after.specific_force_b).norm();
                let rate = (before.angular_rate_b - after.angular_rate_b).norm();
                // Rocking has jerks of 0.5 m/s³ and changes its rates by 0.1 rad/s².
                assert!(force < 2e-6 && rate < 1e-6, "{edge}: {force} {rate}");
            }
            assert!(way > 30e3 && fastest < 36.0, "{way} {fastest}");
            let turned = trajectory.after(360.0).nav.q_nb.euler_angles().2
                - trajectory.after(300.0).nav.q_nb.euler_angles().2;
            let turned = turned.to_degrees().rem_euclid(360.0);
            assert!((turned - 180.0).abs() < 0.05, "{turned}");
        }
    }

    #[test]
    fn seeds_draw_their_biases_and_a_wander_changes_them() {
        let biases = |wander: Option<f64>, seed| {
            let drive = NavigationDrive {
                legs: 1,
                rate_hz: 1.0,
                errors: NavigationDrive::errors(wander),
                ..NavigationDrive::default()
            };
            let simulation = drive.scenario().simulate(seed).expect("valid");
            [10.0, 900.0].map(|t| {
                let at = simulation.trajectory.start().plus(t);
                simulation.truth_at(at).imu_errors.gyro_bias
            })
        };
        let [begin, end] = biases(None, 1);
        assert_eq!(begin, end);
        assert!(begin.norm() > 1e-9 && begin.norm() < 5e-7, "{begin}");
        assert_ne!(biases(None, 2)[0], begin);
        let [begin, end] = biases(Some(3600.0), 1);
        assert_ne!(begin, end);
    }
}
