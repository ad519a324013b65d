//! What rocking does to a fit: its spectrum from the fit's residuals, through the fit's own gains.

use nalgebra::{SMatrix, SVector, Vector3};
use std::vec::Vec;

/// Rocking is looked at up to this frequency, Hz: above, a fit over minutes averages it out.
const HIGHEST: f64 = 1.0;

/// A fit tells rocking from drift when the stop holds so many of its periods.
pub(super) const PERIODS: usize = 8;

/// Rocking of one stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sway<const R: usize> {
    /// What it does to what is told of the fit, as a covariance: each frequency of [`PERIODS`] periods and more with a phase of its own.
    pub(super) covariance: SMatrix<f64, R, R>,
    /// Period of the strongest horizontal rocking, s.
    pub(super) period_s: f64,
}

/// From residuals at times `t` (s, evenly spaced but for jitter) and the gains of what is told on their rows (v north, v east,
/// yaw).
pub(super) fn sway<const R: usize>(
    t: &[f64],
    residuals: &[Vector3<f64>],
    gains: &[SMatrix<f64, R, 3>],
) -> Sway<R> {
    let length = t[t.len() - 1] - t[0];
    let spacing = length / (t.len() - 1) as f64;
    // Two samples a cycle of the highest frequency are enough, with some to spare.
    let merge = ((0.2 / HIGHEST / spacing) as usize).max(1);
    let blocks: Vec<(f64, Vector3<f64>, SMatrix<f64, R, 3>)> = t
        .chunks(merge)
        .zip(residuals.chunks(merge))
        .zip(gains.chunks(merge))
        .map(|((t, r), g)| {
            let middle = 0.5 * (t[0] + t[t.len() - 1]);
            let mean = r.iter().sum::<Vector3<f64>>() / r.len() as f64;
            (middle, mean, g.iter().sum())
        })
        .collect();
    let window: Vec<f64> = blocks
        .iter()
        .map(|(t, ..)| (core::f64::consts::PI * t / length).sin().powi(2))
        .collect();
    let power: f64 = window.iter().map(|w| w * w).sum();
    let count = blocks.len() as f64;
    let mut covariance = SMatrix::<f64, R, R>::zeros();
    let (mut strongest, mut period_s) = (0.0, length);
    for bin in 1..=(HIGHEST * length) as usize {
        let w = core::f64::consts::TAU * bin as f64 / length;
        let mut seen = [Vector3::<f64>::zeros(); 2];
        let mut felt = [SMatrix::<f64, R, 3>::zeros(); 2];
        for ((t, r, g), weight) in blocks.iter().zip(&window) {
            let (s, c) = (w * t).sin_cos();
            seen[0] += r * (c * weight);
            seen[1] += r * (s * weight);
            felt[0] += g * c;
            felt[1] += g * s;
        }
        // Variance of this frequency, one-sided.
        let variance = (seen[0].component_mul(&seen[0]) + seen[1].component_mul(&seen[1]))
            * (2.0 / (count * power));
        for channel in 0..if bin < PERIODS { 0 } else { 3 } {
            for part in &felt {
                let column: SVector<f64, R> = part.column(channel).into_owned();
                covariance += column * column.transpose() * variance[channel];
            }
        }
        let horizontal = variance.x + variance.y;
        // One period in the whole stop is what is left of drift.
        if bin > 1 && horizontal > strongest {
            (strongest, period_s) = (horizontal, length / bin as f64);
        }
    }
    Sway {
        covariance,
        period_s,
    }
}

/// Variance that rocking leaves in Σ c y over a part of a stop, c beginning at `from`: frequencies of [`PERIODS`] periods and
/// more in the whole stop, each with a phase of its own.
pub(super) fn leak(t: &[f64], residuals: &[f64], from: usize, c: &[f64]) -> f64 {
    let length = t[t.len() - 1] - t[0];
    let window = |t: f64| (core::f64::consts::PI * t / length).sin().powi(2);
    let power: f64 = t.iter().map(|t| window(*t).powi(2)).sum();
    let mut variance = 0.0;
    for bin in PERIODS..=(HIGHEST * length) as usize {
        let w = core::f64::consts::TAU * bin as f64 / length;
        let mut seen = [0.0; 2];
        for (t, r) in t.iter().zip(residuals) {
            let (sin, cos) = (w * t).sin_cos();
            let weighted = r * window(*t);
            seen[0] += weighted * cos;
            seen[1] += weighted * sin;
        }
        let mut felt = [0.0; 2];
        for (t, c) in t[from..].iter().zip(c) {
            let (sin, cos) = (w * t).sin_cos();
            felt[0] += c * cos;
            felt[1] += c * sin;
        }
        let own = 2.0 * (seen[0] * seen[0] + seen[1] * seen[1]) / (t.len() as f64 * power);
        variance += own * (felt[0] * felt[0] + felt[1] * felt[1]);
    }
    variance
}
