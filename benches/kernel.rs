//! Time of the filter's parts, and of the covariance against the naive product `Φ P Φᵀ + Q`.
//!
//! Wall time varies threefold on a shared machine: the ratio that must hold is measured with both kernels by turns, and each
//! by the fastest of many batches.

mod setup;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use insnav::filter::{CAPACITY, Eskf, Gate, Transition, fill_base};
use nalgebra::{DMatrix, SMatrix, Vector3};
use std::hint::black_box;
use std::time::{Duration, Instant};

/// The most the kernel may take of the naive product's time at 15 states.
const LARGEST_RATIO: f64 = 0.45;

/// The most a step with scale factors (21 states) may take of one without.
const LARGEST_STEP_RATIO: f64 = 1.7;

/// Φ as a static matrix.
fn dense<const N: usize>(phi: &Transition) -> SMatrix<f64, N, N> {
    SMatrix::from_columns(&core::array::from_fn::<_, N, _>(|j| {
        let mut unit = [0.0; CAPACITY];
        unit[j] = 1.0;
        SMatrix::<f64, N, 1>::from_column_slice(&phi.times(&unit)[..N])
    }))
}

/// Fastest of many batches, ns per call.
fn fastest(batches: usize, calls: u32, mut run: impl FnMut()) -> f64 {
    let mut best = Duration::MAX;
    for _ in 0..batches {
        let begin = Instant::now();
        for _ in 0..calls {
            run();
        }
        best = best.min(begin.elapsed());
    }
    best.as_secs_f64() * 1e9 / f64::from(calls)
}

/// Kernel and naive product by turns: (ours, naive), ns.
fn interleaved<const N: usize>() -> (f64, f64) {
    let mut p = setup::covariance(N);
    let phi = setup::transition(p.layout());
    let (f, mut q, mut naive) = (
        dense::<N>(&phi),
        SMatrix::<f64, N, N>::zeros(),
        p.dense::<N>(),
    );
    for i in 0..N {
        q[(i, i)] = phi.noise[i];
    }
    let (mut ours, mut theirs) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..100 {
        ours = ours.min(fastest(4, 100, || p.propagate(black_box(&phi))));
        theirs = theirs.min(fastest(4, 100, || {
            naive = black_box(&f) * naive * black_box(&f).transpose() + q;
        }));
    }
    // Both have done the same: neither was optimised away.
    let d = DMatrix::from_fn(N, N, |i, j| {
        (p.dense::<N>()[(i, j)] - naive[(i, j)]).abs() / (naive[(i, i)] * naive[(j, j)]).sqrt()
    });
    assert!(d.max() < 1e-6, "the kernels disagree by {:e}", d.max());
    (ours, theirs)
}

fn ratio(_: &mut Criterion) {
    // `cargo test --all-targets` runs benches unoptimised, to see that they run: nothing to be judged.
    if !std::env::args().any(|a| a == "--bench") {
        return;
    }
    let pairs = [(15, interleaved::<15>()), (21, interleaved::<21>())];
    for (n, (ours, naive)) in pairs {
        let ratio = ours / naive;
        println!("covariance, {n} states: {ours:.0} ns, naive {naive:.0} ns, ratio {ratio:.3}");
        assert!(
            ratio <= LARGEST_RATIO,
            "{n} states: ratio above {LARGEST_RATIO}"
        );
    }
    let (mut base, mut scaled) = (setup::filter(), setup::filter_of(21));
    let (mut step, mut step_21) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..100 {
        step = step.min(fastest(4, 100, || next_step(&mut base)));
        step_21 = step_21.min(fastest(4, 100, || next_step(&mut scaled)));
    }
    let ratio = step_21 / step;
    println!("whole step: 15 states {step:.0} ns, 21 states {step_21:.0} ns, ratio {ratio:.3}");
    assert!(
        ratio <= LARGEST_STEP_RATIO,
        "21 states: ratio above {LARGEST_STEP_RATIO}"
    );
    let (mut filter, mut gate) = (setup::filter(), Gate::default());
    let fix = setup::fix(&filter);
    // Used over and over: the covariance shrinks towards the fix's, and the work stays the same.
    let update = fastest(400, 100, || {
        let time = filter.nominal().nav.time;
        black_box(filter.update(black_box(&fix), time, &mut gate)).expect("positive definite");
    });
    println!("15 states: GNSS position {update:.0} ns");
}

fn next_step(filter: &mut Eskf) {
    filter.propagate(black_box(&setup::increment(filter.nominal().nav.time)));
}

fn parts(c: &mut Criterion) {
    for n in [15, 21] {
        let mut p = setup::covariance(n);
        let phi = setup::transition(p.layout());
        c.bench_function(&format!("covariance/propagate/{n}"), |b| {
            b.iter(|| p.propagate(black_box(&phi)));
        });
        let p = setup::covariance(n);
        let h = setup::velocity_rows(p.layout());
        let r = nalgebra::Matrix3::from_diagonal_element(1e-4);
        c.bench_function(&format!("covariance/zero velocity/{n}"), |b| {
            b.iter_batched_ref(
                || p.clone(),
                |p| {
                    let innovation = p
                        .innovation(&h, black_box(&r), &Vector3::zeros())
                        .expect("positive definite");
                    p.correct(&innovation, &h, &r)
                },
                BatchSize::SmallInput,
            );
        });
    }
    let layout = *setup::filter().covariance().layout();
    let (interval, noise, mut phi) = (setup::interval(), setup::noise(), Transition::default());
    c.bench_function("dynamics/15", |b| {
        b.iter(|| fill_base(&mut phi, &layout, black_box(&interval), &noise));
    });
    let mut nav = setup::nav();
    c.bench_function("mechanization", |b| {
        b.iter(|| nav.advance(black_box(&setup::increment(nav.time))));
    });
}

fn whole(c: &mut Criterion) {
    for n in [15, 21] {
        let mut filter = setup::filter_of(n);
        c.bench_function(&format!("step/{n}"), |b| b.iter(|| next_step(&mut filter)));
    }
    let filter = setup::filter();
    let fix = setup::fix(&filter);
    c.bench_function("gnss position/15", |b| {
        b.iter_batched_ref(
            || (filter.clone(), Gate::default()),
            |(filter, gate)| filter.update(black_box(&fix), filter.nominal().nav.time, gate),
            BatchSize::SmallInput,
        );
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default().measurement_time(Duration::from_secs(2)).warm_up_time(Duration::from_millis(500));
    targets = ratio, parts, whole
}
criterion_main!(benches);
