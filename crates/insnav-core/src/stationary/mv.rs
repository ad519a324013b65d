//! Acceleration moving variance (MV).
//!
//! T = 1/(σ_a² N) Σ|f − f̄|² (\[Skog10\]). At rest N T is a chi-square of 3(N − 1) degrees of freedom. Biases and
//! gravity leave with the mean; slow turns and constant acceleration do too: it does not see them.

use super::quantile::of_squares;
use super::rest_noise::RestNoise;
use super::window::Moments;

/// T.
pub fn statistic(m: &Moments, noise: &RestNoise) -> f64 {
    m.force_spread(&m.mean_force()) / noise.force_variance(m.dt())
}

/// The quantile of T at rest; `z` is the normal quantile of the probability to be above.
pub fn threshold(m: &Moments, z: f64) -> f64 {
    let dof = 3.0 * (m.count - 1.0).max(1.0);
    of_squares(dof, 2.0 * dof, z) / m.count
}
