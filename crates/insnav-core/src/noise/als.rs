//! Autocovariance least squares on a record, filtered again with what was found.

use super::innovations::innovations;
use super::lag_covariance::screen;
use super::model::StationaryFilter;
use super::{
    Basis, Block, Estimate, LinearModel, Refusal, SolveOptions, Verdict, als_design, als_solve,
    lag_covariance,
};
use nalgebra::DMatrix;
use std::format;
use std::vec::Vec;

/// A gain is not made of less than this share of an unknown's standard error: zero would be believed for ever.
const LEAST_OF_STANDARD_ERROR: f64 = 0.1;
/// Prior values within this many standard errors of the estimate are not contradicted by it.
const CONSISTENT: f64 = 3.0;

/// Settings of [`als_estimate`].
#[derive(Clone, Debug, PartialEq)]
pub struct EstimateOptions {
    /// Number of lags, J.
    pub lags: usize,
    /// How often the record is filtered, each time with the gain of the estimate before.
    pub rounds: usize,
    /// Samples at the begin of each run that are left out. The initial state is fitted, so that there is next to no transient.
    pub skip: usize,
    /// Keep what the data do not identify (standard error above the value) at its start value, if they do not contradict that.
    pub hold_unidentified: bool,
    /// Weight, constraint, known values.
    pub solve: SolveOptions,
}

impl Default for EstimateOptions {
    fn default() -> Self {
        EstimateOptions {
            lags: 64,
            rounds: 3,
            skip: 0,
            hold_unidentified: true,
            solve: SolveOptions::default(),
        }
    }
}

/// Noise of a record and the filter that is made for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Identified {
    /// The estimate of the last round.
    pub estimate: Estimate,
    /// The stationary filter with the estimated noise.
    pub filter: StationaryFilter,
    /// θ after each round.
    pub rounds: Vec<Vec<f64>>,
}

/// Estimate the noise of a linear model from measurements.
///
/// `y` are contiguous runs, sample by sample with the channels side by side, from which the response to known inputs is taken
/// out already (of innovations, [`measurements_of_innovations`](super::measurements_of_innovations)). `start` is a θ for the
/// first gain: what a data sheet says, or a guess a hundred times off. Each round makes the stationary gain of the estimate
/// before, filters the record with it and solves anew: at the true gain the innovations are white, and their covariances
/// tell most (\[Mehra70\]).
///
/// # Errors
/// [`Refusal::Flat`] and [`Refusal::Saturated`] for such channels, [`Refusal::NoStationaryFilter`] for a start from which no
/// gain follows, and those of [`als_design`] and [`als_solve`].
pub fn als_estimate(
    y: &[&[f64]],
    model: &LinearModel,
    basis: &Basis,
    start: &[f64],
    options: &EstimateOptions,
) -> Result<Identified, Refusal> {
    model.check()?;
    let p = model.channels();
    if start.len() != basis.len() {
        return Err(Refusal::Shape {
            what: "start",
            found: format!("{} values", start.len()),
            expected: format!("{}, one for each unknown", basis.len()),
        });
    }
    if options.rounds == 0 {
        return Err(Refusal::Setting {
            what: "rounds",
            value: 0.0,
            expected: "at least 1",
        });
    }
    for block in [Block::Process, Block::Measurement] {
        let variances = basis.covariance(block, start).diagonal();
        if let Some(value) = variances
            .iter()
            .find(|v| !(0.0..f64::INFINITY).contains(*v))
        {
            return Err(Refusal::Setting {
                what: "start",
                value: *value,
                expected: "variances that are finite and not negative",
            });
        }
    }
    if y.iter().any(|run| run.iter().any(|v| !v.is_finite())) {
        return Err(Refusal::NotFinite {
            what: "measurement",
        });
    }
    screen(y, p)?;
    let known = |i: usize| options.solve.known.get(i).copied().flatten();
    let mut for_gain: Vec<f64> = (0..start.len())
        .map(|i| known(i).unwrap_or(start[i]))
        .collect();
    let mut history = Vec::with_capacity(options.rounds);
    let mut estimate = None;
    for _ in 0..options.rounds.max(1) {
        let filter = filter_for(model, basis, &for_gain)?;
        let (covariance, design) = {
            let filtered: Vec<Vec<f64>> = y
                .iter()
                .map(|run| innovations(model, &filter.gain, run))
                .collect();
            let runs: Vec<&[f64]> = filtered
                .iter()
                .map(|run| run.get(options.skip * p..).unwrap_or(&[]))
                .collect();
            (
                lag_covariance(&runs, p, options.lags)?,
                als_design(model, &filter.gain, basis, options.lags)?,
            )
        };
        let mut found = als_solve(&design, &covariance, &options.solve)?;
        if options.hold_unidentified && history.len() + 1 >= options.rounds {
            let held: Vec<usize> = found
                .not_identified()
                .filter(|i| {
                    (start[*i] - found.theta[*i]).abs() <= CONSISTENT * found.standard_errors[*i]
                })
                .collect();
            let free = found
                .verdicts
                .iter()
                .filter(|v| **v != Verdict::Known)
                .count();
            if !held.is_empty() && held.len() < free {
                let mut solve = options.solve.clone();
                solve.known.resize(start.len(), None);
                held.iter().for_each(|i| solve.known[*i] = Some(start[*i]));
                found = als_solve(&design, &covariance, &solve)?;
                held.iter().for_each(|i| found.verdicts[*i] = Verdict::Held);
            }
        }
        history.push(found.theta.clone());
        for_gain = (0..start.len())
            .map(|i| match found.verdicts[i] {
                Verdict::Known | Verdict::Held => found.theta[i],
                _ => {
                    let least = LEAST_OF_STANDARD_ERROR * found.standard_errors[i];
                    let variance = basis.unknowns()[i]
                        .matrix
                        .diagonal()
                        .iter()
                        .any(|d| *d != 0.0);
                    if variance {
                        found.theta[i].max(least)
                    } else {
                        found.theta[i]
                    }
                }
            })
            .collect();
        estimate = Some(found);
    }
    let Some(estimate) = estimate else {
        return Err(Refusal::NotConverged {
            what: "no round",
            iterations: 0,
        });
    };
    Ok(Identified {
        filter: filter_for(model, basis, &for_gain)?,
        estimate,
        rounds: history,
    })
}

fn filter_for(
    model: &LinearModel,
    basis: &Basis,
    theta: &[f64],
) -> Result<StationaryFilter, Refusal> {
    let q: DMatrix<f64> = basis.covariance(Block::Process, theta);
    model.stationary_filter(&q, &basis.covariance(Block::Measurement, theta))
}
