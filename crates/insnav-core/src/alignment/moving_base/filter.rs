//! The attitude at the first sample with everything that blurs it: velocities, white noise, biases.
//!
//! States, all in the body axes b of the first sample: error of the sum of force μ, of the attitude now ψ, gyro bias,
//! accelerometer bias, and the attitude's error at the first sample ψ₀ as a clone, which is what is asked for:
//! `ψ' = −R b_g`, `μ' = −(R f)× ψ − R b_a`. Linear but for the rotation itself, so that some rounds about the last estimate
//! give the maximum of likelihood.

use super::gains::Gains;
use super::{Fix, Known};
use crate::alignment::track::Inertial;
use crate::attitude::{exp, skew};
use crate::earth::Geodetic;
use crate::imu::ImuNoise;
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};
use std::vec::Vec;

const SUM: usize = 0;
const NOW: usize = 3;
const GYRO: usize = 6;
const ACCEL: usize = 9;
const BEGIN: usize = 12;
const STATES: usize = 15;

/// Nothing is known beforehand: m/s and rad.
const SUM_SIGMA: f64 = 100.0;
const ATTITUDE_SIGMA: f64 = 10.0;
/// Rounds at most, the longest step of one and the one that ends them, rad.
const ROUNDS: usize = 12;
const LONGEST: f64 = 0.5;
const SHORTEST: f64 = 1e-4;
/// Sums are formed anew when biases would turn them by this, rad, or change them by this, m/s.
const TURNED: f64 = 1e-4;
const CHANGED: f64 = 1e-3;
/// A velocity that is off by so many of its sigmas, or of the median deviations, is an outlier; more than this share are no
/// outliers but a misfit.
const OUTLIER: f64 = 5.0;
const MAD_TO_SIGMA: f64 = 1.482_6;
const MOST_OUTLIERS: f64 = 0.1;

/// A maximum of likelihood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    pub(super) q_nb: UnitQuaternion<f64>,
    pub(super) covariance_n: Matrix3<f64>,
    pub(super) gyro_bias: Vector3<f64>,
    pub(super) gyro_bias_sigma: Vector3<f64>,
    /// Sum of the innovations' normalised squares, and their degrees of freedom.
    pub(super) squares: f64,
    pub(super) freedom: f64,
}

/// One pass over the velocities.
struct Pass {
    x: SVector<f64, STATES>,
    p: SMatrix<f64, STATES, STATES>,
    squares: f64,
    rows: usize,
}

/// Go uphill from an attitude; `None` where that leads nowhere.
pub(super) fn fit(
    imu: &[Inertial],
    fixes: &[Fix],
    place: &Geodetic,
    noise: &ImuNoise,
    known: &Known,
    first: &Gains,
    from: UnitQuaternion<f64>,
) -> Option<Fit> {
    let mut anew: Option<Gains> = None;
    let mut q = from;
    for _ in 0..ROUNDS {
        let gains = anew.as_ref().unwrap_or(first);
        let (start, outlier) = judge(gains, &q);
        let count = outlier.iter().filter(|o| **o).count();
        if count as f64 > MOST_OUTLIERS * fixes.len() as f64 {
            return None;
        }
        let pass = pass(gains, &q, &start, &outlier, noise, known);
        let psi: Vector3<f64> = pass.x.fixed_rows::<3>(BEGIN).into_owned();
        if !psi.norm().is_finite() {
            return None;
        }
        let step = psi * (LONGEST / psi.norm().max(LONGEST));
        let gyro: Vector3<f64> = pass.x.fixed_rows::<3>(GYRO).into_owned();
        let accel: Vector3<f64> = pass.x.fixed_rows::<3>(ACCEL).into_owned();
        let length = gains.length();
        let stale = gyro.norm() * length > TURNED || accel.norm() * length > CHANGED;
        if psi.norm() < SHORTEST && !stale {
            let c = q.to_rotation_matrix().into_inner();
            let p0: Matrix3<f64> = pass.p.fixed_view::<3, 3>(BEGIN, BEGIN).into_owned();
            let pg = pass.p.fixed_view::<3, 3>(GYRO, GYRO).diagonal();
            return Some(Fit {
                q_nb: q * exp(&psi),
                covariance_n: c * p0 * c.transpose(),
                gyro_bias: gains.gyro_bias + gyro,
                gyro_bias_sigma: pg.map(f64::sqrt),
                squares: pass.squares,
                // What sums and attitude take at the begin.
                freedom: pass.rows.saturating_sub(6).max(1) as f64,
            });
        }
        q *= exp(&step);
        if stale {
            let (gyro, accel) = (gains.gyro_bias + gyro, gains.accel_bias + accel);
            anew = Some(Gains::at(imu, fixes, place, known, gyro, accel)?);
        }
    }
    None
}

/// The velocity at the first sample by the median, and which velocities contradict it.
fn judge(gains: &Gains, q: &UnitQuaternion<f64>) -> (Vector3<f64>, Vec<bool>) {
    let apart: Vec<Vector3<f64>> = gains
        .nodes
        .iter()
        .map(|n| n.sum_n() - q * n.sum_b())
        .collect();
    let middle = Vector3::from_fn(|i, _| median(apart.iter().map(|a| a[i])));
    let scatter = Vector3::from_fn(|i, _| {
        MAD_TO_SIGMA * median(apart.iter().map(|a| (a[i] - middle[i]).abs()))
    });
    let outlier = |(a, n): (&Vector3<f64>, &super::gains::Node)| {
        (0..3).any(|i| {
            let sigma = n.fix.variance[i].sqrt().max(scatter[i]);
            (a[i] - middle[i]).abs() > OUTLIER * sigma
        })
    };
    let outliers = apart.iter().zip(&gains.nodes).map(outlier).collect();
    (middle, outliers)
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut all: Vec<f64> = values.collect();
    all.sort_by(f64::total_cmp);
    let n = all.len();
    if n == 0 {
        return 0.0;
    }
    0.5 * (all[(n - 1) / 2] + all[n / 2])
}

fn pass(
    gains: &Gains,
    q: &UnitQuaternion<f64>,
    start: &Vector3<f64>,
    outlier: &[bool],
    noise: &ImuNoise,
    known: &Known,
) -> Pass {
    let c = q.to_rotation_matrix().into_inner();
    let mut x = SVector::<f64, STATES>::zeros();
    // Biases are measured from those that the sums were formed with.
    x.fixed_rows_mut::<3>(GYRO)
        .copy_from(&(known.gyro_bias - gains.gyro_bias));
    x.fixed_rows_mut::<3>(ACCEL).copy_from(&-gains.accel_bias);
    let mut p = prior(noise, known);
    let (mut squares, mut rows) = (0.0, 0);
    for (node, outlier) in gains.nodes.iter().zip(outlier) {
        let mut phi = SMatrix::<f64, STATES, STATES>::identity();
        phi.fixed_view_mut::<3, 3>(SUM, NOW)
            .copy_from(&-skew(&node.gain));
        phi.fixed_view_mut::<3, 3>(SUM, GYRO).copy_from(&node.lean);
        phi.fixed_view_mut::<3, 3>(SUM, ACCEL)
            .copy_from(&-node.turn);
        phi.fixed_view_mut::<3, 3>(NOW, GYRO).copy_from(&-node.turn);
        x = phi * x;
        p = phi * p * phi.transpose() + process(noise, node.dt, &node.gain);
        if *outlier {
            continue;
        }
        let to_now = node.frame.inverse().to_rotation_matrix().into_inner() * c;
        let predicted = node.frame.inverse() * (start + c * node.sum_b() - node.pull);
        let residual = node.fix.velocity_n - predicted;
        let by_lever = -to_now * skew(&node.lever);
        for i in (0..3).filter(|i| node.fix.variance[*i].is_finite()) {
            let mut h = SVector::<f64, STATES>::zeros();
            for j in 0..3 {
                h[SUM + j] = to_now[(i, j)];
                h[NOW + j] = by_lever[(i, j)];
            }
            let ph = p * h;
            let s = h.dot(&ph) + node.fix.variance[i];
            let innovation = residual[i] - h.dot(&x);
            x += ph * (innovation / s);
            p -= ph * ph.transpose() / s;
            squares += innovation * innovation / s;
            rows += 1;
        }
        p = (p + p.transpose()) * 0.5;
    }
    Pass {
        x,
        p,
        squares,
        rows,
    }
}

fn prior(noise: &ImuNoise, known: &Known) -> SMatrix<f64, STATES, STATES> {
    let mut p = SMatrix::<f64, STATES, STATES>::zeros();
    let mut put = |row: usize, column: usize, sigma: f64| {
        for i in 0..3 {
            p[(row + i, column + i)] = sigma * sigma;
        }
    };
    put(SUM, SUM, SUM_SIGMA);
    put(GYRO, GYRO, known.gyro_sigma);
    put(ACCEL, ACCEL, noise.accel_bias_sigma);
    for (row, column) in [(NOW, NOW), (BEGIN, BEGIN), (NOW, BEGIN), (BEGIN, NOW)] {
        put(row, column, ATTITUDE_SIGMA);
    }
    p
}

/// White noise and wandering biases over a stretch in which the force is taken for steady.
fn process(noise: &ImuNoise, dt: f64, gain: &Vector3<f64>) -> SMatrix<f64, STATES, STATES> {
    let (rate, force) = (
        noise.gyro_white.powi(2) * dt,
        noise.accel_white.powi(2) * dt,
    );
    let push = skew(gain);
    let mut q = SMatrix::<f64, STATES, STATES>::zeros();
    let mut put = |row, column, m: Matrix3<f64>| {
        q.fixed_view_mut::<3, 3>(row, column).copy_from(&m);
    };
    let one = Matrix3::identity();
    put(
        SUM,
        SUM,
        one * force + push * push.transpose() * (rate / 3.0),
    );
    put(SUM, NOW, push * (-rate / 2.0));
    put(NOW, SUM, push.transpose() * (-rate / 2.0));
    put(NOW, NOW, one * rate);
    let wander = |sigma: f64, tau: f64| one * (2.0 * sigma * sigma * dt / tau);
    put(
        GYRO,
        GYRO,
        wander(noise.gyro_bias_sigma, noise.gyro_bias_tau),
    );
    put(
        ACCEL,
        ACCEL,
        wander(noise.accel_bias_sigma, noise.accel_bias_tau),
    );
    q
}
