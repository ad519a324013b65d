//! Wheels in outages: the constraint on simulated drives whose inertial unit is mounted crookedly.

use insnav::config::{Config, Nonholonomic};
use insnav::filter::MOUNTING;
use insnav::imu::ImuGrade;
use insnav::navigator::Navigator;
use insnav::sample::Sample;
use insnav::sim::{GnssModel, ImuErrorModel, Scenario, Simulation, Span};
use insnav::solution::{Epoch, Sink};
use insnav::time::Time;
use nalgebra::{UnitQuaternion, Vector3};
use statrs::distribution::{ChiSquared, ContinuousCDF};

const SEEDS: u64 = 10;
/// Pitch and yaw of the unit against the vehicle, rad.
const MOUNTING_ANGLES: [f64; 2] = [-0.11, 0.08];
const OUTAGES: [f64; 3] = [150.0, 240.0, 330.0];
const OUTAGE_S: f64 = 40.0;

fn to_vehicle() -> UnitQuaternion<f64> {
    UnitQuaternion::from_euler_angles(0.0, MOUNTING_ANGLES[0], MOUNTING_ANGLES[1])
}

fn drive(seed: u64) -> Simulation {
    let mut scenario = Scenario::car_drive(400.0);
    scenario.imu.rate_hz = 50.0;
    scenario.imu.errors = ImuErrorModel::from_noise(ImuGrade::Automotive.noise());
    scenario.gnss = GnssModel {
        position_sigma_m: [0.5, 0.5, 1.0],
        velocity_sigma_m_per_s: [0.05, 0.05, 0.1],
        outages: OUTAGES
            .map(|begin_s| Span {
                begin_s,
                end_s: begin_s + OUTAGE_S,
            })
            .to_vec(),
        ..GnssModel::default()
    };
    let mut simulation = scenario.simulate(seed).expect("a sound scenario");
    let to_unit = to_vehicle().inverse();
    for sample in &mut simulation.samples {
        match sample {
            Sample::Imu(s) => {
                s.angular_rate_b = to_unit * s.angular_rate_b;
                s.specific_force_b = to_unit * s.specific_force_b;
            }
            Sample::ImuIncrement(s) => {
                s.angle_b = to_unit * s.angle_b;
                s.velocity_b = to_unit * s.velocity_b;
            }
            _ => {}
        }
    }
    simulation
}

/// Looks at the end of every outage.
struct Ends<'a> {
    simulation: &'a Simulation,
    begin: Time,
    /// Across the way, m; all of the horizontal error in units of its covariance, squared.
    errors: Vec<(f64, f64)>,
}

impl Sink for Ends<'_> {
    fn wants_epoch(&mut self, time: Time) -> bool {
        let since = time.since(self.begin);
        OUTAGES
            .iter()
            .any(|begin| (since - begin - OUTAGE_S + 0.1).abs() < 0.5 / 50.0)
    }

    fn epoch(&mut self, epoch: &Epoch) {
        let truth = self.simulation.truth_at(epoch.nav.time).nav;
        let error = epoch.nav.position.offset_to(&truth.position).xy();
        let p = epoch
            .position_covariance_n()
            .fixed_view::<2, 2>(0, 0)
            .into_owned();
        let inverse = p.try_inverse().expect("positive definite");
        // Along the way wheels that are not counted say nothing.
        let way = (truth.q_nb * Vector3::x()).xy().normalize();
        let across = way.x * error.y - way.y * error.x;
        self.errors
            .push((across, (error.transpose() * inverse * error)[0]));
    }
}

struct Outcome {
    /// Root mean square of the errors across the way at the ends, m.
    rms: f64,
    /// Sum of the normalised squares, and how many.
    nees: (f64, usize),
    /// Errors of pitch and yaw of the mounting over their sigmas, squared and added up; none without the states.
    mounting: (f64, usize),
}

fn run(change: impl Fn(&mut Config)) -> Outcome {
    let (mut errors, mut mounting) = (Vec::new(), (0.0, 0));
    for seed in 0..SEEDS {
        let simulation = drive(seed);
        let mut config = Config::default();
        change(&mut config);
        let mut navigator =
            Navigator::new(&config, ImuGrade::Automotive.noise()).expect("a sound config");
        let mut sink = Ends {
            begin: simulation.trajectory.start(),
            simulation: &simulation,
            errors: Vec::new(),
        };
        for sample in &simulation.samples {
            navigator.step(sample, &mut sink).expect("sound samples");
        }
        navigator.finish(&mut sink).expect("started");
        assert_eq!(sink.errors.len(), OUTAGES.len());
        errors.extend(sink.errors);
        let filter = navigator.filter().expect("running");
        if let Some(p) = filter.covariance().block(MOUNTING, MOUNTING) {
            let found = filter.nominal().calibration.mounting;
            for a in 0..2 {
                let error = found[a] - MOUNTING_ANGLES[a];
                mounting.0 += error * error / p[(a, a)];
                mounting.1 += 1;
            }
        }
    }
    let squares: f64 = errors.iter().map(|e| e.0 * e.0).sum();
    Outcome {
        rms: (squares / errors.len() as f64).sqrt(),
        nees: (errors.iter().map(|e| e.1).sum(), 2 * errors.len()),
        mounting,
    }
}

/// The car leans, squats and sways, and its unit stands crookedly: with the constraint it is a fraction as far off after 40 s,
/// its error is no larger than it says, and the mounting is found.
#[test]
fn wheels_hold_a_drive_through_outages() {
    let with = run(|c| c.vehicle.nonholonomic = Nonholonomic::On);
    let lateral = run(|c| c.vehicle.nonholonomic = Nonholonomic::Lateral);
    let without = run(|c| c.vehicle.nonholonomic = Nonholonomic::Off);
    // Control: a mounting that is not allowed to be what it is.
    let stiff = run(|c| {
        c.vehicle.nonholonomic = Nonholonomic::On;
        c.vehicle.mounting_sigma_deg = 0.01;
    });
    println!(
        "across, after {OUTAGE_S} s: with {:.2} m, lateral alone {:.2} m, without {:.2} m, with a stiff mounting {:.2} m",
        with.rms, lateral.rms, without.rms, stiff.rms
    );
    // Thirty ends: the root mean square is known to a tenth or so.
    assert!(with.rms < 0.5 * without.rms);
    assert!(lateral.rms < 0.5 * without.rms);
    assert!(stiff.rms > 2.0 * with.rms);
    // The constraint's sigma is that of real roads, more than a simulated car needs: errors may be smaller than stated, never
    // larger than chance allows.
    let most = |dof: usize| {
        ChiSquared::new(dof as f64)
            .expect("positive")
            .inverse_cdf(0.9999)
    };
    println!(
        "NEES/dof of the ends {:.2}, of the mounting {:.2}",
        with.nees.0 / with.nees.1 as f64,
        with.mounting.0 / with.mounting.1 as f64
    );
    assert!(with.nees.0 < most(with.nees.1));
    assert!(with.mounting.0 < most(with.mounting.1));
    assert!(stiff.nees.0 > most(stiff.nees.1));
}

/// A heading that nobody knows must not be guessed from wheels: nothing is used before it is known.
#[test]
fn nothing_is_used_before_the_heading_is_known() {
    struct Count(usize);
    impl Sink for Count {
        fn wants_epoch(&mut self, _: Time) -> bool {
            false
        }
        fn update(&mut self, update: &insnav::filter::Update) {
            self.0 += usize::from(update.measurement == "nonholonomic");
        }
    }
    let mut config = Config::default();
    config.vehicle.nonholonomic = Nonholonomic::On;
    let simulation = Scenario::standing(60.0, 120.0)
        .simulate(1)
        .expect("a sound scenario");
    let mut navigator = Navigator::new(&config, ImuGrade::Automotive.noise()).unwrap();
    let mut count = Count(0);
    for sample in &simulation.samples {
        navigator.step(sample, &mut count).unwrap();
    }
    navigator.finish(&mut count).unwrap();
    assert_eq!(count.0, 0);
}
