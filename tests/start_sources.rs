//! Starts of runs with GNSS whose heading does not come from the course: two antennas, and velocities of a vehicle that looks
//! anywhere.

use insnav::alignment::{Alignment, HeadingSource};
use insnav::attitude::{log, wrap_angle};
use insnav::config::{Config, SigmaScale, VehicleKind};
use insnav::filter::Update;
use insnav::imu::{ImuGrade, ImuNoise};
use insnav::navigator::Navigator;
use insnav::sample::{Heading, ImuSample, Sample};
use insnav::sim::{
    GnssModel, ImuErrorModel, Leg, NavigationDrive, Scenario, Simulation, Source, Stream,
};
use insnav::solution::{Epoch, Event, Sink};
use insnav::time::Time;
use nalgebra::{UnitQuaternion, Vector3};

#[derive(Default)]
struct Record {
    start: Option<Alignment>,
    epochs: Vec<Epoch>,
    updates: Vec<Update>,
}

impl Sink for Record {
    fn epoch(&mut self, epoch: &Epoch) {
        // Ten a second are enough to look at.
        if self
            .epochs
            .last()
            .is_none_or(|last| epoch.nav.time.since(last.nav.time) > 0.095)
        {
            self.epochs.push(*epoch);
        }
    }
    fn update(&mut self, update: &Update) {
        self.updates.push(*update);
    }
    fn event(&mut self, event: &Event) {
        if let Event::Started(alignment) = event {
            self.start = Some(*alignment);
        }
    }
}

fn run(samples: &[Sample], config: &Config, noise: ImuNoise) -> (Alignment, Record) {
    let mut navigator = Navigator::new(config, noise).expect("settings in range");
    let mut record = Record::default();
    for sample in samples {
        navigator.step(sample, &mut record).expect("good samples");
    }
    navigator.finish(&mut record).expect("good samples");
    (record.start.expect("started"), record)
}

/// The body looks this much to the right of where it goes, rad.
const CRAB: f64 = 2.2;

fn crab() -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(Vector3::z() * CRAB)
}

/// The samples of a unit that is turned against its way.
fn turned(samples: &[Sample]) -> Vec<Sample> {
    let turn = |s: &Sample| match s {
        Sample::Imu(s) => Sample::Imu(ImuSample {
            angular_rate_b: crab().inverse() * s.angular_rate_b,
            specific_force_b: crab().inverse() * s.specific_force_b,
            ..*s
        }),
        other => *other,
    };
    samples.iter().map(turn).collect()
}

fn leg(duration_s: f64, speed_m_per_s: f64, turn_deg: f64, slope_deg: f64) -> Leg {
    Leg {
        duration_s,
        speed_m_per_s,
        turn_deg,
        slope_deg,
    }
}

/// A drone that hovers, flies about and looks anywhere; errors of the receiver are white, so that NEES means something.
fn drone() -> Scenario {
    let mut scenario = Scenario::standing(0.0, 70.0);
    let mut legs = vec![leg(6.0, 0.0, 0.0, 0.0)];
    for _ in 0..3 {
        legs.extend([
            leg(5.0, 4.0, 0.0, 0.0),
            leg(5.0, 8.0, 60.0, 20.0),
            leg(6.0, 8.0, -100.0, 0.0),
            leg(5.0, 2.0, 0.0, -20.0),
            leg(6.0, 7.0, 80.0, 0.0),
        ]);
    }
    scenario.duration_s = legs.iter().map(|l| l.duration_s).sum();
    scenario.drive.legs = legs;
    scenario.drive.body.squat_deg_per_m_per_s2 = -3.0;
    scenario.imu.rate_hz = 100.0;
    scenario.imu.errors = ImuErrorModel::from_noise(ImuGrade::Automotive.noise());
    scenario.gnss = GnssModel {
        position_rate_hz: 1.0,
        velocity_rate_hz: 1.0,
        position_sigma_m: [0.5, 0.5, 0.8],
        position_colour_sigma_m: [0.0; 3],
        velocity_sigma_m_per_s: [0.1, 0.1, 0.15],
        velocity_colour_sigma_m_per_s: [0.0; 3],
        scaled_to_sigma: false,
        ..GnssModel::default()
    };
    scenario
}

/// The receiver's sigmas are what they say.
fn believing() -> Config {
    let mut config = Config::default();
    config.vehicle.kind = VehicleKind::Any;
    config.gnss.sigma_scale = SigmaScale::Fixed(1.0);
    config.gnss.velocity_sigma_scale = SigmaScale::Fixed(1.0);
    config
}

/// Position, velocity and heading: NEES per degree of freedom, of every epoch.
fn nees(record: &Record, simulation: &Simulation) -> Vec<(Time, [f64; 3])> {
    let of = |e: &Epoch| {
        let truth = simulation.truth_at(e.nav.time).nav;
        let block = |i: usize, error: Vector3<f64>| {
            let p = e.covariance.fixed_view::<3, 3>(i, i).into_owned();
            error.dot(&(p.try_inverse().expect("positive") * error)) / 3.0
        };
        let attitude = log(&(truth.q_nb * crab() * e.nav.q_nb.inverse()));
        let position = block(0, e.nav.position.offset_to(&truth.position));
        let velocity = block(3, truth.velocity_n - e.nav.velocity_n);
        (e.nav.time, [position, velocity, block(6, attitude)])
    };
    record.epochs.iter().map(of).collect()
}

/// 40 flights start from their velocities, within a quarter of a minute instead of never, and are as good as they say from the first
/// sample on. Before, such a run waited for an hour and began with an unknown heading.
#[test]
fn a_drone_starts_by_its_velocities() {
    let (scenario, noise) = (drone(), ImuGrade::Automotive.noise());
    let flights = 40;
    let (mut sums, mut late) = ([[0.0; 3]; 3], 0.0_f64);
    let (mut heading, mut metres): (f64, f64) = (0.0, 0.0);
    for seed in 0..flights {
        let simulation = scenario.simulate(seed).expect("a scenario in range");
        let (start, record) = run(&turned(&simulation.samples), &believing(), noise);
        assert_eq!(start.heading_source, HeadingSource::MovingBase, "{seed}");
        late = late.max(start.heading_at.since(start.nav.time));
        let truth = simulation.truth_at(start.nav.time).nav;
        let error = log(&(truth.q_nb * crab() * start.nav.q_nb.inverse())).z;
        heading = heading.max(error.abs().to_degrees());
        let all = nees(&record, &simulation);
        for (k, after) in [20.0, 45.0, 80.0].into_iter().enumerate() {
            let at = start.nav.time.plus(after);
            let i = all.partition_point(|(time, _)| *time < at);
            for (sum, nees) in sums[k].iter_mut().zip(all[i].1) {
                *sum += nees / flights as f64;
            }
        }
        let last = record.epochs.last().expect("epochs");
        let truth = simulation.truth_at(last.nav.time).nav;
        metres = metres.max(last.nav.position.offset_to(&truth.position).norm());
    }
    println!(
        "NEES of position, velocity, attitude after 20, 45 and 80 s: {sums:.2?}; heading known after {late:.0} s at most, \
         wrong by {heading:.1}° at most; position at the end within {metres:.2} m"
    );
    assert!(late < 20.0, "{late}");
    // The start tells headings to 3°: 40 draws lie within 3.3 sigmas.
    assert!(heading < 10.0, "{heading}");
    // 120 degrees of freedom: [0.70, 1.36] in 99 %. What of the velocities the start has already, 4 %, is counted twice.
    for (k, sum) in sums.iter().enumerate() {
        for (b, value) in sum.iter().enumerate() {
            let least = if k == 0 { 0.5 } else { 0.7 };
            assert!((least..1.4).contains(value), "{k} {b}: {value}");
        }
    }
    // Five sigmas of fixes of 0.5, 0.5 and 0.8 m.
    assert!(metres < 5.0, "{metres}");
}

/// Negative control: a drone that only hovers has no heading, and is told so.
#[test]
fn a_drone_that_hovers_does_not_start_by_its_velocities() {
    let mut scenario = drone();
    scenario.drive.legs = vec![leg(60.0, 0.0, 0.0, 0.0)];
    for seed in 0..10 {
        let simulation = scenario.simulate(seed).expect("a scenario in range");
        let samples = turned(&simulation.samples);
        let (start, _) = run(&samples, &believing(), ImuGrade::Automotive.noise());
        assert_eq!(start.heading_source, HeadingSource::Unknown, "{seed}");
    }
}

const ANTENNA_SIGMA: f64 = 0.02;

/// A flight with a heading a second from two antennas, from so many seconds after its begin on.
fn with_antennas(simulation: &Simulation, seed: u64, from_s: f64) -> Vec<Sample> {
    let mut samples = turned(&simulation.samples);
    let mut noise = Source::new(seed, Stream::Route);
    let begin = simulation.trajectory.start();
    let end = samples.iter().map(Sample::time).max().expect("samples");
    let mut at = begin.plus(from_s);
    while at < end {
        let q_nb = simulation.truth_at(at).nav.q_nb * crab();
        let heading = insnav::attitude::Euler::from_quaternion(&q_nb).heading;
        samples.push(Sample::Heading(Heading {
            time: at,
            heading: wrap_angle(heading + ANTENNA_SIGMA * noise.normal()),
            sigma: ANTENNA_SIGMA,
        }));
        at = at.plus(1.0);
    }
    samples.sort_by_key(Sample::time);
    samples
}

/// Headings that come late are carried back by the gyros, with what these add.
#[test]
fn two_antennas_give_the_start_its_heading() {
    let (scenario, noise) = (drone(), ImuGrade::Automotive.noise());
    for from_s in [2.25, 20.25] {
        let (mut square, runs, mut largest) = (0.0, 40, 0.0_f64);
        for seed in 0..runs {
            let simulation = scenario.simulate(seed).expect("a scenario in range");
            let samples = with_antennas(&simulation, seed, from_s);
            let mut config = believing();
            // Its velocities must not tell it first.
            config.vehicle.kind = VehicleKind::Car;
            let only = |s: &&Sample| from_s < 10.0 || !matches!(s, Sample::GnssVelocity(_));
            let kept: Vec<Sample> = samples.iter().filter(only).copied().collect();
            if from_s > 10.0 {
                config.vehicle.kind = VehicleKind::Any;
            }
            let (start, record) = run(&kept, &config, noise);
            assert_eq!(start.heading_source, HeadingSource::Antenna, "{seed}");
            let first = simulation.trajectory.start().plus(from_s);
            assert!((start.heading_at.since(first)).abs() < 1e-6);
            // The heading that made the start is used once.
            let used = |u: &&Update| u.measurement == "heading";
            let next = record.updates.iter().find(used).expect("headings are used");
            assert!((next.time.since(first) - 1.0).abs() < 1e-6, "{seed}");
            let q_nb = simulation.truth_at(start.nav.time).nav.q_nb * crab();
            let truth = insnav::attitude::Euler::from_quaternion(&q_nb).heading;
            let error = wrap_angle(truth - start.euler().heading);
            square += (error / start.sigma.attitude.z).powi(2) / runs as f64;
            largest = largest.max(start.sigma.attitude.z);
        }
        println!(
            "heading's NEES {square:.2}, largest sigma {:.2}°",
            largest.to_degrees()
        );
        // Below 1.68 in 99 %; biases of gyros that are known from standing are taken for worse than they are.
        assert!((0.3..1.68).contains(&square), "{square}");
        assert!(largest < 2.0 * ANTENNA_SIGMA, "{largest}");
    }
}

#[test]
fn a_first_heading_that_no_other_confirms_is_not_believed() {
    let simulation = drone().simulate(3).expect("a scenario in range");
    let mut samples = with_antennas(&simulation, 3, 2.25);
    let first = samples
        .iter_mut()
        .find_map(|s| match s {
            Sample::Heading(h) => Some(h),
            _ => None,
        })
        .expect("headings");
    first.heading = wrap_angle(first.heading + 0.5);
    let (start, _) = run(&samples, &believing(), ImuGrade::Automotive.noise());
    assert_eq!(start.heading_source, HeadingSource::Antenna);
    let second = simulation.trajectory.start().plus(3.25);
    assert!(start.heading_at.since(second).abs() < 1e-6);
    // What is given goes before.
    let mut config = believing();
    config.alignment.heading_deg = Some(10.0);
    let (start, _) = run(&samples, &config, ImuGrade::Automotive.noise());
    assert_eq!(start.heading_source, HeadingSource::Given);
}

/// A unit that feels the Earth turn does not wait for motion: in a drive that begins with five minutes of rest the heading is known
/// before, and wrong by no more than it says. A tactical one, whose drift hides the Earth's rate, waits for the course.
#[test]
fn gyros_that_feel_the_earth_give_the_start_its_heading() {
    let runs = 10;
    let mut squares = 0.0;
    for seed in 0..runs {
        let mut scenario = NavigationDrive {
            legs: 1,
            rate_hz: 50.0,
            ..NavigationDrive::default()
        }
        .scenario();
        scenario.gnss = GnssModel {
            position_rate_hz: 1.0,
            velocity_rate_hz: 1.0,
            ..GnssModel::default()
        };
        let noise = scenario.imu.errors.noise.expect("its noise");
        let simulation = scenario.simulate(seed).expect("a drive");
        let (start, record) = run(&simulation.samples, &Config::default(), noise);
        assert_eq!(start.heading_source, HeadingSource::Gyrocompass);
        let error = |epoch: &Epoch| {
            let truth = simulation.truth_at(epoch.nav.time).nav.q_nb;
            log(&(truth * epoch.nav.q_nb.inverse())).z
        };
        let begin = record.epochs[0].nav.time;
        let at = |s: f64| record.epochs.iter().find(|e| e.nav.time.since(begin) >= s);
        let rested = at(290.0).expect("an epoch");
        let sigma = rested.heading_sigma();
        // 0.02 °/h are 9.2′ at 60°.
        assert!((2e-3..4e-3).contains(&sigma), "{sigma}");
        squares += (error(rested) / sigma).powi(2) / runs as f64;
    }
    println!("heading NEES at the end of the first stop {squares:.2}");
    // Ten degrees of freedom: a standard error of 0.45.
    assert!(squares < 2.4, "{squares}");
    let mut scenario = Scenario::car_drive(120.0);
    scenario.imu.errors = ImuErrorModel::from_noise(ImuGrade::Tactical.noise());
    let simulation = scenario.simulate(1).expect("a drive");
    let noise = ImuGrade::Tactical.noise();
    let (start, _) = run(&simulation.samples, &Config::default(), noise);
    assert_eq!(start.heading_source, HeadingSource::CourseVelocity);
}
