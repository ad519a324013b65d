//! What the orientation filter costs by sample: levelled, moved by hand, with a magnetometer and without, and smoothed.
//!
//! The fastest of many passes over one record, all by turns: wall time varies threefold on a shared machine.

mod hand;

use criterion::{Criterion, criterion_group, criterion_main};
use hand::{filtered, record, smoothed};
use std::hint::black_box;
use std::time::Instant;

fn bars(_: &mut Criterion) {
    // `cargo test --all-targets` runs benches unoptimised, to see that they run: nothing to be judged.
    if !std::env::args().any(|a| a == "--bench") {
        return;
    }
    let (samples, fields) = record(20.0);
    let mut best = [f64::INFINITY; 3];
    for _ in 0..40 {
        let passes: [&dyn Fn() -> f64; 3] = [
            &|| filtered(black_box(&samples), &fields),
            &|| filtered(black_box(&samples), &[]),
            &|| smoothed(black_box(&samples), &fields),
        ];
        for (pass, best) in passes.iter().zip(&mut best) {
            let begin = Instant::now();
            black_box(pass());
            let each = begin.elapsed().as_secs_f64() / samples.len() as f64;
            *best = best.min(each);
        }
    }
    let names = [
        "step with a field at every sample (bar 3e-7)",
        "step of six axes",
        "smoothed, by sample",
    ];
    for (name, best) in names.iter().zip(best) {
        println!("{name}: {best:.3e} s");
    }
}

fn parts(c: &mut Criterion) {
    let (samples, fields) = record(5.0);
    c.bench_function("ahrs/five seconds at 286 Hz", |b| {
        b.iter(|| filtered(black_box(&samples), &fields));
    });
}

criterion_group!(benches, bars, parts);
criterion_main!(benches);
