//! One stop of a free run: weights over its nodes, its mean attitude, and what it shows of rocking.

use super::free_run::FreeRun;
use super::record::{Record, Span};
use crate::attitude::log;
use nalgebra::{Matrix3, Quaternion, SMatrix, SVector, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::vec::Vec;

/// Weights of the samples of a stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Taper {
    /// All alike: the best on a quiet base.
    None,
    /// The square of a Hann window: rocking leaks 10⁴ times less into the fit, whose standard deviation grows by a quarter.
    HannSquared,
}

impl Taper {
    /// Weight at a share 0..1 of the stop.
    fn weight(self, share: f64) -> f64 {
        match self {
            Taper::None => 1.0,
            Taper::HannSquared => (core::f64::consts::PI * share).sin().powi(4),
        }
    }

    /// Weights of the nodes of a span, its end included.
    pub(super) fn weights(self, t: &[f64]) -> Vec<f64> {
        let length = t[t.len() - 1];
        t.iter().map(|t| self.weight(t / length)).collect()
    }
}

/// A stop as a fit sees it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Standing {
    pub(super) span: Span,
    /// Seconds since its begin of the begins of nodes `span.begin..=span.end`.
    pub(super) t: Vec<f64>,
    /// Weights of the same.
    pub(super) weights: Vec<f64>,
    /// Mean of C over the stop as the fit feels it: rows of the horizontal axes weighted by the kernel of the velocity fit, that
    /// of the vertical axis by the kernel of the yaw fit.
    pub(super) axes_n: Matrix3<f64>,
    /// Mean attitude.
    pub(super) q_nb: UnitQuaternion<f64>,
    /// Rotation vector from the mean attitude at the same nodes, n, rad. Its vertical part is the yaw: Euler yaw would make
    /// yaw of the roll and pitch of a rocking body.
    pub(super) rocking: Vec<Vector3<f64>>,
    /// Weighted mean of the vertical specific force, m/s².
    pub(super) force_down: f64,
}

impl Standing {
    pub(super) fn new(record: &Record, run: &FreeRun, span: Span, taper: Taper) -> Self {
        let t: Vec<f64> = (span.begin..=span.end)
            .map(|k| record.seconds(span.begin, k))
            .collect();
        let weights = taper.weights(&t);
        let (from, to) = (run.at(span.begin), run.at(span.end));
        let nodes = &run.axes_n[from..to];
        let by_velocity = mean_axes(
            &t,
            &twice_summed(&t, &derivative_row::<3>(&t, &weights)),
            nodes,
        );
        let by_yaw = mean_axes(&t, &once_summed(&derivative_row::<2>(&t, &weights)), nodes);
        let mut axes_n = by_velocity;
        axes_n.set_row(2, &by_yaw.row(2));
        let sum: Quaternion<f64> = run.q_nb[from..=to]
            .iter()
            .zip(&weights)
            .map(|(q, w)| {
                let same = q.coords.dot(&run.q_nb[from].coords).signum();
                q.into_inner() * (w * same)
            })
            .fold(Quaternion::new(0.0, 0.0, 0.0, 0.0), |a, b| a + b);
        let q_nb = UnitQuaternion::new_normalize(sum);
        let rocking = run.q_nb[from..=to]
            .iter()
            .map(|q| log(&(q * q_nb.inverse())))
            .collect();
        let (mut force, mut total) = (0.0, 0.0);
        for (f, w) in run.force_n[from..to].iter().zip(weights.windows(2)) {
            let weight = 0.5 * (w[0] + w[1]);
            force += f.z * weight;
            total += weight;
        }
        Standing {
            span,
            t,
            weights,
            axes_n,
            q_nb,
            rocking,
            force_down: force / total,
        }
    }

    /// Length, s.
    pub(super) fn length(&self) -> f64 {
        self.t[self.t.len() - 1]
    }
}

/// Coefficients c with which Σ c y is the highest derivative of a weighted polynomial fit with `N` coefficients to y(t).
pub(super) fn derivative_row<const N: usize>(t: &[f64], weights: &[f64]) -> Vec<f64> {
    let length = t[t.len() - 1] - t[0];
    let middle = 0.5 * (t[0] + t[t.len() - 1]);
    let powers = |t: f64| -> SVector<f64, N> {
        let x = (t - middle) / length;
        SVector::from_fn(|i, _| x.powi(i as i32))
    };
    let mut normal = SMatrix::<f64, N, N>::zeros();
    for (t, w) in t.iter().zip(weights) {
        let a = powers(*t);
        normal += a * a.transpose() * *w;
    }
    let mut unit = SVector::<f64, N>::zeros();
    let factorial: usize = (1..N).product();
    unit[N - 1] = factorial as f64 / length.powi(N as i32 - 1);
    let row = normal
        .cholesky()
        .map_or_else(SVector::zeros, |factor| factor.solve(&unit));
    t.iter()
        .zip(weights)
        .map(|(t, w)| powers(*t).dot(&row) * w)
        .collect()
}

/// How much a rate in each interval adds to Σ c y when y is its integral.
pub(super) fn once_summed(c: &[f64]) -> Vec<f64> {
    let mut out = std::vec![0.0; c.len() - 1];
    let mut sum = 0.0;
    for k in (0..out.len()).rev() {
        sum += c[k + 1];
        out[k] = sum;
    }
    out
}

/// Likewise when y is its integral's integral.
pub(super) fn twice_summed(t: &[f64], c: &[f64]) -> Vec<f64> {
    let mut out = std::vec![0.0; c.len() - 1];
    let (mut sum, mut moment) = (0.0, 0.0);
    for k in (0..out.len()).rev() {
        sum += c[k + 1];
        moment += c[k + 1] * t[k + 1];
        out[k] = moment - sum * 0.5 * (t[k] + t[k + 1]);
    }
    out
}

fn mean_axes(t: &[f64], kernel: &[f64], axes_n: &[Matrix3<f64>]) -> Matrix3<f64> {
    let (mut sum, mut total) = (Matrix3::zeros(), 0.0);
    for ((h, pair), axes) in kernel.iter().zip(t.windows(2)).zip(axes_n) {
        let weight = h * (pair[1] - pair[0]);
        sum += axes * weight;
        total += weight;
    }
    sum / total
}
