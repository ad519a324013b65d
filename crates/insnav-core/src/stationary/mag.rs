//! Acceleration magnitude (MAG).
//!
//! T = 1/(σ_a² N) Σ(|f| − g)² (\[Skog10\]). An accelerometer bias and a gravity other than the standard one shift it
//! by their square over σ_a²: the threshold allows for one standard deviation of them.

use super::quantile::of_squares;
use super::rest_noise::RestNoise;
use super::window::Moments;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;

/// T.
pub fn statistic(m: &Moments, noise: &RestNoise) -> f64 {
    m.force_excess_square / (noise.force_variance(m.dt()) * m.count.max(1.0))
}

/// The quantile of T at rest.
pub fn threshold(m: &Moments, noise: &RestNoise, z: f64) -> f64 {
    let shift = noise.accel_bias.powi(2) / noise.force_variance(m.dt());
    // Mean and variance of a chi-square that is not central, over N.
    of_squares(1.0 + shift, (2.0 + 4.0 * shift) / m.count.max(1.0), z)
}
