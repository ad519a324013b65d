//! Windows through one filter: what is constant fitted and taken out, the rest summed up by lags.

use super::turned::{Constant, Turned};
use crate::noise::lag_covariance::cross_sums;
use crate::noise::{
    Basis, Block, Estimate, LagCovariance, LinearModel, Refusal, SolveOptions, StationaryFilter,
    als_design, als_solve,
};
use nalgebra::{Matrix2, Vector2};
use std::vec::Vec;

/// A gain is not made of less than this share of an unknown's standard error.
const LEAST_OF_STANDARD_ERROR: f64 = 0.1;

/// The unknowns of a channel, per step: noise of the angle, of the bias, of the measurement.
pub(super) const ANGLE: usize = 0;
pub(super) const BIAS: usize = 1;
pub(super) const MEASURED: usize = 2;

/// Model, basis and settings for all windows of one kind.
pub(super) struct Channel {
    model: LinearModel,
    basis: Basis,
    pub(super) lags: usize,
    rounds: usize,
}

impl Channel {
    pub(super) fn new(step_s: f64, lags: usize, rounds: usize) -> Self {
        Channel {
            // The bias as a random walk: its correlation time is far beyond any window.
            model: LinearModel::attitude_channel(step_s, f64::INFINITY),
            basis: Basis::diagonal(2, 1),
            lags,
            rounds,
        }
    }

    pub(super) fn filter(&self, theta: &[f64; 3]) -> Result<StationaryFilter, Refusal> {
        self.model.stationary_filter(
            &self.basis.covariance(Block::Process, theta),
            &self.basis.covariance(Block::Measurement, theta),
        )
    }

    /// Innovations of a window, with what is constant fitted.
    pub(super) fn residuals(
        &self,
        window: &Turned,
        theta: &[f64; 3],
        filter: &StationaryFilter,
    ) -> Residuals {
        let gain = Vector2::new(filter.gain[(0, 0)], filter.gain[(1, 0)]);
        let f = Matrix2::from_fn(|i, j| self.model.f[(i, j)]);
        let filtered = |series: &[Vec<f64>]| -> Vec<f64> {
            series
                .iter()
                .flat_map(|s| {
                    let mut x = Vector2::zeros();
                    s.iter()
                        .map(|y| {
                            let nu = y - x[0];
                            x = f * (x + gain * nu);
                            nu
                        })
                        .collect::<Vec<f64>>()
                })
                .collect()
        };
        let sigma = (filter.predicted[(0, 0)] + theta[MEASURED])
            .max(f64::MIN_POSITIVE)
            .sqrt();
        let mut left = filtered(&window.channels);
        let mut kept: Vec<Kept> = Vec::new();
        for (index, response) in window.responses.iter().enumerate() {
            let mut column = filtered(&response.channels);
            let before: Vec<f64> = kept
                .iter()
                .map(|k| {
                    let share = dot(&k.column, &column);
                    subtract(&mut column, &k.column, share);
                    share
                })
                .collect();
            let length = dot(&column, &column).sqrt();
            // Even a likely constant would not show by one sigma.
            let shows = length * response.size;
            if shows <= sigma || shows.is_nan() {
                continue;
            }
            column.iter_mut().for_each(|v| *v /= length);
            let share = dot(&column, &left);
            subtract(&mut left, &column, share);
            kept.push(Kept {
                index,
                what: response.what,
                column,
                before,
                length,
                share,
            });
        }
        // Triangular: each constant less what the later ones have of it.
        let mut constants = vec![0.0; kept.len()];
        for a in (0..kept.len()).rev() {
            let later: f64 = (a + 1..kept.len())
                .map(|b| kept[b].before[a] * constants[b])
                .sum();
            constants[a] = (kept[a].share - later) / kept[a].length;
        }
        Residuals {
            channels: window.channels.len(),
            constants: kept
                .iter()
                .zip(constants)
                .map(|(k, value)| (k.index, k.what, value))
                .collect(),
            fitted: kept.into_iter().map(|k| k.column).collect(),
            left,
        }
    }

    /// Noise of several windows that share it, from a start for the gain. `known` is the bias noise per step, if it is not free.
    pub(super) fn estimate(
        &self,
        windows: &[&Turned],
        start: [f64; 3],
        known_bias: Option<f64>,
    ) -> Result<Fitted, Refusal> {
        let mut theta = start;
        if let Some(known) = known_bias {
            theta[BIAS] = known;
        }
        let options = SolveOptions {
            known: vec![None, known_bias, None],
            ..SolveOptions::default()
        };
        let mut rounds = 0;
        loop {
            let filter = self.filter(&theta)?;
            let residuals: Vec<Residuals> = windows
                .iter()
                .map(|w| self.residuals(w, &theta, &filter))
                .collect();
            let covariance = lag_sums(&residuals, self.lags)?;
            let design = als_design(&self.model, &filter.gain, &self.basis, self.lags)?;
            let estimate = als_solve(&design, &covariance, &options)?;
            rounds += 1;
            for i in [ANGLE, BIAS, MEASURED] {
                if i != BIAS || known_bias.is_none() {
                    let least = LEAST_OF_STANDARD_ERROR * estimate.standard_errors[i];
                    theta[i] = estimate.theta[i].max(least);
                }
            }
            if rounds >= self.rounds {
                let kurtosis = excess_kurtosis(&residuals);
                return Ok(Fitted { estimate, kurtosis });
            }
        }
    }
}

/// What an estimate says of windows.
#[derive(Clone)]
pub(super) struct Fitted {
    pub(super) estimate: Estimate,
    /// Excess kurtosis of the innovations and its standard error for Gaussian noise.
    pub(super) kurtosis: (f64, f64),
}

struct Kept {
    index: usize,
    what: Constant,
    column: Vec<f64>,
    before: Vec<f64>,
    length: f64,
    share: f64,
}

/// Innovations of a window, channels one behind the other.
pub(super) struct Residuals {
    channels: usize,
    /// Index among the responses, what it is, its value.
    pub(super) constants: Vec<(usize, Constant, f64)>,
    /// Orthonormal directions that are taken out.
    fitted: Vec<Vec<f64>>,
    pub(super) left: Vec<f64>,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn subtract(from: &mut [f64], direction: &[f64], share: f64) {
    from.iter_mut()
        .zip(direction)
        .for_each(|(v, d)| *v -= share * d);
}

/// Lag covariances of what is left, with what the fit took added as if the innovations were white: at the right gain they are.
fn lag_sums(residuals: &[Residuals], lags: usize) -> Result<LagCovariance, Refusal> {
    let mut sums = vec![0.0; lags];
    let mut counts = vec![0.0; lags];
    for r in residuals {
        let length = r.left.len() / r.channels;
        if length <= lags {
            continue;
        }
        let freedom = (r.left.len() - r.fitted.len().min(r.left.len() - 1)) as f64;
        let variance = dot(&r.left, &r.left) / freedom;
        let of = |all: &[f64], scale: f64, sums: &mut [f64]| {
            for channel in all.chunks_exact(length) {
                for (sum, value) in sums.iter_mut().zip(cross_sums(channel, channel, lags)) {
                    *sum += scale * value;
                }
            }
        };
        of(&r.left, 1.0, &mut sums);
        for direction in &r.fitted {
            of(direction, variance, &mut sums);
        }
        for (lag, count) in counts.iter_mut().enumerate() {
            *count += (r.channels * (length - lag)) as f64;
        }
    }
    if counts[0] == 0.0 {
        return Err(Refusal::TooShort {
            lag: lags,
            count: 0,
            independent: 0.0,
            least: 10.0,
        });
    }
    let means = sums.iter().zip(&counts).map(|(s, c)| s / c).collect();
    LagCovariance::new(1, means, counts)
}

fn excess_kurtosis(residuals: &[Residuals]) -> (f64, f64) {
    let (mut second, mut fourth, mut count) = (0.0, 0.0, 0.0);
    for v in residuals.iter().flat_map(|r| &r.left) {
        second += v * v;
        fourth += v.powi(4);
        count += 1.0;
    }
    (
        fourth * count / (second * second).max(f64::MIN_POSITIVE) - 3.0,
        (24.0 / f64::max(count, 1.0)).sqrt(),
    )
}
