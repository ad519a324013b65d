//! Generalised likelihood ratio test (GLRT), "SHOE".
//!
//! T = 1/N Σ(|f − g f̄/|f̄||²/σ_a² + |ω − b|²/σ_g²) (\[Skog10\]), b as in [`super::are`]. With
//! |f − g u|² summed = Σ|f − f̄|² + N(|f̄| − g)² for u = f̄/|f̄|, biases shift it as they shift MAG and ARE.

use super::are;
use super::quantile::of_squares;
use super::rest_noise::RestNoise;
use super::window::Moments;
use crate::imu::STANDARD_GRAVITY;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::Vector3;

/// T, with the rate that is expected at rest.
pub fn statistic(m: &Moments, expected: &Vector3<f64>, noise: &RestNoise) -> f64 {
    let mean = m.mean_force();
    let excess = mean.norm() - STANDARD_GRAVITY;
    (m.force_spread(&mean) + excess * excess) / noise.force_variance(m.dt())
        + are::statistic(m, expected, noise)
}

/// The quantile of T at rest; `bias_variance` is that of the expected rate, all axes together.
pub fn threshold(m: &Moments, bias_variance: f64, noise: &RestNoise, z: f64) -> f64 {
    let force = noise.accel_bias.powi(2) / noise.force_variance(m.dt());
    let rate = bias_variance / noise.rate_variance(m.dt());
    let n = m.count.max(1.0);
    // The direction of f̄ is fitted: two of the 6 N degrees of freedom.
    let dof = 6.0 - 2.0 / n;
    let shift = force + rate;
    of_squares(dof + shift, (2.0 * dof + 4.0 * shift) / n, z)
}
