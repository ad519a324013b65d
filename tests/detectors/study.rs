//! The four of [Skog10]: thresholds and probabilities against their distributions, and against a study that simulated them with
//! another program.
//!
//! With noise of variance σ² the statistics are sums of squares of normal variables about what the unit feels without noise, so
//! that N T is noncentral chi-square with λ = N T of that ([Abramowitz64] 26.4.25); a window gives it, whatever shakes the unit.

use crate::unit::{
    ACCEL_BIAS, GYRO_BIAS, RATES, Shaking, Unit, idle, rest_noise, road, turn, windows,
};
use insnav::stationary::quantile::{ONE_IN_1E3, of_squares};
use insnav::stationary::{Moments, are, glrt, mag, mv};
use nalgebra::Vector3;
use statrs::distribution::{ChiSquared, ContinuousCDF};

/// MV, MAG, ARE, GLRT as the detectors have them; GLRTB: MV and ARE together with the gyro bias taken out; GYM: the mean rate
/// with the bias taken out.
const NAMES: [&str; 6] = ["MV", "MAG", "ARE", "GLRT", "GLRTB", "GYM"];

fn window_of(mut unit: Unit, seconds: f64) -> Moments {
    let mut m = Moments::default();
    for _ in 0..(unit.rate * seconds).round() as u32 {
        let (_, force, rate_b) = unit.next();
        m.push(1.0 / unit.rate, &force, &rate_b);
    }
    m
}

fn with_biases(shaking: Shaking) -> Shaking {
    Shaking {
        accel_bias: ACCEL_BIAS,
        gyro_bias: GYRO_BIAS,
        ..shaking
    }
}

fn statistics(m: &Moments) -> [f64; 6] {
    let noise = rest_noise();
    let (nothing, bias) = (Vector3::zeros(), Vector3::repeat(GYRO_BIAS));
    [
        mv::statistic(m, &noise),
        mag::statistic(m, &noise),
        are::statistic(m, &nothing, &noise),
        glrt::statistic(m, &nothing, &noise),
        mv::statistic(m, &noise) + are::statistic(m, &bias, &noise),
        m.count * (m.mean_rate() - bias).norm_squared() / noise.rate_variance(m.dt()),
    ]
}

fn thresholds(m: &Moments) -> [f64; 6] {
    let (noise, n) = (rest_noise(), m.count);
    let bias_variance = 3.0 * GYRO_BIAS * GYRO_BIAS;
    let both = 6.0 * n - 3.0;
    [
        mv::threshold(m, ONE_IN_1E3),
        mag::threshold(m, &noise, ONE_IN_1E3),
        are::threshold(m, bias_variance, &noise, ONE_IN_1E3),
        glrt::threshold(m, bias_variance, &noise, ONE_IN_1E3),
        of_squares(both, 2.0 * both, ONE_IN_1E3) / n,
        of_squares(3.0, 6.0, ONE_IN_1E3),
    ]
}

/// T over the threshold.
fn ratios(m: &Moments) -> [f64; 6] {
    let (t, limits) = (statistics(m), thresholds(m));
    core::array::from_fn(|i| t[i] / limits[i])
}

/// P(χ'² < x) with `dof` degrees of freedom and noncentrality λ: a Poisson mixture of central ones.
fn noncentral(x: f64, dof: f64, lambda: f64) -> f64 {
    let (mean, sigma) = (dof + lambda, (2.0 * (dof + 2.0 * lambda)).sqrt());
    // Beyond eight sigmas nothing is left, but for a handful of degrees of freedom.
    if dof > 20.0 && (x - mean).abs() > 8.0 * sigma {
        return f64::from(u8::from(x > mean));
    }
    let half = 0.5 * lambda;
    let reach = 8.0 * half.sqrt() + 20.0;
    let (first, last) = ((half - reach).max(0.0) as u32, (half + reach) as u32);
    let mut weight = -half;
    let mut sum = 0.0;
    for j in 0..=last {
        if j > 0 {
            weight += half.ln() - f64::from(j).ln();
        }
        if j >= first && weight > -60.0 {
            let central = ChiSquared::new(dof + 2.0 * f64::from(j)).expect("positive");
            sum += weight.exp() * central.cdf(x);
        }
        if half == 0.0 {
            break;
        }
    }
    sum
}

/// Probability of each statistic to be below its threshold, given what the unit feels without noise.
fn expected(noiseless: &Moments) -> [f64; 6] {
    let n = noiseless.count;
    let scale = [n, n, n, n, n, 1.0];
    let dof = [
        3.0 * (n - 1.0),
        n,
        3.0 * n,
        6.0 * n - 2.0,
        6.0 * n - 3.0,
        3.0,
    ];
    let (t, limits) = (statistics(noiseless), thresholds(noiseless));
    core::array::from_fn(|i| noncentral(scale[i] * limits[i], dof[i], scale[i] * t[i]))
}

/// Noncentral chi-square by simulation: what the oracle itself rests on.
#[test]
fn the_mixture_is_that_of_squares_about_a_point() {
    use insnav::sim::{Source, Stream};
    for (dof, lambda, x) in [(3, 36.0, 16.7), (30, 5.0, 40.0), (100, 400.0, 480.0)] {
        let mut source = Source::new(1, Stream::AccelWhite);
        let shift = f64::sqrt(lambda / f64::from(dof));
        let runs = 20_000;
        let below = (0..runs).filter(|_| {
            let sum: f64 = (0..dof).map(|_| (source.normal() + shift).powi(2)).sum();
            sum < x
        });
        let found = below.count() as f64 / f64::from(runs);
        let p = noncentral(x, f64::from(dof), lambda);
        let error = 4.0 * (p * (1.0 - p) / f64::from(runs)).sqrt();
        assert!((found - p).abs() < error, "{dof} {lambda}: {found} {p}");
    }
}

/// Thresholds of the study for N = 10, 50, 100, 200 samples at 100 Hz. Two digits, found by simulation.
#[test]
fn thresholds_are_those_of_the_study() {
    let study = [
        (10.0, [5.5, 5.3, 6.0, 11.5, 9.5, 16.7]),
        (50.0, [4.1, 3.4, 4.2, 9.0, 7.5, 16.7]),
        (100.0, [3.8, 2.9, 3.9, 8.4, 7.1, 16.7]),
        (200.0, [3.6, 2.7, 3.6, 8.0, 6.7, 16.7]),
    ];
    for (count, expected) in study {
        let m = Moments {
            count,
            span: count / 100.0,
            ..Moments::default()
        };
        let found = thresholds(&m);
        println!("N = {count}: {NAMES:?} {found:.2?}, the study {expected:?}");
        for (found, expected) in found.into_iter().zip(expected) {
            // Half a digit, and what biases drawn anew for each of its runs do to a quantile.
            assert!(
                (found / expected - 1.0).abs() < 0.06,
                "{count}: {found} {expected}"
            );
        }
    }
}

/// At rest one window in a thousand is above, whatever the sampling rate.
#[test]
fn at_rest_one_window_in_a_thousand_is_above() {
    for rate in RATES {
        let mut above = [0.0; 6];
        for seed in 0..windows() {
            let unit = Unit::new(seed, rate, with_biases(Shaking::default()));
            for (above, ratio) in above.iter_mut().zip(ratios(&window_of(unit, 2.0))) {
                *above += f64::from(u8::from(ratio > 1.0));
            }
        }
        let expected = 1e-3 * windows() as f64;
        println!(
            "{rate} Hz, {NAMES:?} above: {above:?} of {}, {expected} expected",
            windows()
        );
        for (name, above) in NAMES.into_iter().zip(above) {
            // Poisson, four sigmas, and a tenth for the chi-squares that stand in for the true distributions; a third of
            // that of three degrees of freedom, whose quantile by Wilson and Hilferty is 3 % high (P = 0.8e-3).
            let approximate = if name == "GYM" { 0.35 } else { 0.1 };
            assert!(
                (above - expected).abs() < 4.0 * expected.sqrt() + approximate * expected,
                "{name}: {above}"
            );
        }
    }
}

/// The table at windows of 1 s: simulated at every rate against the distributions, and at 100 Hz against the study, whose
/// thresholds have two digits: its probability must lie between those for a threshold 3 % lower and 3 % higher.
#[test]
fn probabilities_are_those_of_the_distributions_and_of_the_study() {
    let accel = Shaking {
        accel: 0.3,
        ..Shaking::default()
    };
    let held = true;
    // Whether the study's models are known: its roads, for one, turn the unit as well.
    let table = [
        (
            "idle 0.2 m/s2 + 0.2 deg/s",
            idle(0.2, 0.2),
            [0.0, 0.0, 0.98, 0.0, 0.0, 1.0],
            held,
        ),
        (
            "idle 0.5 m/s2 + 0.5 deg/s",
            idle(0.5, 0.5),
            [0.0, 0.0, 0.03, 0.0, 0.0, 1.0],
            held,
        ),
        (
            "turn 1 deg/s",
            turn(1.0),
            [1.0, 1.0, 0.0, 0.0, 0.0, 0.0],
            held,
        ),
        (
            "turn 0.3 deg/s",
            turn(0.3),
            [1.0, 1.0, 0.96, 0.99, 0.99, 0.02],
            held,
        ),
        (
            "accel 0.3 m/s2",
            accel,
            [1.0, 0.995, 1.0, 1.0, 1.0, 1.0],
            held,
        ),
        (
            "road 0.05 m/s2",
            road(0.05),
            [0.70, 0.90, 1.0, 0.87, 0.83, 1.0],
            !held,
        ),
        (
            "road 0.1 m/s2",
            road(0.1),
            [0.0, 0.08, 0.89, 0.002, 0.0, 1.0],
            !held,
        ),
        (
            "road 0.3 m/s2",
            road(0.3),
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.94],
            !held,
        ),
    ];
    println!("{:<28}{NAMES:?}", "");
    for (name, shaking, study, is_held) in table {
        for rate in RATES {
            let count = windows() as f64;
            let mut below = [[0.0; 3]; 6];
            let mut theory = [0.0; 6];
            // Phases and roads are part of the theory; two hundred of them are enough.
            let drawn = if shaking.is_drawn() { 200 } else { 1 };
            for seed in 0..windows() {
                let unit = Unit::new(seed, rate, with_biases(shaking));
                for (below, ratio) in below.iter_mut().zip(ratios(&window_of(unit, 1.0))) {
                    for (below, limit) in below.iter_mut().zip([0.97, 1.0, 1.03]) {
                        *below += f64::from(u8::from(ratio < limit)) / count;
                    }
                }
                if seed < drawn {
                    let unit = Unit::without_noise(seed, rate, with_biases(shaking));
                    let p = expected(&window_of(unit, 1.0));
                    (0..6).for_each(|i| theory[i] += p[i] / drawn as f64);
                }
            }
            let found = below.map(|b| b[1]);
            println!("{name:<21}{rate:>4} Hz {found:.3?}");
            println!("{:<28}{theory:.3?} by their distributions", "");
            if rate == 100.0 {
                println!("{:<28}{study:.3?} the study", "");
            }
            for i in 0..6 {
                let [low, middle, high] = below[i];
                let sampling = |n: f64| 4.0 * (middle * (1.0 - middle) / n).sqrt();
                // Of the windows, and of what is drawn for the theory; MAG takes the length of a force for its part along
                // gravity, and has the square of the noise across it left (7e-4 m/s² of 0.08).
                let error = sampling(count)
                    + sampling(count.min(200.0)).min(0.1) * f64::from(u8::from(drawn > 1));
                assert!(
                    (middle - theory[i]).abs() < error + 0.006,
                    "{name} {rate} Hz {}: {middle} {}",
                    NAMES[i],
                    theory[i]
                );
                if rate == 100.0 && is_held {
                    let error = sampling(count) + 0.006;
                    assert!(
                        low - error <= study[i] && study[i] <= high + error,
                        "{name} {}: {low} {high} {}",
                        NAMES[i],
                        study[i]
                    );
                }
            }
        }
    }
}
