//! Measurement-difference method: noise without a filter.

use super::model::shape;
use super::{Basis, Block, Estimate, LinearModel, Refusal, Verdict};
use super::{cone::nonnegative, design::rank_report};
use nalgebra::{Cholesky, DMatrix, DVector};
use std::format;
use std::vec::Vec;

/// Directions of a stack that the state reaches by less than this are free of it: rounding of powers of F.
const FREE_OF_STATE: f64 = 1e-10;

/// Settings of [`mdm_estimate`].
#[derive(Clone, Debug, PartialEq)]
pub struct MdmOptions {
    /// Samples that are looked at together; more than the states of the model by far, to see slow noise.
    pub span: usize,
    /// How often the weight is taken anew at the estimate; the first weighs as if all unknowns had like shares.
    pub reweights: usize,
    /// A value for each unknown that is known, in the order of the basis; empty when none is.
    pub known: Vec<Option<f64>>,
}

impl Default for MdmOptions {
    fn default() -> Self {
        MdmOptions {
            span: 50,
            reweights: 3,
            known: Vec::new(),
        }
    }
}

/// Estimate the noise of a linear model from measurements alone: no filter, no gain, no stationarity, no start value.
///
/// `span` samples are O x + (noise), whatever the state x. What lies outside the columns of O has nothing of the state, so that
/// its covariance is linear in Q and R (\[Dunik20\]). It is measured over all stacks of the record and solved for by
/// generalised least squares with the weight of Gaussian data, non-negative. Runs are as in
/// [`als_estimate`](super::als_estimate); the weight neglects that stacks overlap, so that this is a start for
/// [`als_estimate`](super::als_estimate) and a method for short records rather than the last word. Standard errors count
/// stacks that do not overlap: they are too large, by up to the square root of the span.
///
/// # Errors
/// [`Refusal::TooShort`] for fewer than ten stacks that do not overlap, [`Refusal::RankDeficient`], [`Refusal::Shape`],
/// [`Refusal::NotFinite`].
pub fn mdm_estimate(
    y: &[&[f64]],
    model: &LinearModel,
    basis: &Basis,
    options: &MdmOptions,
) -> Result<Estimate, Refusal> {
    model.check()?;
    let (n, p, k) = (model.states(), model.channels(), basis.len());
    shape("G", &model.g, n, basis.size(Block::Process))?;
    let span = options.span;
    if k == 0 || basis.size(Block::Measurement) != p || span * p <= n {
        return Err(Refusal::Shape {
            what: "span times channels",
            found: format!("{span} x {p} with {k} unknowns"),
            expected: format!("more than {n}, the states, and at least one unknown"),
        });
    }
    if y.iter().any(|run| run.iter().any(|v| !v.is_finite())) {
        return Err(Refusal::NotFinite {
            what: "measurement",
        });
    }
    let stacks: usize = y
        .iter()
        .map(|r| (r.len() / p + 1).saturating_sub(span))
        .sum();
    let apart: usize = y.iter().map(|r| r.len() / p / span).sum();
    if apart < 10 {
        return Err(Refusal::TooShort {
            lag: span,
            count: stacks,
            independent: apart as f64,
            least: 10.0,
        });
    }
    let projector = free_of_state(model, span);
    let shapes: Vec<DMatrix<f64>> = basis
        .unknowns()
        .iter()
        .map(|unknown| {
            let stacked = match unknown.block {
                Block::Process => process_stack(model, &unknown.matrix, span),
                Block::Measurement => DMatrix::from_fn(span * p, span * p, |i, j| {
                    if i / p == j / p {
                        unknown.matrix[(i % p, j % p)]
                    } else {
                        0.0
                    }
                }),
            };
            &projector * stacked * projector.transpose()
        })
        .collect();
    let mut measured = DMatrix::<f64>::zeros(projector.nrows(), projector.nrows());
    let mut free = DVector::zeros(projector.nrows());
    for run in y {
        for stack in run.windows(span * p).step_by(p) {
            free.gemv(1.0, &projector, &DVector::from_column_slice(stack), 0.0);
            measured.syger(1.0, &free, &free, 1.0);
        }
    }
    measured.fill_upper_triangle_with_lower_triangle();
    measured /= stacks as f64;
    let value = |i: usize| options.known.get(i).copied().flatten();
    let unknown: Vec<usize> = (0..k).filter(|i| value(*i).is_none()).collect();
    let columns = DMatrix::from_fn(measured.len(), k, |row, i| shapes[i].as_slice()[row]);
    let rank = rank_report(&columns, basis, &unknown);
    if unknown.is_empty() || rank.rank < unknown.len() {
        return Err(Refusal::RankDeficient {
            rank: rank.rank,
            unknowns: unknown.len(),
            undetermined: rank.undetermined,
        });
    }
    // Like shares: what each would be if it were all there is.
    let mut theta: Vec<f64> = (0..k)
        .map(|i| value(i).unwrap_or(measured.trace() / shapes[i].trace().max(f64::MIN_POSITIVE)))
        .collect();
    let least = theta.clone();
    let mut inverse = DMatrix::zeros(unknown.len(), unknown.len());
    let mut chi2 = 0.0;
    for _ in 0..options.reweights.max(1) {
        let sum = (0..k).fold(
            DMatrix::zeros(measured.nrows(), measured.nrows()),
            |sum, i| {
                // Of a variance of zero the weight would believe that nothing can look like it.
                sum + &shapes[i] * value(i).unwrap_or(theta[i].max(1e-6 * least[i]))
            },
        );
        let not_definite = || Refusal::NotPositiveDefinite {
            what: "covariance of the differences",
            remedy: "ask for a measurement noise, too, or take a shorter span",
        };
        let factor = Cholesky::new(sum).ok_or_else(not_definite)?;
        let whitened: Vec<DMatrix<f64>> = shapes.iter().map(|m| factor.solve(m)).collect();
        let residual = (0..k)
            .filter_map(|i| value(i).map(|v| &shapes[i] * v))
            .fold(measured.clone(), |sum, m| sum - m);
        let residual = factor.solve(&residual);
        let inner = |a: &DMatrix<f64>, b: &DMatrix<f64>| a.component_mul(&b.transpose()).sum();
        let normal = DMatrix::from_fn(unknown.len(), unknown.len(), |i, j| {
            inner(&whitened[unknown[i]], &whitened[unknown[j]])
        });
        let right = DVector::from_fn(unknown.len(), |i, _| {
            inner(&whitened[unknown[i]], &residual)
        });
        let lengths: Vec<f64> = (0..unknown.len()).map(|i| normal[(i, i)].sqrt()).collect();
        let scaled = DMatrix::from_fn(unknown.len(), unknown.len(), |i, j| {
            normal[(i, j)] / (lengths[i] * lengths[j])
        });
        let scaled_right = DVector::from_fn(unknown.len(), |i, _| right[i] / lengths[i]);
        let found = nonnegative(&scaled, &scaled_right)?;
        for (a, &i) in unknown.iter().enumerate() {
            theta[i] = found[a] / lengths[a];
        }
        inverse = Cholesky::new(normal).ok_or_else(not_definite)?.inverse();
        let left = unknown
            .iter()
            .fold(residual, |sum, &i| sum - &whitened[i] * theta[i]);
        // Half the squared distance, in stacks that do not overlap.
        chi2 = 0.5 * apart as f64 * inner(&left, &left);
    }
    let mut covariance = DMatrix::zeros(k, k);
    for (a, &i) in unknown.iter().enumerate() {
        for (b, &j) in unknown.iter().enumerate() {
            covariance[(i, j)] = 2.0 * inverse[(a, b)] / apart as f64;
        }
    }
    let size = measured.nrows();
    Ok(Estimate {
        names: basis.unknowns().iter().map(|u| u.name.clone()).collect(),
        standard_errors: (0..k).map(|i| covariance[(i, i)].max(0.0).sqrt()).collect(),
        verdicts: (0..k)
            .map(|i| match (value(i), theta[i] > 0.0) {
                (Some(_), _) => Verdict::Known,
                (None, true) => Verdict::Estimated,
                (None, false) => Verdict::OnBound,
            })
            .collect(),
        q: basis.covariance(Block::Process, &theta),
        r: basis.covariance(Block::Measurement, &theta),
        theta,
        covariance,
        chi2,
        dof: size * (size + 1) / 2 - unknown.len(),
        rank: rank.rank,
        condition: rank.condition,
        weakest: rank.weakest,
        reweights: options.reweights.max(1),
    })
}

/// Orthonormal rows that are perpendicular to the response of a stack to its first state.
fn free_of_state(model: &LinearModel, span: usize) -> DMatrix<f64> {
    let (n, p) = (model.states(), model.channels());
    let mut observe = model.h.clone();
    let mut response = DMatrix::zeros(span * p, n);
    for k in 0..span {
        response.rows_mut(k * p, p).copy_from(&observe);
        observe *= &model.f;
    }
    for mut column in response.column_iter_mut() {
        let length = column.norm();
        if length > 0.0 {
            column /= length;
        }
    }
    let svd = response.svd(true, false);
    let reached = svd.u.as_ref().map(|u| {
        let kept: Vec<usize> = (0..svd.singular_values.len())
            .filter(|i| svd.singular_values[*i] > FREE_OF_STATE * svd.singular_values.max())
            .collect();
        u.select_columns(&kept)
    });
    let Some(reached) = reached else {
        return DMatrix::identity(span * p, span * p);
    };
    // The complement: unit vectors, less what is reached, kept while independent of those before.
    let size = span * p;
    let complement = DMatrix::identity(size, size) - &reached * reached.transpose();
    let eigen = complement.symmetric_eigen();
    let kept: Vec<usize> = (0..size).filter(|i| eigen.eigenvalues[*i] > 0.5).collect();
    eigen.eigenvectors.select_columns(&kept).transpose()
}

/// Covariance of a stack of `span` samples from a process noise `q` after its first state.
fn process_stack(model: &LinearModel, q: &DMatrix<f64>, span: usize) -> DMatrix<f64> {
    let p = model.channels();
    // H Fʲ G: what a noise does j + 1 samples later.
    let mut impulse = Vec::with_capacity(span);
    let mut state = model.g.clone();
    for _ in 1..span {
        impulse.push(&model.h * &state);
        state = &model.f * state;
    }
    let mut stack = DMatrix::zeros(span * p, span * p);
    for i in 1..span {
        for j in 1..=i {
            // Noises 0 … j − 1 are in both.
            let sum = (0..j).fold(DMatrix::zeros(p, p), |sum, m| {
                sum + &impulse[i - 1 - m] * q * impulse[j - 1 - m].transpose()
            });
            stack.view_mut((i * p, j * p), (p, p)).copy_from(&sum);
            stack
                .view_mut((j * p, i * p), (p, p))
                .copy_from(&sum.transpose());
        }
    }
    stack
}

/// White noise of a measured angle against the integral of a gyro, from differences over several spans.
///
/// d = θ(k + s) − θ(k) − Σ ω T has the variance 2 r + s q for a span of s steps, once the mean rate of the differences (a
/// constant bias) is taken out: `attitude` and `gyro_angle` (ω T, angle of each step from the sample before) in rad give
/// (q, r), rad² per step and rad². Fitted over all `spans` by weighted least squares, not below zero. Works in
/// motion, and needs neither filter nor start value; a drifting bias shows as q at long spans.
///
/// # Errors
/// [`Refusal::Shape`] for fewer than two spans or records of different length, [`Refusal::TooShort`] for a span that fits
/// fewer than ten times.
pub fn attitude_differences(
    attitude: &[f64],
    gyro_angle: &[f64],
    spans: &[usize],
) -> Result<(f64, f64), Refusal> {
    let n = attitude.len();
    let mut distinct = spans.to_vec();
    distinct.sort_unstable();
    distinct.dedup();
    if gyro_angle.len() != n || distinct.len() < 2 || distinct[0] == 0 {
        return Err(Refusal::Shape {
            what: "records and spans",
            found: format!(
                "{n} angles, {} gyro angles, spans {spans:?}",
                gyro_angle.len()
            ),
            expected: "records of one length and two spans of at least one step".into(),
        });
    }
    if attitude.iter().chain(gyro_angle).any(|v| !v.is_finite()) {
        return Err(Refusal::NotFinite { what: "angle" });
    }
    let longest = distinct[distinct.len() - 1];
    if n < 10 * longest {
        return Err(Refusal::TooShort {
            lag: longest,
            count: n.saturating_sub(longest),
            independent: n as f64 / longest as f64,
            least: 10.0,
        });
    }
    let mut integrated = 0.0;
    let apart: Vec<f64> = attitude
        .iter()
        .zip(gyro_angle)
        .map(|(angle, step)| {
            integrated += step;
            angle - integrated
        })
        .collect();
    let drift = (apart[n - longest..].iter().sum::<f64>() - apart[..longest].iter().sum::<f64>())
        / (longest * (n - longest)) as f64;
    let mut normal = DMatrix::<f64>::zeros(2, 2);
    let mut right = DVector::zeros(2);
    for &span in &distinct {
        let variance = apart
            .windows(span + 1)
            .map(|w| (w[span] - w[0] - drift * span as f64).powi(2))
            .sum::<f64>()
            / (n - span) as f64;
        if variance <= 0.0 {
            return Err(Refusal::Flat {
                channel: 0,
                distinct: 1,
            });
        }
        // Of overlapping differences about one in `span` is independent.
        let weight = 1.0 / (span as f64 * variance * variance);
        let row = DVector::from_vec(vec![span as f64, 2.0]);
        normal += &row * row.transpose() * weight;
        right += row * (variance * weight);
    }
    let lengths = normal.diagonal().map(f64::sqrt);
    let scaled = DMatrix::from_fn(2, 2, |i, j| normal[(i, j)] / (lengths[i] * lengths[j]));
    let found = nonnegative(&scaled, &right.component_div(&lengths))?.component_div(&lengths);
    Ok((found[0], found[1]))
}
