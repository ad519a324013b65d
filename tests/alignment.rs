//! The start of a run: attitude and heading at the first sample, from standing data or in motion, with honest sigmas.

use insnav::alignment::{Alignment, HeadingSource};
use insnav::attitude::log;
use insnav::config::{Config, VehicleKind};
use insnav::error::Error;
use insnav::imu::ImuGrade;
use insnav::navigator::Navigator;
use insnav::sample::{ImuSample, Sample};
use insnav::sim::{Drive, Leg, Scenario, Simulation};
use insnav::solution::{Event, Sink};
use nalgebra::Vector3;

struct Start(Option<Alignment>);

impl Sink for Start {
    fn wants_epoch(&mut self, _: insnav::time::Time) -> bool {
        false
    }
    fn event(&mut self, event: &Event) {
        if let Event::Started(alignment) = event {
            self.0 = Some(*alignment);
        }
    }
}

fn start(samples: &[Sample], config: &Config) -> Result<Alignment, Error> {
    let mut navigator = Navigator::new(config, ImuGrade::Consumer.noise())?;
    let mut sink = Start(None);
    for sample in samples {
        navigator.step(sample, &mut sink)?;
    }
    navigator.finish(&mut sink)?;
    Ok(sink.0.expect("a run that finished has started"))
}

/// Attitude error at the start over its sigma, by axis (rotation about north, east, down).
fn normalised(alignment: &Alignment, simulation: &Simulation) -> Vector3<f64> {
    let truth = simulation.truth_at(alignment.nav.time).nav;
    let error = log(&(truth.q_nb * alignment.nav.q_nb.inverse()));
    error.component_div(&alignment.sigma.attitude)
}

/// A drive that begins with a speed and a first leg, then goes straight.
fn moving(speed: f64, first: Leg) -> Scenario {
    let mut scenario = Scenario::car_drive(60.0);
    let straight = Leg {
        duration_s: 60.0,
        speed_m_per_s: first.speed_m_per_s,
        ..Leg::default()
    };
    scenario.drive = Drive {
        speed_m_per_s: speed,
        heading_deg: 123.0,
        legs: vec![first, straight],
        ..scenario.drive
    };
    scenario.imu.errors = insnav::sim::ImuErrorModel::from_noise(ImuGrade::Consumer.noise());
    scenario
}

fn from_standstill() -> Scenario {
    let mut scenario = Scenario::car_drive(120.0);
    scenario.imu.errors = insnav::sim::ImuErrorModel::from_noise(ImuGrade::Consumer.noise());
    scenario
}

/// Runs 20 seeds and holds the root mean square of each normalised component below 1.5: with 20 draws of a unit normal it is
/// below 1.27 in 99 % of cases, and a start whose sigma covers a mounting error that the simulation lacks stays well below.
/// Also says that sigmas are no wider than `largest` degrees, so that the bound means something.
fn check_starts(scenario: &Scenario, source: HeadingSource, largest_deg: [f64; 2]) {
    let seeds = 20;
    let mut squares = Vector3::zeros();
    for seed in 0..seeds {
        let simulation = scenario.simulate(seed).unwrap();
        let alignment = start(&simulation.samples, &Config::default()).unwrap();
        assert_eq!(alignment.heading_source, source);
        let first = simulation.samples.iter().find(|s| s.is_inertial()).unwrap();
        assert_eq!(
            alignment.nav.time,
            first.time(),
            "the run starts at the first sample"
        );
        let error = normalised(&alignment, &simulation);
        squares += error.component_mul(&error);
        let sigma = alignment.sigma.attitude.map(f64::to_degrees);
        assert!(
            sigma.x.max(sigma.y) < largest_deg[0] && sigma.z < largest_deg[1],
            "{sigma}"
        );
    }
    let rms = (squares / seeds as f64).map(f64::sqrt);
    assert!(rms.max() < 1.5, "{rms}");
}

#[test]
fn standing_then_driving_off() {
    check_starts(
        &from_standstill(),
        HeadingSource::CourseVelocity,
        [1.5, 8.0],
    );
}

#[test]
fn standing_then_driving_off_with_positions_alone() {
    let mut scenario = from_standstill();
    scenario.gnss.velocity_rate_hz = 0.0;
    check_starts(&scenario, HeadingSource::CoursePosition, [1.5, 12.0]);
}

/// One fix in a hundred is off by 50 m or 5 m/s in some direction, while standing too: no course.
#[test]
fn outliers_are_no_course() {
    let mut scenario = from_standstill();
    scenario.duration_s = 80.0;
    scenario.gnss.outlier_probability = 0.01;
    scenario.gnss.position_rate_hz = 5.0;
    scenario.gnss.velocity_rate_hz = 5.0;
    for (velocity_rate_hz, source) in [
        (5.0, HeadingSource::CourseVelocity),
        (0.0, HeadingSource::CoursePosition),
    ] {
        scenario.gnss.velocity_rate_hz = velocity_rate_hz;
        for seed in 0..20 {
            let simulation = scenario.simulate(seed).unwrap();
            let alignment = start(&simulation.samples, &Config::default()).unwrap();
            assert_eq!(alignment.heading_source, source);
            // The tilt suffers, as an outlier also ends what is taken for standing; the heading must not.
            let error = normalised(&alignment, &simulation).z;
            assert!(error.abs() < 3.0, "seed {seed}, {source:?}: {error} sigmas");
        }
    }
}

#[test]
fn starting_at_speed_and_braking() {
    let brake = Leg {
        duration_s: 8.0,
        speed_m_per_s: 8.0,
        ..Leg::default()
    };
    check_starts(
        &moving(20.0, brake),
        HeadingSource::CourseVelocity,
        [4.5, 8.0],
    );
}

#[test]
fn starting_in_a_bend_with_positions_alone() {
    let bend = Leg {
        duration_s: 15.0,
        speed_m_per_s: 12.0,
        turn_deg: 60.0,
        ..Leg::default()
    };
    let mut scenario = moving(12.0, bend);
    scenario.gnss.velocity_rate_hz = 0.0;
    check_starts(&scenario, HeadingSource::CoursePosition, [4.5, 12.0]);
}

/// The same drive seen by a unit that looks backward: for it, the vehicle reverses.
fn turned_round(samples: &[Sample]) -> Vec<Sample> {
    let turn = |v: Vector3<f64>| Vector3::new(-v.x, -v.y, v.z);
    let turned = |s: &Sample| match s {
        Sample::Imu(s) => Sample::Imu(ImuSample {
            angular_rate_b: turn(s.angular_rate_b),
            specific_force_b: turn(s.specific_force_b),
            ..*s
        }),
        other => *other,
    };
    samples.iter().map(turned).collect()
}

#[test]
fn a_vehicle_that_backs_out_is_not_turned_round() {
    // Out of a parking place: 40 s standing, then up to 3 m/s within 6 s.
    let mut scenario = from_standstill();
    let leg = |duration_s, speed_m_per_s| Leg {
        duration_s,
        speed_m_per_s,
        ..Leg::default()
    };
    scenario.drive.legs = vec![leg(40.0, 0.0), leg(6.0, 3.0), leg(10.0, 3.0), leg(4.0, 0.0)];
    scenario.gnss.velocity_rate_hz = 5.0;
    scenario.gnss.position_rate_hz = 5.0;
    let mut right = 0;
    for seed in 0..10 {
        let simulation = scenario.simulate(seed).unwrap();
        let forward = start(&simulation.samples, &Config::default()).unwrap();
        assert!(
            !forward.reversing,
            "seed {seed}: no false alarm driving forward"
        );
        let backward = start(&turned_round(&simulation.samples), &Config::default()).unwrap();
        let turn = (backward.euler().heading - forward.euler().heading).to_degrees();
        if backward.reversing {
            right += 1;
            assert!((turn.abs() - 180.0).abs() < 10.0, "{turn}");
        }
    }
    assert!(right >= 9, "found in {right} of 10");
}

#[test]
fn a_heading_that_is_given_is_taken() {
    let simulation = from_standstill().simulate(3).unwrap();
    let mut config = Config::default();
    config.alignment.heading_deg = Some(70.0);
    config.alignment.heading_sigma_deg = Some(2.0);
    let alignment = start(&simulation.samples, &config).unwrap();
    assert_eq!(alignment.heading_source, HeadingSource::Given);
    assert!((alignment.euler().heading_deg() - 70.0).abs() < 1e-9);
    assert!(
        (alignment.sigma.attitude.z.to_degrees() - 2.0).abs() < 0.5,
        "gyro drift adds little"
    );
}

#[test]
fn without_a_course_the_heading_is_declared_unknown() {
    let standing = Scenario::standing(30.0, 45.0).simulate(1).unwrap();
    let alignment = start(&standing.samples, &Config::default()).unwrap();
    assert_eq!(alignment.heading_source, HeadingSource::Unknown);
    assert!(alignment.sigma.attitude.z.to_degrees() > 100.0);
    // Nor does a drive whose vehicle may move sideways give a course; its velocities tell the heading all the same.
    let mut config = Config::default();
    config.vehicle.kind = VehicleKind::Any;
    let drive = from_standstill().simulate(1).unwrap();
    let alignment = start(&drive.samples, &config).unwrap();
    assert_eq!(alignment.heading_source, HeadingSource::MovingBase);
    assert!(
        normalised(&alignment, &drive).z.abs() < 1.0,
        "widened fivefold"
    );
}

#[test]
fn what_is_missing_is_named() {
    let simulation = from_standstill().simulate(1).unwrap();
    let only = |keep: fn(&Sample) -> bool| -> Vec<Sample> {
        simulation.samples.iter().copied().filter(keep).collect()
    };
    let missing = |samples: &[Sample]| start(samples, &Config::default()).unwrap_err().to_string();
    assert!(missing(&only(Sample::is_inertial)).contains("no valid GNSS position"));
    assert!(missing(&only(|s| !s.is_inertial())).contains("no inertial sample"));
}
