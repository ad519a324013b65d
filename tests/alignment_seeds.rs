//! An alignment from stops as the start of a filter: what becomes of its errors when the unit goes on without aiding.

use insnav::alignment::{
    AlignmentMethod, AlignmentOptions, AlignmentResult, Record, StopWindow, align,
};
use insnav::attitude::Euler;
use insnav::config::{Config, StationaryMode};
use insnav::earth::Geodetic;
use insnav::filter::{ATTITUDE, Eskf, GYRO_BIAS, InitialSigma, VELOCITY};
use insnav::imu::{ImuErrors, ImuNoise};
use insnav::mechanization::{Increment, NavState};
use insnav::navigator::Navigator;
use insnav::sample::Sample;
use insnav::sim::{Rocking, RockingErrors, Source, Stream, to_increments};
use insnav::solution::{Epoch, Sink};
use insnav::time::Time;
use nalgebra::{Matrix2, Matrix3, Vector3};

const STOP_S: f64 = 300.0;
const AFTER_S: f64 = 600.0;
const UG: f64 = 9.806_65e-6;

/// 0.001 °/√h, 5 µg/√Hz, 0.02 °/h and 50 µg that do not wander.
fn noise() -> ImuNoise {
    ImuNoise {
        gyro_white: 0.001f64.to_radians() / 60.0,
        accel_white: 5.0 * UG,
        gyro_bias_sigma: 1e-7,
        accel_bias_sigma: 50.0 * UG,
        gyro_bias_tau: 1e12,
        accel_bias_tau: 1e12,
    }
}

fn place() -> Geodetic {
    Geodetic::from_degrees(60.0, 30.0, 0.0)
}

struct Run {
    samples: Vec<Sample>,
    increments: Vec<Increment>,
    alignment: AlignmentResult,
}

/// A unit that stands still, aligned by its first five minutes.
fn run(seed: u64) -> Run {
    let body = Rocking::standing(place(), Euler::from_degrees(1.0, -2.0, 130.0));
    let mut source = Source::new(seed, Stream::Initial);
    let errors = RockingErrors {
        constant: ImuErrors {
            gyro_bias: source.normal3() * 1e-7,
            accel_bias: source.normal3() * (50.0 * UG),
            ..ImuErrors::default()
        },
        white: [noise().gyro_white, noise().accel_white],
        quantum: [0.0; 2],
    };
    let samples = errors.apply(&body.increments(STOP_S + AFTER_S, 20.0), seed);
    let increments = to_increments(&samples);
    let options = AlignmentOptions {
        method: AlignmentMethod::Fine,
        ..AlignmentOptions::new(place(), noise())
    };
    let stop = StopWindow {
        begin: Time::from_seconds(0.0),
        end: Time::from_seconds(STOP_S),
    };
    let record = Record::new(increments.iter().copied());
    let alignment = align(&record, &[stop], &options).expect("aligned");
    Run {
        samples: samples.into_iter().map(Sample::ImuIncrement).collect(),
        increments,
        alignment,
    }
}

/// Horizontal velocity after ten minutes without aiding: its normalised square, and its stated standard deviation.
fn drift(run: &Run, tied: bool) -> (f64, f64) {
    let alignment = &run.alignment;
    let nav = NavState {
        time: alignment.at,
        position: place(),
        velocity_n: Vector3::zeros(),
        q_nb: alignment.q_nb,
    };
    let imu_errors = ImuErrors {
        gyro_bias: alignment.gyro_bias,
        accel_bias: alignment.accel_bias,
        ..ImuErrors::default()
    };
    let sigma = alignment.sigma();
    let three = |i: usize| Vector3::new(sigma[i], sigma[i + 1], sigma[i + 2]);
    let prior = InitialSigma {
        position: Vector3::zeros(),
        velocity: Vector3::repeat(1e-6),
        attitude: three(0),
        gyro_bias: three(3),
        accel_bias: three(6),
    };
    let mut filter = Eskf::new(nav, imu_errors, &prior, noise());
    if tied {
        filter.set_joint_prior(&alignment.covariance);
    }
    for increment in &run.increments {
        if increment.time > alignment.at {
            filter.propagate(increment);
        }
    }
    let v = filter.nominal().nav.velocity_n.xy();
    let p: Matrix3<f64> = filter.covariance().block(VELOCITY, VELOCITY).expect("open");
    let p: Matrix2<f64> = p.fixed_view::<2, 2>(0, 0).into_owned();
    let nees = v.dot(&p.cholesky().expect("positive").solve(&v));
    (nees, p.trace().sqrt())
}

/// Heading error and east drift make up for each other in the position where they were found: forgetting that states a velocity
/// error several times too large, and would take the drift for something that aiding must correct.
#[test]
fn a_start_keeps_heading_and_east_drift_tied() {
    let runs = 40;
    let (mut tied, mut apart) = ([0.0; 2], [0.0; 2]);
    for seed in 0..runs {
        let run = run(seed);
        for (sums, keep) in [(&mut tied, true), (&mut apart, false)] {
            let (nees, sigma) = drift(&run, keep);
            sums[0] += nees / (2.0 * runs as f64);
            sums[1] += sigma / runs as f64;
        }
    }
    println!(
        "velocity NEES/dof {:.2}, sigma {:.4} m/s; as if independent {:.4}, {:.4} m/s",
        tied[0], tied[1], apart[0], apart[1]
    );
    // Eighty degrees of freedom: a standard error of 0.16.
    assert!((tied[0] - 1.0).abs() < 0.47, "{tied:?}");
    assert!(apart[0] < 0.3 && apart[1] > 2.0 * tied[1], "{apart:?}");
}

struct Last(Option<Epoch>);

impl Sink for Last {
    fn epoch(&mut self, epoch: &Epoch) {
        self.0 = Some(*epoch);
    }
}

/// The navigator starts with the whole covariance, and while it stands the heading does not get worse than the alignment's.
#[test]
fn a_navigator_goes_on_from_an_alignment() {
    let run = run(7);
    let mut config = Config::default();
    config.gnss.used = false;
    config.stationary.mode = StationaryMode::Off;
    let mut navigator = Navigator::after_alignment(
        &config,
        noise(),
        &run.alignment,
        place(),
        Vector3::zeros(),
        1e-6,
    )
    .expect("a navigator");
    {
        let filter = navigator.filter().expect("it runs");
        let cross: Matrix3<f64> = filter
            .covariance()
            .block(ATTITUDE, GYRO_BIAS)
            .expect("open");
        let stated = run
            .alignment
            .covariance
            .fixed_view::<3, 3>(0, 3)
            .into_owned();
        assert!((cross - stated).amax() <= 1e-18, "{cross} {stated}");
    }
    let mut last = Last(None);
    for sample in run
        .samples
        .iter()
        .filter(|s| s.time().since(run.alignment.at) > -0.06)
    {
        navigator.step(sample, &mut last).expect("taken");
    }
    navigator.finish(&mut last).expect("finished");
    let epoch = last.0.expect("epochs");
    let (nees, sigma) = drift(&run, true);
    let speed = epoch.nav.velocity_n.xy().norm();
    assert!(speed < 4.0 * sigma, "{speed} {sigma} {nees}");
    // The same way as the filter alone: the navigator adds nothing but the horizon.
    assert!(
        epoch
            .nav
            .time
            .since(Time::from_seconds(STOP_S + AFTER_S))
            .abs()
            < 0.06
    );
}
