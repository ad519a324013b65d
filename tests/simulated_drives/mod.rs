//! Many simulated drives from wrong starts, with a look at the filter once a second: what the tests of optional states share.

// Each test takes what it needs.
#![allow(dead_code, unreachable_pub)]

use insnav::attitude::exp;
use insnav::config::Config;
use insnav::filter::{ATTITUDE, Block, Eskf, InitialSigma, Nominal, POSITION, VELOCITY};
use insnav::imu::{ImuErrors, ImuNoise};
use insnav::mechanization::NavState;
use insnav::navigator::Navigator;
use insnav::sample::Sample;
use insnav::sim::{GnssModel, ImuErrorModel, ImuOutput, Scenario, Source, Stream, Truth};
use nalgebra::{SMatrix, SVector, Vector3};

/// A unit good enough that what a test adds shows, with biases that take many values within a drive.
pub fn noise() -> ImuNoise {
    ImuNoise::from_data_sheet(0.5, 0.2, 30.0, 3.0, 100.0, 100.0)
}

fn sigma() -> InitialSigma {
    InitialSigma {
        position: Vector3::new(1.0, 1.0, 2.0),
        velocity: Vector3::repeat(0.2),
        attitude: Vector3::new(0.01, 0.01, 0.03),
        gyro_bias: Vector3::repeat(noise().gyro_bias_sigma),
        accel_bias: Vector3::repeat(noise().accel_bias_sigma),
    }
}

/// A car in town without the minute of standing at its start: increments, so that their noise is exactly white, antenna in the
/// unit, a position and a velocity every second.
pub fn scenario(duration_s: f64) -> Scenario {
    let mut scenario = Scenario::car_drive(duration_s + 60.0);
    scenario.drive.legs.remove(0);
    scenario.duration_s = duration_s;
    scenario.imu.rate_hz = 50.0;
    scenario.imu.output = ImuOutput::Increments;
    scenario.imu.errors = ImuErrorModel::from_noise(noise());
    scenario.gnss = GnssModel {
        position_sigma_m: [0.5, 0.5, 0.8],
        velocity_sigma_m_per_s: [0.05, 0.05, 0.08],
        ..GnssModel::default()
    };
    scenario
}

/// Settings for white fixes and an antenna in the unit.
pub fn settings() -> Config {
    let mut config = Config::default();
    config.gnss.lever_arm_b_m = Some([0.0; 3]);
    config.gnss.correlation_time_s = 0.0;
    config
}

/// What `f` makes of each seed, on all cores.
pub fn over_seeds<T: Send>(seeds: u64, f: impl Fn(u64) -> T + Sync) -> Vec<T> {
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
    let mut all: Vec<(u64, T)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|first| {
                let f = &f;
                scope.spawn(move || {
                    let seeds = (first..seeds).step_by(threads as usize);
                    seeds.map(|seed| (seed, f(seed))).collect::<Vec<_>>()
                })
            })
            .collect();
        workers
            .into_iter()
            .flat_map(|w| w.join().expect("drives do not panic"))
            .collect()
    });
    all.sort_by_key(|(seed, _)| *seed);
    all.into_iter().map(|(_, t)| t).collect()
}

/// One drive from a start that is wrong as the filter is told. `look` is given the filter and the truth once a second, just
/// before the next fix, with the seconds since the start.
pub fn drive(
    scenario: &Scenario,
    seed: u64,
    config: &Config,
    on_the_way: impl Fn(&mut Sample),
    mut look: impl FnMut(f64, &Eskf, &Truth),
) {
    let simulation = scenario.simulate(seed).expect("a ready scenario");
    let begin = simulation.trajectory.start();
    let truth = simulation.truth_at(begin);
    let mut source = Source::new(seed, Stream::Initial);
    let (s, mut draw) = (sigma(), || source.normal3());
    let nav = NavState {
        position: truth
            .nav
            .position
            .offset(&draw().component_mul(&s.position)),
        velocity_n: truth.nav.velocity_n + draw().component_mul(&s.velocity),
        q_nb: exp(&draw().component_mul(&s.attitude)) * truth.nav.q_nb,
        ..truth.nav
    };
    let mut navigator =
        Navigator::aligned(config, noise(), nav, ImuErrors::default(), &s).expect("valid settings");
    let mut seen = begin;
    for sample in &simulation.samples {
        let mut sample = *sample;
        on_the_way(&mut sample);
        navigator.step(&sample, &mut ()).expect("good samples");
        let filter = navigator.filter().expect("a known start");
        let now = filter.nominal().nav.time;
        let since = now.since(begin);
        if now > seen && (since - since.floor() - 0.98).abs() < 1e-6 {
            look(since, filter, &simulation.truth_at(now));
        }
        seen = now;
    }
}

/// Leave a sample as it is.
pub fn unchanged(_: &mut Sample) {}

/// A number of each drive from a normal distribution, the same for the same seed: the truth that the filter does not know.
pub fn drawn(seed: u64, sigma: f64) -> Vector3<f64> {
    // A source that the simulation itself does not use with this seed.
    Source::new(seed ^ 0x5eed_0000, Stream::Initial).normal3() * sigma
}

/// eᵀ P⁻¹ e over the number of components.
pub fn nees<const N: usize>(error: &SVector<f64, N>, p: &SMatrix<f64, N, N>) -> f64 {
    let inverse = p.try_inverse().expect("a covariance that never vanishes");
    (error.transpose() * inverse * error)[(0, 0)] / N as f64
}

/// NEES over dof of position, velocity and attitude.
pub fn motion_nees(filter: &Eskf, truth: &Truth) -> [f64; 3] {
    let true_nominal = Nominal {
        nav: truth.nav,
        imu_errors: truth.imu_errors,
        ..*filter.nominal()
    };
    let layout = filter.covariance().layout();
    let dx = filter.nominal().local(layout, &true_nominal);
    [POSITION, VELOCITY, ATTITUDE].map(|block| {
        let range = layout.range(block).expect("a base block");
        nees(
            &Vector3::from_column_slice(&dx[range]),
            &covariance(filter, block),
        )
    })
}

/// Covariance of a block that is open.
pub fn covariance<const N: usize>(filter: &Eskf, block: Block<N>) -> SMatrix<f64, N, N> {
    filter
        .covariance()
        .block(block, block)
        .expect("an open block")
}

/// Mean of rows, column by column.
pub fn mean<const N: usize>(rows: impl IntoIterator<Item = [f64; N]>) -> [f64; N] {
    let (mut sum, mut n) = ([0.0; N], 0.0);
    for row in rows {
        (0..N).for_each(|i| sum[i] += row[i]);
        n += 1.0;
    }
    sum.map(|s| s / n)
}
