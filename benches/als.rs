//! What noise identification costs: solves of a general and of a small model, streaming sums, and a whole record.
//!
//! Each by the fastest of many batches, all by turns: wall time varies threefold on a shared machine. The design by Kronecker
//! products is measured beside, in the same run; only the ratio is asserted. `benches/instructions.sh` counts instructions.

// Not every bench needs all of it.
#[allow(dead_code)]
mod noise;

use criterion::{Criterion, criterion_group, criterion_main};
use insnav::noise::{
    Basis, LagAccumulator, LagCovariance, LinearModel, SolveOptions, als_design, als_solve,
    lag_covariance,
};
use nalgebra::{DMatrix, Vector1, Vector3};
use noise::{Channel, General, LAGS, batch, record, six_states};
use std::hint::black_box;
use std::time::Instant;

/// How many times quicker than the design alone with Kronecker products, lag by lag, a design and its solution must be.
const LEAST_RATIO: f64 = 8.0;

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
    seconds: f64,
}

impl Best {
    fn new(name: &'static str, calls: u32, bar: f64) -> Self {
        Best {
            name,
            calls,
            bar,
            seconds: f64::INFINITY,
        }
    }

    fn measure<T>(&mut self, mut call: impl FnMut() -> T) {
        let begin = Instant::now();
        for _ in 0..self.calls {
            black_box(call());
        }
        let each = begin.elapsed().as_secs_f64() / f64::from(self.calls);
        self.seconds = self.seconds.min(each);
    }
}

fn bars(_: &mut Criterion) {
    // `cargo test --all-targets` runs benches unoptimised, to see that they run: nothing to be judged.
    if !std::env::args().any(|a| a == "--bench") {
        return;
    }
    let (model, gain) = six_states();
    let basis = Basis::diagonal(6, 3);
    let (general, channel) = (General::new(), Channel::new());
    let flat: Vec<f64> = general
        .measured
        .iter()
        .flat_map(|m| m.as_slice().to_vec())
        .collect();
    let covariance = LagCovariance::new(3, flat, vec![1e5; LAGS]).expect("sizes fit");
    let rows: Vec<Vec<f64>> = (0..3).map(|axis| record(20_000, axis)).collect();

    let mut best = [
        Best::new("general solve, sizes known", 20, 15e-6),
        Best::new("general design, sizes at run time", 5, f64::NAN),
        Best::new("general solve, sizes at run time, with errors", 1, f64::NAN),
        Best::new("Kronecker design", 1, f64::NAN),
        Best::new("channel solve", 500, 0.5e-6),
        Best::new("streaming, one axis, by sample", 1, 15e-9),
        Best::new("streaming, three axes with cross terms, by axis", 1, 15e-9),
        Best::new("lag sums of a record, 64 lags x 20 000", 1, f64::NAN),
        Best::new("20 000 samples x 3 axes, 3 rounds", 1, 10e-3),
    ];
    let mut single = LagAccumulator::<1, 13>::new();
    let mut triple = LagAccumulator::<3, 13>::new();
    for round in 0..60 {
        let mut list = best.iter_mut();
        let mut next = || list.next().expect("as many as there are");
        next().measure(|| black_box(&general).solve());
        next().measure(|| als_design(black_box(&model), &gain, &basis, LAGS).expect("stable"));
        let whole = next();
        if round < 3 {
            whole.measure(|| {
                let design = als_design(&model, &gain, &basis, LAGS).expect("stable");
                als_solve(&design, &covariance, &SolveOptions::default()).expect("identified")
            });
        }
        next().measure(|| kronecker(black_box(&model), &gain));
        next().measure(|| black_box(&channel).solve());
        next().measure(|| {
            let row = black_box(&rows[0]);
            row.iter().for_each(|v| single.push(&Vector1::new(*v)));
        });
        next().measure(|| {
            let [x, y, z] = black_box(&rows[..]) else {
                return;
            };
            for ((x, y), z) in x.iter().zip(y).zip(z) {
                triple.push(&Vector3::new(*x, *y, *z));
            }
        });
        next().measure(|| lag_covariance(&[&rows[0]], 1, 64).expect("long"));
        next().measure(|| {
            let of = |y: &Vec<f64>| batch(y).estimate.theta[0];
            rows.iter().map(of).sum::<f64>()
        });
    }
    // A call takes the whole record, of one axis or of three.
    best[5].seconds /= rows[0].len() as f64;
    best[6].seconds /= 3.0 * rows[0].len() as f64;
    black_box((&single, &triple));
    for b in &best {
        let bar = if b.bar.is_nan() {
            String::new()
        } else {
            format!(" (bar {:.3e})", b.bar)
        };
        println!("{}: {:.3e} s{bar}", b.name, b.seconds);
    }
    let ratio = best[3].seconds / best[0].seconds;
    println!("Kronecker design / solve with sizes known: {ratio:.0}");
    assert!(ratio >= LEAST_RATIO, "ratio below {LEAST_RATIO}");
}

fn parts(c: &mut Criterion) {
    let (model, gain) = six_states();
    let basis = Basis::diagonal(6, 3);
    c.bench_function("als/design at run time", |b| {
        b.iter(|| als_design(black_box(&model), &gain, &basis, LAGS));
    });
    let channel = Channel::new();
    c.bench_function("als/channel solve", |b| {
        b.iter(|| black_box(&channel).solve());
    });
}

criterion_group!(benches, bars, parts);
criterion_main!(benches);
