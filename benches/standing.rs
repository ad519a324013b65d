//! What a second of standing costs the navigator, by mode, at 100 Hz.
//!
//! The ratio that must hold is measured with all modes by turns, each by the fastest of many batches: wall time varies
//! threefold on a shared machine.

use criterion::{Criterion, criterion_group, criterion_main};
use insnav::config::{Config, DetectorKind, Intervals, StationaryMode};
use insnav::earth::{Geodetic, earth_rate_n, gravity};
use insnav::filter::InitialSigma;
use insnav::imu::{ImuErrors, ImuGrade};
use insnav::mechanization::NavState;
use insnav::navigator::Navigator;
use insnav::sample::{ImuSample, Sample};
use insnav::time::Time;
use nalgebra::{UnitQuaternion, Vector3};
use std::hint::black_box;
use std::time::{Duration, Instant};

/// The most that static mode may take of a held heading's time.
const LARGEST_RATIO: f64 = 1.0 / 8.0;

const RATE_HZ: i64 = 100;
const MODES: [(&str, StationaryMode); 6] = [
    ("off", StationaryMode::Off),
    ("zupt", StationaryMode::Zupt),
    ("zihr", StationaryMode::Zihr),
    ("heading_hold", StationaryMode::HeadingHold),
    ("attitude_hold", StationaryMode::AttitudeHold),
    ("static", StationaryMode::Static),
];

/// A body at rest for ever, and its navigator.
struct Standing {
    navigator: Navigator,
    rate_b: Vector3<f64>,
    force_b: Vector3<f64>,
    samples: i64,
}

impl Standing {
    fn new(mode: StationaryMode) -> Self {
        let mut config = Config::default();
        config.stationary.mode = mode;
        // What finds stops costs the same in every mode, and is no part of this.
        config.stationary.detector = DetectorKind::None;
        config.stationary.intervals_s = Intervals::new(&[[0.0, 1e8]]).expect("one interval fits");
        let noise = ImuGrade::Consumer.noise();
        let nav = NavState {
            time: Time(0),
            position: Geodetic::from_degrees(53.9, 27.55, 220.0),
            velocity_n: Vector3::zeros(),
            q_nb: UnitQuaternion::from_euler_angles(0.02, -0.03, 0.74),
        };
        let sigma = InitialSigma {
            position: Vector3::repeat(1.0),
            velocity: Vector3::repeat(0.1),
            attitude: Vector3::new(0.002, 0.002, 0.01),
            gyro_bias: Vector3::repeat(noise.gyro_bias_sigma),
            accel_bias: Vector3::repeat(noise.accel_bias_sigma),
        };
        let mut standing = Standing {
            navigator: Navigator::aligned(&config, noise, nav, ImuErrors::default(), &sigma)
                .expect("valid settings"),
            rate_b: nav.q_nb.inverse() * earth_rate_n(nav.position.latitude),
            force_b: nav.q_nb.inverse() * Vector3::new(0.0, 0.0, -gravity(&nav.position)),
            samples: 0,
        };
        // Into the stop, and past what is different at its begin.
        for _ in 0..10 {
            standing.second();
        }
        standing
    }

    fn second(&mut self) {
        for _ in 0..RATE_HZ {
            let sample = Sample::Imu(ImuSample {
                time: Time(self.samples * (1_000_000_000 / RATE_HZ)),
                angular_rate_b: self.rate_b,
                specific_force_b: self.force_b,
            });
            self.samples += 1;
            self.navigator
                .step(black_box(&sample), &mut ())
                .expect("good samples");
        }
    }
}

fn ratio(_: &mut Criterion) {
    // `cargo test --all-targets` runs benches unoptimised, to see that they run: nothing to be judged.
    if !std::env::args().any(|a| a == "--bench") {
        return;
    }
    let mut all = MODES.map(|(_, mode)| Standing::new(mode));
    let mut best = [Duration::MAX; MODES.len()];
    for _ in 0..200 {
        for (standing, best) in all.iter_mut().zip(&mut best) {
            let begin = Instant::now();
            standing.second();
            *best = (*best).min(begin.elapsed());
        }
    }
    let us = |name: &str| {
        let index = MODES.iter().position(|m| m.0 == name).expect("listed");
        best[index].as_secs_f64() * 1e6
    };
    for (name, _) in MODES {
        println!("{name}: {:.1} µs per second of standing", us(name));
    }
    let ratio = us("static") / us("heading_hold");
    println!("static / heading_hold {ratio:.3}");
    assert!(ratio <= LARGEST_RATIO, "ratio above {LARGEST_RATIO}");
}

fn modes(c: &mut Criterion) {
    for (name, mode) in MODES {
        let mut standing = Standing::new(mode);
        c.bench_function(&format!("standing second/{name}"), |b| {
            b.iter(|| standing.second());
        });
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().measurement_time(Duration::from_secs(2)).warm_up_time(Duration::from_millis(500));
    targets = ratio, modes
}
criterion_main!(benches);
