//! Scenarios: a drive, an inertial unit and a receiver as plain data, and some ready ones.

use super::drive::{Body, BodyRocking, Drive, Leg, Wave};
use super::gnss::{GnssModel, Span};
use super::imu::{ImuErrorModel, ImuModel, ImuOutput};
use super::noise::{Source, Stream};
use super::simulation::Simulation;
use crate::error::Result;
use crate::imu::ImuGrade;
use serde::{Deserialize, Serialize};

/// Everything that a simulation needs but its seed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Length in time, s; a drive that ends earlier ends it.
    pub duration_s: f64,
    /// Where it goes.
    pub drive: Drive,
    /// The inertial unit.
    pub imu: ImuModel,
    /// The receiver.
    #[serde(default)]
    pub gnss: GnssModel,
}

/// 2024-01-01T00:00:00Z: stamps of the size that real logs have.
pub(super) const START_S: f64 = 1_704_067_200.0;
/// Sensor rate of the ready scenarios, Hz.
const IMU_RATE_HZ: f64 = 200.0;

impl Scenario {
    /// Simulate it; every random number follows from the seed.
    ///
    /// # Errors
    /// [`crate::error::Error::Config`] names the first setting outside its range.
    pub fn simulate(&self, seed: u64) -> Result<Simulation> {
        Simulation::run(self, seed)
    }

    /// Standing on level ground with a heading (degrees).
    pub fn standing(duration_s: f64, heading_deg: f64) -> Self {
        let mut drive = start(heading_deg);
        drive.legs.push(Leg {
            duration_s,
            ..Leg::default()
        });
        Scenario::automotive(duration_s, drive)
    }

    /// A car in town and on fast roads, by turns: blocks with red lights and right-angle corners, then bends and hills at
    /// 80 to 120 km/h. Leaning, squatting and swaying as a car does. The first minute it stands.
    ///
    /// The inertial unit is of automotive grade, with GNSS position and velocity at 1 Hz; `imu.errors` and `gnss` may be
    /// changed before simulating. Always the same way, of which a shorter duration is the beginning.
    pub fn car_drive(duration_s: f64) -> Self {
        let mut drive = start(70.0);
        drive.body = Body::car();
        drive.legs = car_legs(duration_s, 60.0, &mut Source::new(0, Stream::Route));
        Scenario::automotive(duration_s, drive)
    }

    /// Twelve minutes in town and on a fast road with a consumer-grade unit and receiver: stops, two outages, some outliers.
    pub fn demo() -> Self {
        let mut scenario = Scenario::car_drive(720.0);
        scenario.drive.legs = car_legs(720.0, 30.0, &mut Source::new(1, Stream::Route));
        scenario.imu.rate_hz = 100.0;
        scenario.imu.errors = ImuErrorModel::from_noise(ImuGrade::Consumer.noise());
        scenario.gnss = GnssModel {
            position_rate_hz: 5.0,
            velocity_rate_hz: 5.0,
            lever_arm_b_m: [0.3, -0.4, -1.2],
            position_sigma_m: [0.5, 0.5, 1.0],
            position_colour_sigma_m: [1.0, 1.0, 2.0],
            position_colour_tau_s: 120.0,
            velocity_sigma_m_per_s: [0.1, 0.1, 0.2],
            outages: vec![
                Span {
                    begin_s: 300.0,
                    end_s: 330.0,
                },
                Span {
                    begin_s: 520.0,
                    end_s: 550.0,
                },
            ],
            outlier_probability: 0.005,
            latency_s: 0.1,
            ..GnssModel::default()
        };
        scenario
    }

    fn automotive(duration_s: f64, drive: Drive) -> Self {
        Scenario {
            duration_s,
            drive,
            imu: ImuModel {
                rate_hz: IMU_RATE_HZ,
                output: ImuOutput::Rates,
                errors: ImuErrorModel::from_noise(ImuGrade::Automotive.noise()),
            },
            gnss: GnssModel::default(),
        }
    }
}

fn start(heading_deg: f64) -> Drive {
    Drive {
        start_s: START_S,
        latitude_deg: 50.1,
        longitude_deg: 14.4,
        height_m: 250.0,
        heading_deg,
        speed_m_per_s: 0.0,
        legs: Vec::new(),
        body: Body::default(),
    }
}

impl Body {
    /// A passenger car: 3° of roll and 2° of pitch per g, sway of some tenths of a degree at body modes of 1 to 2.5 Hz.
    pub(super) fn car() -> Self {
        let wave = |amplitude_deg, frequency_hz, phase_deg| Wave {
            amplitude_deg,
            frequency_hz,
            phase_deg,
        };
        Body {
            tilt_deg: [0.0; 2],
            lean_deg_per_m_per_s2: 0.3,
            squat_deg_per_m_per_s2: 0.2,
            roll: vec![
                wave(0.4, 1.13, 20.0),
                wave(0.25, 1.71, 200.0),
                wave(0.15, 2.47, 110.0),
            ],
            pitch: vec![
                wave(0.35, 1.29, 300.0),
                wave(0.2, 1.93, 75.0),
                wave(0.1, 2.31, 160.0),
            ],
            sway_speed_m_per_s: 6.0,
            rocking: BodyRocking::default(),
        }
    }
}

/// Town and fast road by turns until `duration_s` is filled.
fn car_legs(duration_s: f64, standing_s: f64, route: &mut Source) -> Vec<Leg> {
    let mut way = Way::default();
    way.add(standing_s, 0.0, 0.0, 0.0);
    while way.length_s < duration_s {
        let town_ends = way.length_s + between(route, 400.0, 600.0);
        while way.length_s < town_ends {
            way.block(route);
        }
        let road_ends = way.length_s + between(route, 250.0, 500.0);
        way.add(18.0, 27.0, 0.0, 0.0);
        while way.length_s < road_ends {
            way.bend(route);
        }
        way.add(20.0, 8.0, 0.0, 0.0);
    }
    way.legs
}

/// A way that is made piece by piece.
#[derive(Default)]
pub(super) struct Way {
    pub(super) legs: Vec<Leg>,
    pub(super) length_s: f64,
}

impl Way {
    pub(super) fn add(
        &mut self,
        duration_s: f64,
        speed_m_per_s: f64,
        turn_deg: f64,
        slope_deg: f64,
    ) {
        let duration_s = hundredths(duration_s);
        self.legs.push(Leg {
            duration_s,
            speed_m_per_s,
            turn_deg,
            slope_deg,
        });
        self.length_s += duration_s;
    }

    /// One block of a town: off, along, then a corner or a red light.
    fn block(&mut self, route: &mut Source) {
        let speed = between(route, 10.0, 15.0);
        let slope = between(route, -3.0, 3.0);
        self.add(speed / between(route, 1.0, 1.4), speed, 0.0, slope);
        let sway = between(route, -8.0, 8.0);
        self.add(between(route, 8.0, 25.0), speed, sway, slope);
        let braking = between(route, 1.4, 1.8);
        if route.uniform() < 0.4 {
            self.add(speed / braking, 0.0, 0.0, 0.0);
            self.add(between(route, 10.0, 40.0), 0.0, 0.0, 0.0);
        } else {
            let corner = between(route, 4.0, 6.0);
            self.add((speed - corner) / braking, corner, 0.0, 0.0);
            let side = if route.uniform() < 0.5 { -1.0 } else { 1.0 };
            let turn = side * between(route, 80.0, 100.0);
            self.add(between(route, 5.0, 7.5), corner, turn, 0.0);
        }
    }

    /// One bend of a fast road, at a new speed and slope.
    pub(super) fn bend(&mut self, route: &mut Source) {
        let speed = between(route, 22.0, 34.0);
        let turn = between(route, -25.0, 25.0);
        let slope = between(route, -2.5, 2.5);
        self.add(between(route, 15.0, 35.0), speed, turn, slope);
    }
}

pub(super) fn between(route: &mut Source, low: f64, high: f64) -> f64 {
    hundredths(route.between(low, high))
}

/// Rounded, so that a route can be read when it is written as text.
fn hundredths(x: f64) -> f64 {
    (x * 100.0).round() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shorter_drive_is_the_beginning_of_a_longer() {
        let (short, long) = (Scenario::car_drive(600.0), Scenario::car_drive(1500.0));
        let n = short.drive.legs.len();
        assert!(n > 20 && n < long.drive.legs.len());
        assert_eq!(short.drive.legs, long.drive.legs[..n]);
        assert!(short.drive.legs.iter().map(|l| l.duration_s).sum::<f64>() >= 600.0);
    }

    #[test]
    fn scenarios_survive_a_round_trip_as_text() {
        let mut demo = Scenario::demo();
        // The JSON reader used here may miss the last digit of a long number; all others are short.
        demo.imu.errors.noise = None;
        let mut standing = Scenario::standing(5.0, 10.0);
        standing.imu.errors.noise = None;
        for scenario in [demo, standing] {
            let text = serde_json::to_string(&scenario).expect("plain data");
            assert_eq!(
                serde_json::from_str::<Scenario>(&text).expect("just written"),
                scenario
            );
        }
        let unknown = r#"{"duration_s": 1.0, "speed": 3.0}"#;
        assert!(serde_json::from_str::<Scenario>(unknown).is_err());
    }

    /// A passenger car stays below 0.5 g sideways, 0.4 g along, 130 km/h and 6° of slope.
    #[test]
    fn the_car_drives_like_a_car() {
        let scenario = Scenario::car_drive(3600.0);
        let trajectory = super::super::Trajectory::new(&scenario.drive).expect("valid");
        let (mut standing, mut way, mut fastest) = (0, 0.0, 0.0f64);
        for i in 0..36_000 {
            let k = trajectory.after(f64::from(i) * 0.1);
            let speed = k.nav.velocity_n.norm();
            standing += i32::from(speed == 0.0);
            way += speed * 0.1;
            fastest = fastest.max(speed);
            let f = k.specific_force_b;
            assert!(
                f.y.abs() < 4.9 && f.x.abs() < 4.9,
                "{f} at {}",
                f64::from(i) * 0.1
            );
            assert!(k.angular_rate_b.norm() < 1.2);
            assert!((k.nav.velocity_n.z / speed.max(1.0)).abs() < 0.11);
        }
        assert!(fastest > 28.0 && fastest < 36.0, "{fastest}");
        assert!(way > 30e3 && way < 80e3, "{way}");
        assert!(
            standing > 2000,
            "stops of more than 200 s together: {standing}"
        );
    }
}
