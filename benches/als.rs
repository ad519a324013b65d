//! What noise identification costs: solves of a general and of a small model, streaming sums, and a whole record.
//!
//! Each by the fastest of many batches, all by turns: wall time varies threefold on a shared machine. The design by Kronecker
//! products is measured beside, in the same run; only the ratio is asserted.

use criterion::{Criterion, criterion_group, criterion_main};
use insnav::noise::{
    Basis, Block, ChannelDesign, EstimateOptions, FixedDesign, FixedUnknown, LagAccumulator,
    LinearModel, SolveOptions, als_design, als_estimate, als_solve, bias_noise_per_step,
    lag_covariance,
};
use insnav::sim::{Source, Stream};
use nalgebra::{DMatrix, Matrix2, RowVector2, SMatrix, Vector1, Vector2};
use std::hint::black_box;
use std::time::{Duration, Instant};

const LAGS: usize = 40;
const STEP: f64 = 0.032;
/// How many times quicker than the design alone with Kronecker products, lag by lag, a design and its solution must be.
const LEAST_RATIO: f64 = 8.0;

/// Six states that all depend on one another: a body-frame attitude error at 40 °/s about a skew axis.
fn general() -> (LinearModel, DMatrix<f64>) {
    let mut model = LinearModel::attitude_axes(STEP, 100.0);
    let w = [0.4, -0.35, 0.45].map(|w| w * STEP);
    for (i, j, v) in [(0, 1, w[2]), (1, 2, w[0]), (2, 0, w[1])] {
        model.f[(i, j)] += v;
        model.f[(j, i)] -= v;
    }
    let noise = truth();
    let q = DMatrix::from_fn(6, 6, |i, j| if i == j { noise[i / 3] } else { 0.0 });
    let r = DMatrix::identity(3, 3) * noise[2];
    let gain = model.stationary_filter(&q, &r).expect("stable").gain;
    (model, gain)
}

fn truth() -> [f64; 3] {
    let arw = (2.0f64 / 60.0).to_radians();
    [
        arw * arw * STEP,
        bias_noise_per_step(0.007f64.to_radians(), 100.0, STEP),
        0.109f64.to_radians().powi(2),
    ]
}

/// One inverse of I − F̄ ⊗ F̄ and Kronecker products for each lag, all elements of Q and R. The published Ψ ⊗ Ψ would be
/// 14 400 × 14 400.
fn kronecker(model: &LinearModel, gain: &DMatrix<f64>) -> DMatrix<f64> {
    let (n, p) = (6, 3);
    let fl = &model.f * gain;
    let closed = model.closed_loop(gain);
    let lyapunov = (DMatrix::identity(n * n, n * n) - closed.kronecker(&closed))
        .try_inverse()
        .expect("stable");
    let of_q = &lyapunov * model.g.kronecker(&model.g);
    let of_r = &lyapunov * fl.kronecker(&fl);
    let mut design = DMatrix::zeros(LAGS * p * p, n * n + p * p);
    let mut power = DMatrix::identity(n, n);
    let mut before = DMatrix::zeros(n, n);
    for lag in 0..LAGS {
        let observe = model.h.kronecker(&(&model.h * &power));
        let direct = if lag == 0 {
            DMatrix::identity(p * p, p * p)
        } else {
            -DMatrix::identity(p, p).kronecker(&(&model.h * &before * &fl))
        };
        design
            .view_mut((lag * p * p, 0), (p * p, n * n))
            .copy_from(&(&observe * &of_q));
        design
            .view_mut((lag * p * p, n * n), (p * p, p * p))
            .copy_from(&(&observe * &of_r + direct));
        before.copy_from(&power);
        power = &power * &closed;
    }
    design
}

/// Least time of one call in batches of `calls`.
struct Best {
    name: &'static str,
    calls: u32,
    bar: f64,
    time: Duration,
}

impl Best {
    fn new(name: &'static str, calls: u32, bar: f64) -> Self {
        Best {
            name,
            calls,
            bar,
            time: Duration::MAX,
        }
    }

    fn measure<T>(&mut self, mut call: impl FnMut() -> T) {
        let begin = Instant::now();
        for _ in 0..self.calls {
            black_box(call());
        }
        self.time = self.time.min(begin.elapsed() / self.calls);
    }

    fn seconds(&self) -> f64 {
        self.time.as_secs_f64()
    }
}

fn record(samples: usize, seed: u64) -> Vec<f64> {
    let [q, bias, r] = truth().map(f64::sqrt);
    let mut white = Source::new(seed, Stream::GyroWhite);
    let mut drift = Source::new(seed, Stream::GyroBias);
    let mut angle = Source::new(seed, Stream::AccelWhite);
    let (mut theta, mut b) = (0.0, 0.0);
    (0..samples)
        .map(|_| {
            theta += q * white.normal() - STEP * b;
            b = (-STEP / 100.0f64).exp() * b + bias * drift.normal();
            theta + r * angle.normal()
        })
        .collect()
}

fn fixed(model: &LinearModel) -> (SMatrix<f64, 6, 6>, SMatrix<f64, 3, 6>) {
    (
        SMatrix::from_fn(|i, j| model.f[(i, j)]),
        SMatrix::from_fn(|i, j| model.h[(i, j)]),
    )
}

fn bars(_: &mut Criterion) {
    // `cargo test --all-targets` runs benches unoptimised, to see that they run: nothing to be judged.
    if !std::env::args().any(|a| a == "--bench") {
        return;
    }
    let (model, gain) = general();
    let basis = Basis::diagonal(6, 3);
    let (f, h) = fixed(&model);
    let l = SMatrix::<f64, 6, 3>::from_fn(|i, j| gain[(i, j)]);
    let unknowns: [FixedUnknown<6, 3>; 9] = core::array::from_fn(|i| {
        let unknown = &basis.unknowns()[i];
        match unknown.block {
            Block::Process => {
                FixedUnknown::Process(SMatrix::from_fn(|a, b| unknown.matrix[(a, b)]))
            }
            Block::Measurement => {
                FixedUnknown::Measurement(SMatrix::from_fn(|a, b| unknown.matrix[(a, b)]))
            }
        }
    });
    let theta: [f64; 9] = core::array::from_fn(|i| truth()[i / 3]);
    let design = FixedDesign::new(&f, &h, &l, &unknowns).expect("stable");
    let measured = design.covariances::<LAGS>(&theta);
    let flat: Vec<f64> = measured
        .iter()
        .flat_map(|m| m.as_slice().to_vec())
        .collect();
    let counts = vec![1e5; LAGS];
    let covariance = insnav::noise::LagCovariance::new(3, flat, counts).expect("sizes fit");

    let (f2, h2) = (
        Matrix2::new(1.0, -STEP, 0.0, 0.9997),
        RowVector2::new(1.0, 0.0),
    );
    let l2 = Vector2::new(0.06, -0.01);
    let [q, bias, r] = truth();
    let channel = ChannelDesign::<LAGS>::new(&f2, &h2, &l2).expect("stable");
    let channel_measured = channel.covariances(truth());

    let rows: Vec<Vec<f64>> = (0..3).map(|axis| record(20_000, axis)).collect();
    let one = EstimateOptions {
        solve: SolveOptions {
            known: vec![None, Some(bias), None],
            ..Default::default()
        },
        ..Default::default()
    };
    let channel_model = LinearModel::attitude_channel(STEP, 100.0);
    let channel_basis = Basis::diagonal(2, 1);

    let mut best = [
        Best::new("general solve, sizes known", 20, 15e-6),
        Best::new("general design, sizes at run time", 5, f64::NAN),
        Best::new("general solve, sizes at run time, with errors", 1, f64::NAN),
        Best::new("Kronecker design", 1, f64::NAN),
        Best::new("channel solve", 500, 0.5e-6),
        Best::new("streaming, one axis, by sample", 10_000, 15e-9),
        Best::new(
            "streaming, three axes with cross terms, by axis",
            5000,
            15e-9,
        ),
        Best::new("lag sums of a record, 64 lags x 20 000", 1, f64::NAN),
        Best::new("20 000 samples x 3 axes, 3 rounds", 1, 10e-3),
    ];
    let mut single = LagAccumulator::<1, 13>::new();
    let mut triple = LagAccumulator::<3, 13>::new();
    for round in 0..60 {
        let mut list = best.iter_mut();
        let mut next = || list.next().expect("as many as there are");
        next().measure(|| {
            let design = FixedDesign::new(black_box(&f), &h, &l, &unknowns).expect("stable");
            design.solve(black_box(&measured)).expect("identified")
        });
        next().measure(|| als_design(black_box(&model), &gain, &basis, LAGS).expect("stable"));
        let whole = next();
        if round < 3 {
            whole.measure(|| {
                let design = als_design(&model, &gain, &basis, LAGS).expect("stable");
                als_solve(&design, &covariance, &SolveOptions::default()).expect("identified")
            });
        }
        next().measure(|| kronecker(black_box(&model), &gain));
        next().measure(|| {
            let design = ChannelDesign::<LAGS>::new(black_box(&f2), &h2, &l2).expect("stable");
            design.solve(black_box(&channel_measured), [None; 3])
        });
        let mut k = 0;
        next().measure(|| {
            k = (k + 1) % 20_000;
            single.push(&Vector1::new(rows[0][k]));
        });
        next().measure(|| {
            k = (k + 1) % 20_000;
            triple.push(&nalgebra::Vector3::new(rows[0][k], rows[1][k], rows[2][k]));
        });
        next().measure(|| lag_covariance(&[&rows[0]], 1, 64).expect("long"));
        next().measure(|| {
            rows.iter()
                .map(|y| {
                    let found = als_estimate(
                        &[y],
                        &channel_model,
                        &channel_basis,
                        &[100.0 * q, bias, r],
                        &one,
                    );
                    found.expect("identified").estimate.theta[0]
                })
                .sum::<f64>()
        });
    }
    // Three axes to a call.
    best[6].time /= 3;
    black_box((&single, &triple));
    for b in &best {
        let bar = if b.bar.is_nan() {
            String::new()
        } else {
            format!(" (bar {:.3e})", b.bar)
        };
        println!("{}: {:.3e} s{bar}", b.name, b.seconds());
    }
    let ratio = best[3].seconds() / best[0].seconds();
    println!("Kronecker design / solve with sizes known: {ratio:.0}");
    assert!(ratio >= LEAST_RATIO, "ratio below {LEAST_RATIO}");
}

fn parts(c: &mut Criterion) {
    let (model, gain) = general();
    let basis = Basis::diagonal(6, 3);
    c.bench_function("als/design at run time", |b| {
        b.iter(|| als_design(black_box(&model), &gain, &basis, LAGS));
    });
    let (f2, h2) = (
        Matrix2::new(1.0, -STEP, 0.0, 0.9997),
        RowVector2::new(1.0, 0.0),
    );
    c.bench_function("als/channel solve", |b| {
        b.iter(|| {
            let l = black_box(Vector2::new(0.06, -0.01));
            let design = ChannelDesign::<LAGS>::new(&f2, &h2, &l)?;
            design.solve(&design.covariances(truth()), [None; 3])
        });
    });
}

criterion_group!(benches, bars, parts);
criterion_main!(benches);
