//! Noise of one attitude angle: how near to what is possible, from starts wrong by a hundred.
//!
//! ADIS16405 at 32 ms: gyro noise 2 °/√h, an accelerometer's angle to 0.109°, the bias noise known.

use crate::unit::{long, mean_and_deviation, median, record, seeds};
use insnav::noise::{
    Basis, Constraint, EstimateOptions, Identified, LinearModel, MdmOptions, SolveOptions, Verdict,
    Weight, als_design, als_estimate, als_solve, attitude_differences, bias_noise_per_step,
    lag_covariance, mdm_estimate, measurements_of_innovations,
};
use nalgebra::DMatrix;

const STEP: f64 = 0.032;
const BIAS_TIME: f64 = 100.0;

fn truth() -> [f64; 3] {
    let arw = (2.0f64 / 60.0).to_radians();
    [
        arw * arw * STEP,
        bias_noise_per_step(0.007f64.to_radians(), BIAS_TIME, STEP),
        0.109f64.to_radians().powi(2),
    ]
}

fn model() -> LinearModel {
    LinearModel::attitude_channel(STEP, BIAS_TIME)
}

fn options() -> EstimateOptions {
    EstimateOptions {
        solve: SolveOptions {
            known: vec![None, Some(truth()[1]), None],
            ..Default::default()
        },
        ..Default::default()
    }
}

fn simulate(samples: usize, seed: u64) -> Vec<f64> {
    let [q, bias, r] = truth();
    record(&model(), &[q, bias], &[r], samples, seed)
}

const STARTS: [[f64; 2]; 3] = [[100.0, 1.0], [0.01, 1.0], [1.0, 100.0]];

fn estimate(y: &[f64], factors: [f64; 2]) -> Identified {
    let [q, bias, r] = truth();
    let start = [q * factors[0], bias, r * factors[1]];
    als_estimate(&[y], &model(), &Basis::diagonal(2, 1), &start, &options()).expect("identified")
}

/// Cramér–Rao bounds (relative, one sigma) of q and r, by Whittle's likelihood: information N/4π ∫ SᵢSⱼ/S² dω of the spectrum
/// of the differences of what is measured.
fn bounds(samples: usize) -> [f64; 2] {
    let [q, bias, r] = truth();
    let phi = (-STEP / BIAS_TIME).exp();
    let points = 200_000;
    let mut information = [[0.0; 2]; 2];
    for i in 0..points {
        let w = (f64::from(i) + 0.5) / f64::from(points) * std::f64::consts::PI;
        let distance = |a: f64| 1.0 - 2.0 * a * w.cos() + a * a;
        let shares = [q, r * distance(1.0)];
        let all = shares[0] + shares[1] + STEP * STEP * bias / distance(phi);
        for a in 0..2 {
            for b in 0..2 {
                information[a][b] += shares[a] * shares[b] / (all * all);
            }
        }
    }
    let scale = samples as f64 / 2.0 / f64::from(points);
    let [[a, b], [_, d]] = information.map(|row| row.map(|v| v * scale));
    let determinant = a * d - b * b;
    [(d / determinant).sqrt(), (a / determinant).sqrt()]
}

/// RMS error of the corrected angle of a filter with this gain, at the true noise.
fn filtered_rms(gain: &DMatrix<f64>) -> f64 {
    let [q, bias, r] = truth();
    let model = model();
    let closed = model.closed_loop(gain);
    let fl = &model.f * gain;
    let mut p = DMatrix::from_row_slice(2, 2, &[q, 0.0, 0.0, bias]) + &fl * r * fl.transpose();
    let mut power = closed;
    for _ in 0..40 {
        p += &power * &p * power.transpose();
        power = &power * &power;
    }
    let keep = 1.0 - gain[0];
    (keep * keep * p[(0, 0)] + gain[0] * gain[0] * r).sqrt()
}

fn oracle() -> f64 {
    let [q, bias, r] = truth();
    let q = DMatrix::from_row_slice(2, 2, &[q, 0.0, 0.0, bias]);
    let filter = model().stationary_filter(&q, &DMatrix::from_element(1, 1, r));
    filtered_rms(&filter.expect("stable").gain)
}

/// A5 to A8 at the length of a record: (samples, filter's RMS over the oracle's).
#[test]
fn efficient_honest_and_independent_of_the_start() {
    let lengths: &[(usize, f64)] = if long() {
        &[(1000, 0.02), (5000, 0.005), (20_000, 0.001)]
    } else {
        &[(1000, 0.02), (5000, 0.005)]
    };
    for &(samples, excess) in lengths {
        let [bound_q, bound_r] = bounds(samples);
        let runs = seeds(24, 100);
        let mut medians = Vec::new();
        for factors in STARTS {
            let (mut q, mut r, mut within, mut zeros, mut rms) = (vec![], vec![], 0, 0, vec![]);
            for seed in 0..runs {
                let found = estimate(&simulate(samples, seed), factors);
                for (i, list) in [(0, &mut q), (2, &mut r)] {
                    let value = found.estimate.theta[i];
                    list.push(value / truth()[i]);
                    let z = (value - truth()[i]) / found.estimate.standard_errors[i];
                    within += u32::from(z.abs() < 2.0);
                }
                zeros += u32::from(found.estimate.verdicts[0] == Verdict::OnBound);
                rms.push(filtered_rms(&found.filter.gain) / oracle() - 1.0);
            }
            let ((mq, sq), (mr, sr)) = (mean_and_deviation(&q), mean_and_deviation(&r));
            let share = f64::from(within) / (2 * runs) as f64;
            let excess_rms = mean_and_deviation(&rms).0;
            println!(
                "N {samples} start {factors:?}: q {mq:.3} +- {sq:.3} (bound {bound_q:.3}), r {mr:.4} +- {sr:.4} ({bound_r:.4}), |z|<2 {share:.3}, zeros {zeros}, rms + {:.3} %",
                100.0 * excess_rms
            );
            // The deviation of a deviation from so many runs is 1/√(2 runs): three of them on top when there are few.
            let chance = if long() {
                1.0
            } else {
                1.0 + 3.0 / (2.0 * runs as f64).sqrt()
            };
            assert!(sq <= 1.25 * bound_q * chance, "A5: {sq} {bound_q}");
            assert!(sr <= 1.10 * bound_r * chance, "A5: {sr} {bound_r}");
            // A quarter of a deviation, and what a mean of so many scatters by.
            let bias = if long() {
                0.25
            } else {
                0.25 + 2.0 / (runs as f64).sqrt()
            };
            assert!(
                (mq - 1.0).abs() <= bias * sq && (mr - 1.0).abs() <= bias * sr,
                "A5: {mq} {mr}"
            );
            assert!((0.88..=0.99).contains(&share) || !long(), "A6: {share}");
            assert!(share > 0.8, "A6: {share}");
            assert_eq!(zeros, 0, "A7");
            assert!(excess_rms <= excess, "A8: {excess_rms}");
            medians.push([median(&q), median(&r)]);
        }
        for m in &medians {
            for i in 0..2 {
                assert!((m[i] / medians[0][i] - 1.0).abs() < 0.02, "A5: {medians:?}");
            }
        }
    }
}

/// Negative control: one pass with equal weights from a start a hundred times too large.
#[test]
fn without_weight_and_second_pass_it_is_four_times_worse() {
    let samples = 5000;
    let [q, bias, r] = truth();
    let plain = EstimateOptions {
        rounds: 1,
        hold_unidentified: false,
        solve: SolveOptions {
            weight: Weight::Identity,
            constraint: Constraint::None,
            ..options().solve
        },
        ..options()
    };
    let (mut good, mut bad) = (vec![], vec![]);
    for seed in 0..seeds(20, 100) {
        let y = simulate(samples, seed);
        let basis = Basis::diagonal(2, 1);
        let found = als_estimate(&[&y], &model(), &basis, &[100.0 * q, bias, r], &plain);
        bad.push(found.map_or(0.0, |f| f.estimate.theta[0] / q));
        good.push(estimate(&y, [100.0, 1.0]).estimate.theta[0] / q);
    }
    let (good, bad) = (mean_and_deviation(&good).1, mean_and_deviation(&bad).1);
    println!("q, deviation: {good:.3} weighted and filtered again, {bad:.3} plain");
    assert!(bad > 4.0 * good, "{bad} {good}");
}

/// Where the measurement noise is coloured no white model fits, and the test of fit says so.
#[test]
fn coloured_noise_does_not_fit() {
    let (mut worst_white, mut best_coloured): (f64, f64) = (0.0, f64::INFINITY);
    for seed in 0..seeds(10, 100) {
        let y = simulate(20_000, seed);
        let white = estimate(&y, [1.0, 1.0]).estimate;
        assert!(white.fits());
        worst_white = worst_white.max(white.chi2 / white.dof as f64);
        // Accelerations of 0.1 m/s² that nobody modelled, correlated over some five samples: an error of 0.6°.
        let noise = record(
            &LinearModel {
                f: DMatrix::from_element(1, 1, 0.8),
                g: DMatrix::identity(1, 1),
                h: DMatrix::identity(1, 1),
            },
            &[0.01f64.powi(2) * 0.36],
            &[0.0],
            20_000,
            seed + 1000,
        );
        let y: Vec<f64> = y.iter().zip(&noise).map(|(y, n)| y + n).collect();
        let coloured = estimate(&y, [1.0, 1.0]).estimate;
        assert!(
            !coloured.fits(),
            "seed {seed}: {} of {}",
            coloured.chi2,
            coloured.dof
        );
        best_coloured = best_coloured.min(coloured.chi2 / coloured.dof as f64);
    }
    println!("chi2/dof: white at most {worst_white:.2}, coloured at least {best_coloured:.2}");
}

/// χ² has the mean of its degrees of freedom.
#[test]
fn chi_square_is_one() {
    let runs = seeds(20, 100);
    let values: Vec<f64> = (0..runs)
        .map(|seed| {
            let found = estimate(&simulate(20_000, seed), [1.0, 1.0]).estimate;
            found.chi2 / found.dof as f64
        })
        .collect();
    let mean = mean_and_deviation(&values).0;
    println!("chi2/dof {mean:.3}");
    // Sixty-two degrees of freedom: a deviation of 0.18 each; and 64 lags of 20 000 for what Bartlett neglects.
    assert!(
        (mean - 1.0).abs() < 4.0 * 0.18 / (runs as f64).sqrt() + 0.01,
        "{mean}"
    );
}

/// Innovations of any filter are as good as the measurements.
#[test]
fn innovations_serve_as_well() {
    let y = simulate(5000, 3);
    let gain = DMatrix::from_row_slice(2, 1, &[0.3, -0.02]);
    let nu = crate::unit::innovations(&model(), &gain, &y);
    let again = measurements_of_innovations(&model(), &gain, &nu).expect("fits");
    let (a, b) = (estimate(&y, [1.0, 1.0]), estimate(&again, [1.0, 1.0]));
    for i in [0, 2] {
        let ratio = a.estimate.theta[i] / b.estimate.theta[i];
        assert!((ratio - 1.0).abs() < 1e-6, "{ratio}");
    }
}

/// Runs with gaps between them are as good as one of their length.
#[test]
fn runs_add_up() {
    let whole = simulate(6000, 5);
    let parts = [&whole[..2000], &whole[2500..4500], &whole[5000..]];
    let [q, bias, r] = truth();
    let found = als_estimate(
        &parts,
        &model(),
        &Basis::diagonal(2, 1),
        &[q, bias, r],
        &options(),
    )
    .expect("identified")
    .estimate;
    let [bound_q, bound_r] = bounds(5000);
    // Four bounds.
    assert!(
        (found.theta[0] / q - 1.0).abs() < 4.0 * bound_q,
        "{}",
        found.theta[0] / q
    );
    assert!(
        (found.theta[2] / r - 1.0).abs() < 4.0 * bound_r,
        "{}",
        found.theta[2] / r
    );
    assert!((found.standard_errors[0] / q / bound_q - 1.0).abs() < 0.5);
}

/// The bias noise of half a minute: said not to be identifiable, and kept.
#[test]
fn bias_noise_is_held_where_it_cannot_be_seen() {
    let [q, bias, r] = truth();
    let free = EstimateOptions::default();
    let mut held = 0;
    let runs = seeds(10, 50);
    for seed in 0..runs {
        let y = simulate(2000, seed);
        let found = als_estimate(
            &[&y],
            &model(),
            &Basis::diagonal(2, 1),
            &[q, bias, r],
            &free,
        )
        .expect("identified")
        .estimate;
        if found.verdicts[1] == Verdict::Held {
            held += 1;
            assert_eq!((found.theta[1], found.standard_errors[1]), (bias, 0.0));
        }
    }
    // Its standard error is several times its value; an estimate that is several times as large by chance counts as seen.
    assert!(held * 10 >= runs * 8, "{held} of {runs}");
}

/// Without filter and start value: within twice the bound of Cramér and Rao, by plain differences four times.
#[test]
fn measurement_differences_give_a_start() {
    let [q, bias, r] = truth();
    // Each stack gives its angle and its bias away: it must be long against the time that these take to be known.
    let options = MdmOptions {
        span: 150,
        known: vec![None, Some(bias), None],
        ..Default::default()
    };
    let (mut of_q, mut of_r, mut plain_q, mut plain_r) = (vec![], vec![], vec![], vec![]);
    for seed in 0..seeds(10, 100) {
        let y = simulate(5000, seed);
        let found = mdm_estimate(&[&y], &model(), &Basis::diagonal(2, 1), &options).expect("found");
        of_q.push(found.theta[0] / q);
        of_r.push(found.theta[2] / r);
        let still = vec![0.0; y.len()];
        let spans: Vec<usize> = (1..=50).collect();
        let (a, b) = attitude_differences(&y, &still, &spans).expect("found");
        plain_q.push(a / q);
        plain_r.push(b / r);
    }
    for (name, list, widest) in [
        ("stacks, q", &of_q, 2.0 * bounds(5000)[0]),
        ("stacks, r", &of_r, 2.0 * bounds(5000)[1]),
        ("spans, q", &plain_q, 4.0 * bounds(5000)[0]),
        ("spans, r", &plain_r, 4.0 * bounds(5000)[1]),
    ] {
        let (mean, deviation) = mean_and_deviation(list);
        println!("{name} {mean:.3} +- {deviation:.3}");
        assert!(deviation < widest, "{name}: {deviation}");
        assert!(
            (mean - 1.0).abs() < 0.25 * widest + 3.0 * deviation / (list.len() as f64).sqrt(),
            "{name}: {mean}"
        );
    }
}

/// A4: system A of the published examples, 4000 samples, the guess five and three times too large.
#[test]
fn published_example_is_unbiased() {
    let model = crate::unit::system_a();
    let wrong = model
        .stationary_filter(
            &DMatrix::from_element(1, 1, 5.0 * 0.5),
            &DMatrix::from_element(1, 1, 3.0 * 0.1),
        )
        .expect("stable");
    let design = als_design(&model, &wrong.gain, &Basis::diagonal(1, 1), 15).expect("stable");
    for weight in [Weight::Identity, Weight::Bartlett] {
        let options = SolveOptions {
            weight,
            ..Default::default()
        };
        let (mut q, mut r) = (vec![], vec![]);
        // Cramér–Rao: 0.0613 and 0.0151, and a deviation from so many runs is known to 2 %.
        let runs = 1500;
        for seed in 0..runs {
            let y = record(&model, &[0.5], &[0.1], 4000, seed);
            let nu = crate::unit::innovations(&model, &wrong.gain, &y);
            let covariance = lag_covariance(&[&nu], 1, 15).expect("long");
            let found = als_solve(&design, &covariance, &options).expect("identified");
            q.push(found.theta[0]);
            r.push(found.theta[1]);
        }
        let ((mq, sq), (mr, sr)) = (mean_and_deviation(&q), mean_and_deviation(&r));
        println!("{weight:?}: q {mq:.4} +- {sq:.4}, r {mr:.4} +- {sr:.4}");
        let error = 4.0 / (runs as f64).sqrt();
        assert!((mq - 0.5).abs() < error * sq && (mr - 0.1).abs() < error * sr);
        if weight == Weight::Bartlett {
            assert!((0.045..0.065).contains(&sq) && (0.011..0.016).contains(&sr));
        }
    }
}
