//! Whether the Earth's rate that the stops show is that of the latitude.

use super::StopReport;
use super::place::Place;
use crate::imu::ImuNoise;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// The Earth's rate by all stops together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EarthRate {
    /// Horizontal part over Ω cos L, minus one, and its sigma.
    pub(super) horizontal: [f64; 2],
    /// Part along down less −Ω sin L, and its sigma, rad/s.
    pub(super) vertical: [f64; 2],
}

/// From the whole level rates of the stops (\[Lobusov14\] eq. (1) and (3), with sin² + cos² = 1 left free), by generalised least
/// squares: every stop shows Ω + M w, where the drift w is known beforehand to `bias_sigma`, and wanders.
///
/// `turns`: rotation vector from the first stop to each, n, rad; a scale error of `scale_sigma` makes a turn of the frame of it.
/// `None` where the rates cannot be weighed.
pub(super) fn earth_rate(
    stops: &[StopReport],
    turns: &[Vector3<f64>],
    place: &Place,
    noise: &ImuNoise,
    bias_sigma: f64,
    scale_sigma: f64,
) -> Option<EarthRate> {
    let count = 3 * stops.len();
    let axes: std::vec::Vec<Matrix3<f64>> = stops
        .iter()
        .map(|s| s.q_nb.to_rotation_matrix().into_inner())
        .collect();
    let wander = 2.0 * noise.gyro_bias_sigma.powi(2) / noise.gyro_bias_tau;
    // Variances span eight orders: in units of Ω cos L.
    let unit = place.horizontal_rate();
    let mut covariance = DMatrix::<f64>::zeros(count, count);
    let mut rates = DVector::<f64>::zeros(count);
    let mut design = DMatrix::<f64>::zeros(count, 3);
    for (i, stop) in stops.iter().enumerate() {
        for (j, other) in stops.iter().enumerate() {
            let since = |s: &StopReport| s.begin.since(stops[0].begin);
            let shared = bias_sigma.powi(2) + wander * since(stop).min(since(other));
            let turned = [i, j].map(|k| turns[k].cross(&place.earth_n) * scale_sigma);
            let block = axes[i] * axes[j].transpose() * shared + turned[0] * turned[1].transpose();
            covariance
                .fixed_view_mut::<3, 3>(3 * i, 3 * j)
                .copy_from(&(block / (unit * unit)));
        }
        for k in 0..3 {
            covariance[(3 * i + k, 3 * i + k)] += (stop.sigma_rate[k] / unit).powi(2);
            rates[3 * i + k] = stop.rate_n[k] / unit;
            design[(3 * i + k, k)] = 1.0;
        }
    }
    let factor = covariance.cholesky()?;
    let weighted = factor.solve(&design);
    let inverse = (design.transpose() * &weighted).cholesky()?.inverse();
    let found = &inverse * (weighted.transpose() * rates);
    let horizontal = found[0].hypot(found[1]);
    let along = [found[0] / horizontal, found[1] / horizontal];
    let variance = along[0] * along[0] * inverse[(0, 0)]
        + along[1] * along[1] * inverse[(1, 1)]
        + 2.0 * along[0] * along[1] * inverse[(0, 1)];
    Some(EarthRate {
        horizontal: [horizontal - 1.0, variance.sqrt()],
        vertical: [
            found[2] * unit - place.earth_n.z,
            inverse[(2, 2)].sqrt() * unit,
        ],
    })
}
