//! Angular rate energy (ARE).
//!
//! T = 1/(σ_g² N) Σ|ω − b|² (\[Skog10\]), here with the bias b (and Earth rate) taken out as the filter knows it; what
//! it does not know shifts T by its variance over σ_g², for one standard deviation of which the threshold allows.

use super::quantile::of_squares;
use super::rest_noise::RestNoise;
use super::window::Moments;
use nalgebra::Vector3;

/// T, with the rate that is expected at rest.
pub fn statistic(m: &Moments, expected: &Vector3<f64>, noise: &RestNoise) -> f64 {
    m.rate_spread(expected) / noise.rate_variance(m.dt())
}

/// The quantile of T at rest; `bias_variance` is that of the expected rate, all axes together.
pub fn threshold(m: &Moments, bias_variance: f64, noise: &RestNoise, z: f64) -> f64 {
    let shift = bias_variance / noise.rate_variance(m.dt());
    of_squares(3.0 + shift, (6.0 + 4.0 * shift) / m.count.max(1.0), z)
}
