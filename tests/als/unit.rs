//! Models and simulated records that several tests use.

use insnav::noise::LinearModel;
use insnav::sim::{Source, Stream};
use nalgebra::{DMatrix, DVector};

/// Whether all seeds are to be run.
pub(crate) fn long() -> bool {
    std::env::var("INSNAV_LONG").is_ok_and(|v| v == "1")
}

/// Few seeds by default.
pub(crate) fn seeds(quick: u64, full: u64) -> u64 {
    if long() { full } else { quick }
}

pub(crate) fn matrix(rows: usize, columns: usize, values: &[f64]) -> DMatrix<f64> {
    DMatrix::from_row_slice(rows, columns, values)
}

pub(crate) fn diagonal(values: &[f64]) -> DMatrix<f64> {
    DMatrix::from_diagonal(&DVector::from_column_slice(values))
}

/// System A of the examples in [Odelson06] and their package: one process noise, one measurement.
pub(crate) fn system_a() -> LinearModel {
    LinearModel {
        f: matrix(3, 3, &[0.1, 0.0, 0.1, 0.0, 0.2, 0.0, 0.0, 0.0, 0.3]),
        g: matrix(3, 1, &[1.0, 2.0, 3.0]),
        h: matrix(1, 3, &[0.1, 0.2, 0.0]),
    }
}

/// A record of a model with diagonal Q and R, after the decay of what it began with where the model is stable.
pub(crate) fn record(
    model: &LinearModel,
    q: &[f64],
    r: &[f64],
    samples: usize,
    seed: u64,
) -> Vec<f64> {
    let mut process = Source::new(seed, Stream::GyroWhite);
    let mut measurement = Source::new(seed, Stream::AccelWhite);
    let mut x = DVector::zeros(model.f.nrows());
    let mut y = Vec::with_capacity(samples * r.len());
    let settle = 200;
    for k in 0..samples + settle {
        if k >= settle {
            let clean = &model.h * &x;
            y.extend(
                clean
                    .iter()
                    .zip(r)
                    .map(|(c, r)| c + r.sqrt() * measurement.normal()),
            );
        }
        let w = DVector::from_iterator(q.len(), q.iter().map(|q| q.sqrt() * process.normal()));
        x = &model.f * &x + &model.g * w;
    }
    y
}

/// Innovations of a filter begun at zero, straight from its definition.
pub(crate) fn innovations(model: &LinearModel, gain: &DMatrix<f64>, y: &[f64]) -> Vec<f64> {
    let mut x = DVector::zeros(model.f.nrows());
    let mut out = Vec::with_capacity(y.len());
    for value in y.chunks_exact(model.h.nrows()) {
        let nu = DVector::from_column_slice(value) - &model.h * &x;
        out.extend_from_slice(nu.as_slice());
        x = &model.f * (x + gain * nu);
    }
    out
}

pub(crate) fn mean_and_deviation(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, variance.sqrt())
}

pub(crate) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}
