//! Noise that a filter is told wrongly, found by its own innovations: simulated drives of twenty minutes with a MEMS unit.
//!
//! `INSNAV_LONG=1` runs twenty seeds of each case, without it two; `INSNAV_SHOW=1` prints every round.

mod simulated_drives;

use insnav::attitude::exp;
use insnav::config::{Config, SigmaScale};
use insnav::filter::{Eskf, InitialSigma};
use insnav::imu::{ImuErrors, ImuNoise};
use insnav::mechanization::NavState;
use insnav::navigator::Navigator;
use insnav::noise::{
    AdaptationOutcome, AdaptationStep, InnovationSums, NoiseAdaptation, NoiseUnknown, NoiseValues,
    Verdict,
};
use insnav::sim::{GnssModel, ImuErrorModel, Scenario, Simulation, Source, Stream};
use nalgebra::Vector3;
use simulated_drives::{mean, motion_nees, over_seeds, settings};
use std::time::Instant;

const DURATION_S: f64 = 1200.0;

fn seeds() -> u64 {
    if std::env::var("INSNAV_LONG").is_ok_and(|v| v == "1") {
        20
    } else {
        2
    }
}

/// A unit both of whose white noises show in fixes of a good receiver five times a second: 3 °/√h and 1 m/s/√h, with biases of
/// 100 °/h and 5 mg that wander over half an hour.
fn noise() -> ImuNoise {
    ImuNoise::from_data_sheet(3.0, 1.0, 100.0, 5.0, 2000.0, 2000.0)
}

fn truth() -> NoiseValues {
    NoiseValues {
        gyro_white: noise().gyro_white,
        accel_white: noise().accel_white,
        position_scale: 1.0,
        velocity_scale: 1.0,
    }
}

fn scenario() -> Scenario {
    let mut scenario = simulated_drives::scenario(DURATION_S);
    scenario.imu.errors = ImuErrorModel::from_noise(noise());
    scenario.gnss.position_rate_hz = 5.0;
    scenario.gnss.velocity_rate_hz = 5.0;
    scenario
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

/// One run with a noise to believe in: what its innovations say, if asked, and NEES over dof of position, velocity and attitude.
fn run(
    simulation: &Simulation,
    seed: u64,
    config: &Config,
    told: &NoiseValues,
    watch: bool,
    mut look: impl FnMut(&Eskf),
) -> (Option<InnovationSums>, [f64; 3]) {
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
    let mut config = *config;
    config.gnss.sigma_scale = SigmaScale::Fixed(told.position_scale);
    config.gnss.velocity_sigma_scale = SigmaScale::Fixed(told.velocity_scale);
    let noise = ImuNoise {
        gyro_white: told.gyro_white,
        accel_white: told.accel_white,
        ..noise()
    };
    let mut navigator =
        Navigator::aligned(&config, noise, nav, ImuErrors::default(), &s).expect("valid settings");
    if watch {
        navigator.watch_noise();
    }
    let mut seen = begin;
    let mut rows = Vec::new();
    for sample in &simulation.samples {
        navigator.step(sample, &mut ()).expect("good samples");
        let filter = navigator.filter().expect("a known start");
        let now = filter.nominal().nav.time;
        let since = now.since(begin);
        if now > seen && (since - since.floor() - 0.98).abs() < 1e-6 {
            rows.push(motion_nees(filter, &simulation.truth_at(now)));
            look(filter);
        }
        seen = now;
    }
    navigator.finish(&mut ()).expect("good samples");
    (navigator.take_noise(), mean(rows))
}

fn adapt(
    simulation: &Simulation,
    seed: u64,
    config: &Config,
    prior: NoiseValues,
) -> AdaptationOutcome {
    let mut adaptation = NoiseAdaptation::new(prior);
    loop {
        let used = adaptation.values();
        let (sums, _) = run(simulation, seed, config, &used, true, |_| {});
        let sums = sums.expect("watched");
        if std::env::var_os("INSNAV_SHOW").is_some() {
            let s = sums.solve(&[None; 4]).expect("solvable");
            println!(
                "   used {used:.5?} theta {:.3?} se {:.3?} chi2 {:.1}/{}",
                s.theta, s.standard_errors, s.chi2, s.dof
            );
        }
        match adaptation.take(&sums) {
            AdaptationStep::Again(_) => {}
            AdaptationStep::Done(outcome) => return outcome,
        }
    }
}

fn told(outcome: &AdaptationOutcome) -> String {
    let mut text = format!(
        "{} rounds, chi2/dof {:.2}",
        outcome.rounds,
        outcome.chi2 / outcome.dof as f64
    );
    for n in &outcome.numbers {
        let truth = truth().as_array()[n.unknown as usize];
        let share = |x: Option<f64>| x.unwrap_or(f64::NAN) / truth;
        let held = if n.verdict == Verdict::Estimated {
            ""
        } else {
            " held"
        };
        text += &format!(
            " | {:?} {:.2} ± {:.2}{held}",
            n.unknown,
            share(n.estimate),
            share(n.standard_error)
        );
    }
    text
}

type Change = fn(&mut NoiseValues, f64);

const CASES: [(&str, Change); 3] = [
    ("gyro white noise", |n, k| n.gyro_white *= k),
    ("accelerometer white noise", |n, k| n.accel_white *= k),
    ("sigmas of positions", |n, k| n.position_scale *= k),
];

#[test]
fn a_wrong_noise_is_found_and_the_filter_knows_its_errors_again() {
    let scenario = scenario();
    let config = settings();
    for (name, change) in CASES {
        for factor in [3.0, 1.0 / 3.0] {
            let mut prior = truth();
            change(&mut prior, factor);
            let shown = over_seeds(seeds(), |seed| {
                let simulation = scenario.simulate(seed).expect("a ready scenario");
                let outcome = adapt(&simulation, seed, &config, prior);
                let accepted = outcome.accepted(&prior);
                let before = run(&simulation, seed, &config, &prior, false, |_| {}).1;
                let after = run(&simulation, seed, &config, &accepted, false, |_| {}).1;
                (outcome, before, after)
            });
            println!("{name} x {factor:.2}");
            let mut held = 0;
            for (seed, (outcome, before, after)) in shown.iter().enumerate() {
                println!(
                    "  {seed}: {}  NEES {before:.2?} -> {after:.2?}",
                    told(outcome)
                );
                for n in &outcome.numbers {
                    held += usize::from(n.verdict != Verdict::Estimated);
                    let share = n.estimate.expect("seen") / truth().as_array()[n.unknown as usize];
                    assert!(
                        n.verdict != Verdict::Estimated || (0.75..=1.25).contains(&share),
                        "{name} x {factor:.2}, seed {seed}: {n:?}"
                    );
                }
            }
            let before = mean(shown.iter().map(|(_, before, _)| *before));
            let after = mean(shown.iter().map(|(_, _, after)| *after));
            println!("  NEES/dof {before:.3?} -> {after:.3?}, {held} numbers held");
            let in_band = |nees: &f64| (0.8..=1.25).contains(nees);
            assert!(after.iter().all(in_band), "{name} x {factor:.2}: {after:?}");
            // The control: believed as it was, the filter does not know its errors.
            assert!(
                !before.iter().all(in_band),
                "{name} x {factor:.2}: {before:?}"
            );
            // Holding everything would pass all else.
            assert!(4 * held <= shown.len(), "{name} x {factor:.2}: {held} held");
        }
    }
}

/// Drives at the true noise: estimates are as wrong as they say.
#[test]
fn standard_errors_are_honest() {
    let scenario = scenario();
    let config = settings();
    let z: Vec<[f64; 4]> = over_seeds(6 * seeds(), |seed| {
        let simulation = scenario.simulate(1000 + seed).expect("a ready scenario");
        let (sums, _) = run(&simulation, seed, &config, &truth(), true, |_| {});
        let solution = sums.expect("watched").solve(&[None; 4]).expect("solvable");
        core::array::from_fn(|i| (solution.theta[i] - 1.0) / solution.standard_errors[i])
    });
    let n = z.len() as f64;
    for unknown in NoiseUnknown::ALL {
        let i = unknown as usize;
        let bias = z.iter().map(|z| z[i]).sum::<f64>() / n;
        let square = z.iter().map(|z| z[i] * z[i]).sum::<f64>() / n;
        println!("{unknown:?}: mean z {bias:.2}, mean square {square:.2}");
        // The mean of n normal numbers is beyond 3.5/√n once in two thousand times.
        assert!(bias.abs() < 3.5 / n.sqrt(), "{unknown:?}: {bias}");
    }
    let all: Vec<f64> = z.iter().flatten().copied().collect();
    let inside = all.iter().filter(|z| z.abs() < 2.0).count() as f64 / all.len() as f64;
    println!("|z| < 2 in {:.1} %", 100.0 * inside);
    // 95 %; of 48 numbers in the short run one more or less is 2 %.
    assert!(inside >= 0.88, "{inside}");
}

/// P is the sum of its parts, whatever is done to it, and the innovations of a filter with optimal gains are white by its own
/// account: identities, through stops and all.
#[test]
fn the_covariance_is_the_sum_of_its_parts() {
    let simulation = scenario().simulate(1).expect("a ready scenario");
    let mut worst: f64 = 0.0;
    let (sums, _) = run(&simulation, 1, &settings(), &truth(), true, |filter| {
        let shares = filter.shares().expect("watched");
        let whole = filter.covariance().dense::<15>();
        let mut sum = shares.part(None).dense::<15>();
        for unknown in NoiseUnknown::ALL {
            sum += shares.part(Some(unknown)).dense::<15>();
        }
        for i in 0..15 {
            for j in 0..15 {
                let scale = (whole[(i, i)] * whole[(j, j)]).sqrt();
                worst = worst.max((whole[(i, j)] - sum[(i, j)]).abs() / scale);
            }
        }
    });
    println!("largest difference {worst:.1e}");
    // Rounding, in sixty thousand steps.
    assert!(worst < 1e-9, "{worst:e}");
    for row in sums.expect("watched").lag_sums(&[1.0; 4]) {
        let white = if row.first_lag == 0 {
            0.5 * row.variance
        } else {
            0.0
        };
        // Beside as many products as it is the sum of.
        let off = (row.predicted - white).abs() / row.variance;
        assert!(off < 1e-9, "{row:?}");
    }
}

/// What a run costs that is watched.
#[test]
fn cost() {
    let simulation = scenario().simulate(1).expect("a ready scenario");
    let time = |watch| {
        let begin = Instant::now();
        run(&simulation, 1, &settings(), &truth(), watch, |_| {});
        begin.elapsed().as_secs_f64()
    };
    let (plain, watched) = (time(false).min(time(false)), time(true).min(time(true)));
    println!(
        "a run {plain:.3} s, watched {watched:.3} s: {:.1} times",
        watched / plain
    );
}

/// Errors of positions or velocities that wander are no white noise.
#[test]
fn coloured_gnss_is_held() {
    type Colour = fn(&mut GnssModel);
    let colours: [(&str, Colour); 5] = [
        ("positions 1 m over 60 s, white 0.3 m", |g| {
            g.position_sigma_m = [0.3; 3];
            g.position_colour_sigma_m = [1.0; 3];
            g.position_colour_tau_s = 60.0;
        }),
        ("positions 1 m over 120 s, white 0.5 m", |g| {
            g.position_colour_sigma_m = [1.0, 1.0, 2.0];
            g.position_colour_tau_s = 120.0;
        }),
        ("positions 0.5 m over 10 s", |g| {
            g.position_colour_sigma_m = [0.5; 3];
            g.position_colour_tau_s = 10.0;
        }),
        ("velocities 0.05 m/s over 10 s", |g| {
            g.velocity_colour_sigma_m_per_s = [0.05; 3];
            g.velocity_colour_tau_s = 10.0;
        }),
        ("positions 1 m over 60 s, no velocities", |g| {
            g.position_colour_sigma_m = [1.0; 3];
            g.position_colour_tau_s = 60.0;
            g.velocity_rate_hz = 0.0;
        }),
    ];
    let config = settings();
    for (name, colour) in colours {
        let mut scenario = scenario();
        colour(&mut scenario.gnss);
        let shown = over_seeds(seeds() / 2, |seed| {
            let simulation = scenario.simulate(seed).expect("a ready scenario");
            adapt(&simulation, seed, &config, truth())
        });
        println!("{name}");
        for (seed, outcome) in shown.iter().enumerate() {
            println!("  {seed}: {}", told(outcome));
            assert!(
                outcome.numbers.iter().all(|n| n.verdict == Verdict::Held),
                "{name}, seed {seed}: {outcome:?}"
            );
            assert_eq!(outcome.accepted(&truth()), truth());
        }
    }
}

/// An error that stays for a quarter of an hour is followed, and its share in what the receiver states is not taken away.
#[test]
fn errors_that_stay_are_not_told_away() {
    let mut scenario = scenario();
    scenario.gnss.position_sigma_m = [0.3; 3];
    scenario.gnss.position_colour_sigma_m = [1.0; 3];
    scenario.gnss.position_colour_tau_s = 1000.0;
    let config = settings();
    let shown = over_seeds(seeds() / 2, |seed| {
        let simulation = scenario.simulate(seed).expect("a ready scenario");
        adapt(&simulation, seed, &config, truth())
    });
    for (seed, outcome) in shown.iter().enumerate() {
        println!("  {seed}: {}", told(outcome));
        assert!(
            !outcome.is_accepted(NoiseUnknown::Position),
            "{seed}: {outcome:?}"
        );
    }
}

/// Fixes that are weighed down as if they were not independent, which is a gain that is not optimal: what the noise is follows from
/// the innovations all the same.
#[test]
fn a_filter_that_weighs_down_is_understood() {
    let scenario = scenario();
    let mut config = settings();
    config.gnss.correlation_time_s = 0.5;
    let shown = over_seeds(seeds(), |seed| {
        let simulation = scenario.simulate(seed).expect("a ready scenario");
        adapt(&simulation, seed, &config, truth())
    });
    for (seed, outcome) in shown.iter().enumerate() {
        println!("  {seed}: {}", told(outcome));
        for n in &outcome.numbers {
            let share = n.estimate.expect("seen") / truth().as_array()[n.unknown as usize];
            assert_eq!(n.verdict, Verdict::Estimated, "seed {seed}: {n:?}");
            assert!((0.75..=1.25).contains(&share), "seed {seed}: {n:?}");
        }
    }
}
