//! Stops as a whole navigator finds them: tunnels, ferries, outages, slow turns, tilts, holes.
//!
//! Roads are white noise of the stated rms per axis at 100 Hz on the specific force. `INSNAV_LONG=1` takes 100 runs instead
//! of 10.

use insnav::config::Config;
use insnav::filter::InitialSigma;
use insnav::imu::{ImuErrors, ImuGrade};
use insnav::navigator::Navigator;
use insnav::sample::Sample;
use insnav::sim::{ImuErrorModel, Leg, Scenario, Simulation, Source, Span, Stream};
use insnav::solution::{Epoch, Event, Motion, Sink};
use insnav::stationary::StopRecord;
use insnav::time::Time;
use nalgebra::{UnitQuaternion, Vector3};

const GRADE: ImuGrade = ImuGrade::Automotive;

fn runs() -> u64 {
    if std::env::var_os("INSNAV_LONG").is_some() {
        100
    } else {
        10
    }
}

#[derive(Default)]
struct Record {
    stops: Vec<StopRecord>,
    last: Option<Epoch>,
    /// Epochs under way that say "standing".
    wrong: usize,
    moving_from: f64,
    start: Time,
}

impl Sink for Record {
    fn epoch(&mut self, epoch: &Epoch) {
        let t = epoch.nav.time.since(self.start);
        self.wrong += usize::from(t >= self.moving_from && epoch.motion != Motion::Moving);
        self.last = Some(*epoch);
    }
    fn event(&mut self, event: &Event) {
        if let Event::StopEnded(record) = event {
            self.stops.push(*record);
        }
    }
}

fn leg(duration_s: f64, speed_m_per_s: f64) -> Leg {
    Leg {
        duration_s,
        speed_m_per_s,
        ..Leg::default()
    }
}

/// A drive of these legs from this speed, GNSS out in these spans, on a road of this rms.
fn drive(seed: u64, speed: f64, legs: &[Leg], outages: &[(f64, f64)], road: f64) -> Simulation {
    let mut scenario = Scenario::standing(1.0, 70.0);
    scenario.drive.speed_m_per_s = speed;
    scenario.drive.legs = legs.to_vec();
    scenario.duration_s = legs.iter().map(|l| l.duration_s).sum();
    scenario.imu.rate_hz = 100.0;
    scenario.imu.errors = ImuErrorModel::from_noise(GRADE.noise());
    scenario.gnss.outages = outages
        .iter()
        .map(|&(begin_s, end_s)| Span { begin_s, end_s })
        .collect();
    let mut simulation = scenario.simulate(seed).expect("valid");
    let mut source = Source::new(seed, Stream::Outliers);
    for sample in &mut simulation.samples {
        if let Sample::Imu(s) = sample {
            s.specific_force_b += source.normal3() * road;
        }
    }
    simulation
}

fn navigate(simulation: &Simulation, seed: u64, moving_from: f64) -> Record {
    let start = simulation.trajectory.start();
    let mut nav = simulation.truth_at(start).nav;
    let noise = GRADE.noise();
    let sigma = InitialSigma {
        position: Vector3::repeat(2.0),
        velocity: Vector3::repeat(0.1),
        // The heading as turns leave it: at 30 mrad braking from 12 m/s leaves 0.4 m/s sideways, too much to tell a stop.
        attitude: Vector3::new(0.005, 0.005, 0.005),
        gyro_bias: Vector3::repeat(noise.gyro_bias_sigma),
        accel_bias: Vector3::repeat(noise.accel_bias_sigma),
    };
    let mut source = Source::new(seed, Stream::Initial);
    nav.velocity_n += source.normal3() * 0.1;
    nav.q_nb = insnav::attitude::exp(&source.normal3().component_mul(&sigma.attitude)) * nav.q_nb;
    let config = Config::default();
    let mut navigator =
        Navigator::aligned(&config, noise, nav, ImuErrors::default(), &sigma).expect("valid");
    let mut record = Record {
        moving_from,
        start,
        ..Record::default()
    };
    for sample in &simulation.samples {
        navigator.step(sample, &mut record).expect("good samples");
    }
    navigator.finish(&mut record).expect("good samples");
    record
}

/// Stops in seconds from the start.
fn spans(record: &Record) -> Vec<(f64, f64)> {
    let at = |t: Time| t.since(record.start);
    record
        .stops
        .iter()
        .map(|s| (at(s.held_from), at(s.end)))
        .collect()
}

/// 25 m/s, straight, as smooth as asphalt gets, five minutes without GNSS: the inertial unit feels what it feels at rest.
#[test]
fn a_tunnel_is_no_stop() {
    for seed in 0..runs() {
        let simulation = drive(seed, 25.0, &[leg(380.0, 25.0)], &[(60.0, 360.0)], 0.02);
        let record = navigate(&simulation, seed, 0.0);
        assert!(
            record.stops.is_empty() && record.wrong == 0,
            "{:?}",
            spans(&record)
        );
    }
}

/// And with no road at all: a ferry at 8 m/s, a train at 50, with GNSS that is lost for ten seconds a minute.
#[test]
fn neither_a_ferry_nor_a_train_stands() {
    let outages: Vec<(f64, f64)> = (1..5)
        .map(|k| (60.0 * f64::from(k), 60.0 * f64::from(k) + 10.0))
        .collect();
    for speed in [8.0, 50.0] {
        for seed in 0..runs() {
            let simulation = drive(seed, speed, &[leg(300.0, speed)], &outages, 0.0);
            let record = navigate(&simulation, seed, 0.0);
            assert!(
                record.stops.is_empty() && record.wrong == 0,
                "{:?}",
                spans(&record)
            );
        }
    }
}

/// Lost under a bridge five seconds before a red light, back half a minute later. The filter has stood and turned before: a
/// heading of a degree or two, as straight driving leaves it, would make the speed at the end of braking too uncertain.
#[test]
fn a_stop_in_a_short_outage_is_found() {
    let corner = Leg {
        turn_deg: 90.0,
        ..leg(10.0, 12.0)
    };
    let legs = [
        leg(30.0, 0.0),
        leg(8.0, 12.0),
        corner,
        leg(7.0, 0.0),
        leg(30.0, 0.0),
        leg(10.0, 12.0),
    ];
    let mut found = 0;
    for seed in 0..runs() {
        let simulation = drive(seed, 0.0, &legs, &[(50.0, 83.0)], 0.02);
        let record = navigate(&simulation, seed, 86.5);
        assert_eq!(record.wrong, 0, "{:?}", spans(&record));
        let stops = spans(&record);
        println!("{stops:.1?}");
        found += u64::from(
            stops
                .iter()
                .any(|s| (53.0..60.0).contains(&s.0) && s.1 > 83.0),
        );
    }
    println!("found in {found} of {}", runs());
    // A filter that is off by two of its sigmas and more may say no.
    assert!(found * 10 >= runs() * 8, "{found}");
}

/// Ten minutes in town and on fast roads: every stop of more than 4 s is held within 3.5 s, and never a body above 0.3 m/s.
#[test]
fn stops_of_a_drive_are_those_of_its_truth() {
    let (mut true_stops, mut worst) = (0, 0.0f64);
    for seed in 0..runs() / 5 {
        let mut scenario = Scenario::car_drive(600.0);
        scenario.imu.rate_hz = 100.0;
        let simulation = scenario.simulate(seed).expect("valid");
        let record = navigate(&simulation, seed, f64::INFINITY);
        let start = simulation.trajectory.start();
        let speed = |t: f64| simulation.truth_at(start.plus(t)).nav.velocity_n.norm();
        let stops = spans(&record);
        for (from, to) in &stops {
            let fastest = (0..=1000)
                .map(|i| speed(from + (to - from) * f64::from(i) / 1000.0))
                .fold(0.0, f64::max);
            assert!(fastest < 0.3, "{fastest} m/s in {from} to {to}");
        }
        let mut begin = None;
        for i in 0..6000 {
            let t = 0.1 * f64::from(i);
            match (speed(t) < 0.1, begin) {
                (true, None) => begin = Some(t),
                (false, Some(since)) => {
                    if t - since > 4.0 {
                        true_stops += 1;
                        let held = stops.iter().find(|s| s.1 > since && s.0 < t);
                        let delay = held.map_or(f64::INFINITY, |s| s.0 - since);
                        worst = worst.max(delay);
                        assert!(delay < 3.5, "{since} to {t}: {stops:?}");
                    }
                    begin = None;
                }
                _ => {}
            }
        }
    }
    println!("{true_stops} stops, the latest held after {worst:.2} s");
    assert!(true_stops > 5);
}

fn standing(seed: u64) -> Simulation {
    drive(seed, 0.0, &[leg(120.0, 0.0)], &[], 0.0)
}

fn heading_deg(record: &Record) -> f64 {
    record.last.expect("epochs").euler().heading.to_degrees()
}

/// 3° in 15 s, while GNSS says that nothing moves: the filter must turn with the body.
#[test]
fn a_slow_true_turn_is_not_held() {
    for seed in 0..runs() {
        let mut simulation = standing(seed);
        let start = simulation.trajectory.start();
        for sample in &mut simulation.samples {
            if let Sample::Imu(s) = sample {
                let t = s.time.since(start);
                if (60.0..75.0).contains(&t) {
                    s.angular_rate_b.z += 0.2f64.to_radians();
                }
            }
        }
        let turned = navigate(&simulation, seed, f64::INFINITY);
        let straight = navigate(&standing(seed), seed, f64::INFINITY);
        let turn = heading_deg(&turned) - heading_deg(&straight);
        println!("turned by {turn:.2}, stops {:.1?}", spans(&turned));
        // It takes up to two seconds until a mean shows it: 0.4°.
        assert!((turn - 3.0).abs() < 0.5, "{turn}");
    }
}

/// Somebody gets in: 2° of pitch within half a second.
#[test]
fn a_tilt_in_mid_stop_is_followed() {
    for seed in 0..runs() {
        let mut simulation = standing(seed);
        let start = simulation.trajectory.start();
        let tilt = 2.0f64.to_radians();
        for sample in &mut simulation.samples {
            if let Sample::Imu(s) = sample {
                let t = s.time.since(start);
                let share = ((t - 60.0) / 0.5).clamp(0.0, 1.0);
                let turned = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), tilt * share);
                s.specific_force_b = turned.inverse_transform_vector(&s.specific_force_b);
                if share > 0.0 && share < 1.0 {
                    s.angular_rate_b.y += tilt / 0.5;
                }
            }
        }
        let record = navigate(&simulation, seed, f64::INFINITY);
        let level = navigate(&standing(seed), seed, f64::INFINITY);
        let pitch = |r: &Record| r.last.expect("epochs").euler().pitch.to_degrees();
        let tilted = pitch(&record) - pitch(&level);
        // Tilted, the vertical force tells tilt from bias a little: corrections of a variance of what it takes away.
        let variance = |r: &Record| {
            r.last
                .expect("epochs")
                .attitude_covariance_n()
                .fixed_view::<2, 2>(0, 0)
                .trace()
        };
        let learnt = (variance(&level) - variance(&record)).max(0.0).sqrt();
        println!(
            "tilted by {tilted:.2}, learnt {:.2}, stops {:.1?}",
            learnt.to_degrees(),
            spans(&record)
        );
        // Gyros see the tilt to 0.05°: the samples at its ends, and their noise.
        let allowed = 0.05 + 4.5 * learnt.to_degrees();
        assert!((tilted - 2.0).abs() < allowed, "{tilted} {allowed}");
    }
}

#[test]
fn a_hole_in_mid_stop_separates_two() {
    let mut simulation = standing(1);
    let start = simulation.trajectory.start();
    simulation
        .samples
        .retain(|s| !s.is_inertial() || !(60.0..60.5).contains(&s.time().since(start)));
    let stops = spans(&navigate(&simulation, 1, f64::INFINITY));
    assert!(
        stops.len() == 2 && stops[0].1 <= 60.01 && stops[1].0 >= 60.5,
        "{stops:?}"
    );
}
