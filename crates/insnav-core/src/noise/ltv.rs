//! Autocovariance least squares with a model and a gain that change from step to step.

use super::model::shape;
use super::solve::Equations;
use super::{Basis, Block, Estimate, LagCovariance, Refusal, SolveOptions};
use nalgebra::DMatrix;
use std::collections::VecDeque;
use std::format;
use std::vec::Vec;

/// One step of a filter: what measured, with what gain, and where the state went afterwards.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// What is measured at this step, p × n.
    pub h: DMatrix<f64>,
    /// The gain that corrects the predicted state, n × p.
    pub gain: DMatrix<f64>,
    /// Transition to the next step, n × n.
    pub f: DMatrix<f64>,
    /// Where the process noise of that transition enters, n × g.
    pub g: DMatrix<f64>,
}

/// Estimate the noise of a time-varying model from the innovations of one run of its filter.
///
/// For each unknown its error covariance is propagated along the real Fₖ and Lₖ, begun at zero, and what it adds to
/// E νₖ₊ⱼ νₖᵀ is summed over k (\[Lima11\]): no stationarity is assumed, and the same unknowns come out. `initial` is the covariance of
/// the first prediction, which is known and moves to the right. Each step costs lags · p n² and unknowns · n³.
///
/// Elements weigh alike, or ([`Weight::Bartlett`](super::Weight)) by Bartlett's formula with covariances averaged over the
/// run, which is exact for a stationary filter and nearly right for one whose innovations change slowly; so are the standard
/// errors in both cases. The record is not filtered again: for that run the filter anew with the estimate.
///
/// # Errors
/// As [`als_design`](super::als_design) and [`als_solve`](super::als_solve); [`Refusal::Unstable`] when an error covariance
/// grows beyond all bounds.
pub fn als_estimate_ltv(
    steps: &[Step],
    innovations: &[f64],
    initial: &DMatrix<f64>,
    basis: &Basis,
    lags: usize,
    options: &SolveOptions,
) -> Result<Estimate, Refusal> {
    let Some(first) = steps.first() else {
        return Err(Refusal::Shape {
            what: "number of steps",
            found: "0".into(),
            expected: format!("more than {lags}, the number of lags"),
        });
    };
    let (n, p) = (first.f.nrows(), first.h.nrows());
    let g = basis.size(Block::Process);
    for step in steps {
        shape("F", &step.f, n, n)?;
        shape("G", &step.g, n, g)?;
        shape("H", &step.h, p, n)?;
        shape("gain", &step.gain, n, p)?;
    }
    shape("initial covariance", initial, n, n)?;
    if innovations.len() != steps.len() * p || steps.len() <= lags || lags == 0 {
        return Err(Refusal::Shape {
            what: "innovations",
            found: format!("{} values at {} steps", innovations.len(), steps.len()),
            expected: format!("{p} for each step, and more than {lags} steps"),
        });
    }
    if innovations.iter().any(|v| !v.is_finite()) {
        return Err(Refusal::NotFinite { what: "innovation" });
    }
    let k = basis.len();
    // The last one is what the initial covariance adds.
    let mut covariances = vec![DMatrix::zeros(n, n); k + 1];
    covariances[k].copy_from(initial);
    let mut sums = DMatrix::zeros(lags * p * p, k + 1);
    let mut measured = vec![0.0; lags * p * p];
    let mut counts = vec![0.0; lags];
    // Newest first: closed loop and shares of each unknown of the last steps.
    let mut past: VecDeque<(DMatrix<f64>, Vec<DMatrix<f64>>)> = VecDeque::with_capacity(lags);
    for (t, step) in steps.iter().enumerate() {
        let now = &innovations[t * p..(t + 1) * p];
        let fl = &step.f * &step.gain;
        let closed = &step.f - &fl * &step.h;
        let mut shares = Vec::with_capacity(k + 1);
        for (i, covariance) in covariances.iter_mut().enumerate() {
            let across = &*covariance * step.h.transpose();
            let mut at_once = &step.h * &across;
            let mut share = &closed * across;
            let mut next = &closed * &*covariance * closed.transpose();
            if let Some(unknown) = basis.unknowns().get(i) {
                match unknown.block {
                    Block::Process => next += &step.g * &unknown.matrix * step.g.transpose(),
                    Block::Measurement => {
                        at_once += &unknown.matrix;
                        share -= &fl * &unknown.matrix;
                        next += &fl * &unknown.matrix * fl.transpose();
                    }
                }
            }
            add(&mut sums, i, 0, &at_once);
            shares.push(share);
            *covariance = super::model::symmetric(next);
            if !covariance.iter().all(|v| v.abs() < 1e200) {
                return Err(Refusal::Unstable {
                    spectral_radius: f64::INFINITY,
                });
            }
        }
        // Back through the steps before: the row H Φ grows by one closed loop at each.
        let mut observe = step.h.clone();
        for (lag, (loop_after, shares)) in past.iter().enumerate() {
            for (i, share) in shares.iter().enumerate() {
                add(&mut sums, i, lag + 1, &(&observe * share));
            }
            observe *= loop_after;
        }
        for lag in 0..lags.min(t + 1) {
            let then = &innovations[(t - lag) * p..(t - lag + 1) * p];
            counts[lag] += 1.0;
            for b in 0..p {
                for a in 0..p {
                    measured[(lag * p + b) * p + a] += now[a] * then[b];
                }
            }
        }
        if past.len() + 1 >= lags {
            past.pop_back();
        }
        if lags > 1 {
            past.push_front((closed, shares));
        }
    }
    for (row, value) in measured.iter_mut().enumerate() {
        let count = counts[row / (p * p)];
        *value /= count;
        sums.row_mut(row).scale_mut(1.0 / count);
    }
    let covariance = LagCovariance::new(p, measured, counts)?;
    Equations {
        basis,
        columns: &sums.columns(0, k).into_owned(),
        offset: Some(sums.column(k).into_owned()),
        covariance: &covariance,
        model: None,
    }
    .solve(options)
}

fn add(sums: &mut DMatrix<f64>, column: usize, lag: usize, value: &DMatrix<f64>) {
    let size = value.len();
    let mut place = sums.column_mut(column);
    for (sum, v) in place
        .rows_mut(lag * size, size)
        .iter_mut()
        .zip(value.iter())
    {
        *sum += v;
    }
}
