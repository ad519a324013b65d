//! The composite: variances below 5 Hz, and the mean rate against the gyro bias.
//!
//! An engine that idles shakes a body far above its sensors' noise, but far above 5 Hz too; what moves on wheels shakes
//! below. A steady turn shows in the mean rate alone. Smooth straight motion shows in none of the three: speed must tell.
//!
//! With B the noise bandwidth of the low-pass, W the window, d_a and d_g the densities of the noise:
//! LPMV = var f / (2 B d_a²), LPGV = var ω / (2 B d_g²), sums over three axes, and
//! GY = (ω̄ − b)ᵀ (I (d_g²/W + ε²) + P_b)⁻¹ (ω̄ − b), with b the rate that the filter expects at rest, P_b its covariance and
//! ε = 0.01 °/s for what a bias does within a stop. GY is also taken of a mean over up to six seconds, as long as the variances
//! agree: what a window cannot tell from its noise, that mean can.

use super::low_pass::LowPass;
use super::quantile::{ONE_IN_1E3, of_squares};
use super::rest_noise::RestNoise;
use super::window::Moments;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix3, Vector3};

/// Bias wander and sway within a stop, rad/s.
const BIAS_WANDER: f64 = 0.01 / 180.0 * core::f64::consts::PI;

/// LPMV and LPGV of a window of low-passed samples, about a point or about their mean.
pub(super) fn variances(
    m: &Moments,
    about: Option<(&Vector3<f64>, &Vector3<f64>)>,
    noise: &RestNoise,
    low_pass: &LowPass,
) -> [f64; 2] {
    let (force, rate) = match about {
        Some((force, rate)) => (m.force_spread(force), m.rate_spread(rate)),
        None => (
            m.force_spread(&m.mean_force()),
            m.rate_spread(&m.mean_rate()),
        ),
    };
    let two_b = 2.0 * low_pass.noise_bandwidth();
    [
        force / (two_b * noise.accel_white.powi(2)),
        rate / (two_b * noise.gyro_white.powi(2)),
    ]
}

/// What LPMV and LPGV are at rest in the mean: the mean of the window takes 1/(2 B W) of the variance away.
pub(super) fn expected_variance(window: f64, low_pass: &LowPass) -> f64 {
    3.0 * (1.0 - 1.0 / (2.0 * low_pass.noise_bandwidth() * window)).max(0.1)
}

/// People get in, doors close: a car sways by a tenth of a degree at 0.4 Hz, that is by 0.25 °/s, about each axis, rad/s.
const ROCKING_RATE: f64 = 0.25 / 180.0 * core::f64::consts::PI;
/// And by this along each, m/s².
const ROCKING_FORCE: f64 = 0.25;

/// LPMV and LPGV of a body that stands and rocks as much as people make it.
pub(super) fn rocking(noise: &RestNoise, low_pass: &LowPass) -> [f64; 2] {
    of_motion(ROCKING_FORCE, ROCKING_RATE, noise, low_pass)
}

/// What stands on wheels may rock by this much where nobody measures the speed, standard deviation on each axis: specific force,
/// m/s², and rate, rad/s (0.2 °/s). Of 2558 windows of two seconds above 1 m/s on four cars and a robot (rtkexp, hipnuc, kth,
/// comma2k19, husky) none is below 0.059 m/s²; four fifths of 654 below 0.15 m/s are within both.
const STANDING_FORCE: f64 = 0.04;
const STANDING_RATE: f64 = 0.2 / 180.0 * core::f64::consts::PI;

/// LPMV and LPGV of a body that rocks so: a good unit's noise says nothing about the body that it is on.
pub(super) fn standing_on_wheels(noise: &RestNoise, low_pass: &LowPass) -> [f64; 2] {
    of_motion(STANDING_FORCE, STANDING_RATE, noise, low_pass)
}

/// LPMV and LPGV of a standard deviation on each axis, m/s² and rad/s.
fn of_motion(force: f64, rate: f64, noise: &RestNoise, low_pass: &LowPass) -> [f64; 2] {
    let two_b = 2.0 * low_pass.noise_bandwidth();
    [
        3.0 * force.powi(2) / (two_b * noise.accel_white.powi(2)),
        3.0 * rate.powi(2) / (two_b * noise.gyro_white.powi(2)),
    ]
}

/// What a swing of four seconds leaves of its variance in a mean of two, (2/π)²; faster ones leave less.
const OF_A_SWING: f64 = 4.0 * core::f64::consts::FRAC_1_PI * core::f64::consts::FRAC_1_PI;

/// Variance that rocking leaves in a window's mean rate on each axis, by what the noise does not explain: LPGV above its
/// threshold, rad²/s².
pub(super) fn rate_of_rocking(
    variance: f64,
    threshold: f64,
    noise: &RestNoise,
    low_pass: &LowPass,
) -> f64 {
    let two_b = 2.0 * low_pass.noise_bandwidth();
    OF_A_SWING * (variance - threshold).max(0.0) * two_b * noise.gyro_white.powi(2) / 3.0
}

/// Quantile of LPMV and LPGV at rest, about the mean of a window of this length.
pub(super) fn variance_threshold(window: f64, low_pass: &LowPass, z: f64) -> f64 {
    let freedom = (low_pass.freedom() * window).max(1.0);
    of_squares(expected_variance(window, low_pass), 6.0 / freedom, z)
}

/// Quantile about a point that does not come from the window.
pub(super) fn energy_threshold(window: f64, low_pass: &LowPass, z: f64) -> f64 {
    let freedom = (low_pass.freedom() * window).max(1.0);
    of_squares(3.0, 6.0 / freedom, z)
}

/// GY of a mean over `span` seconds; infinite where the covariance is none. `rounding` is the standard deviation of what a mean
/// of gyros with coarse steps is off by, `rocks` the variance on each axis that rocking leaves in it.
pub(super) fn mean_rate(
    mean: &Vector3<f64>,
    span: f64,
    expected: &Vector3<f64>,
    expected_covariance: &Matrix3<f64>,
    rounding: &Vector3<f64>,
    rocks: f64,
    noise: &RestNoise,
) -> f64 {
    let off = mean - expected;
    let own = noise.gyro_white.powi(2) / span.max(1e-6) + BIAS_WANDER * BIAS_WANDER + rocks;
    let rounding = rounding.component_mul(rounding);
    let covariance =
        expected_covariance + Matrix3::from_diagonal(&(Vector3::repeat(own) + rounding));
    covariance
        .cholesky()
        .map_or(f64::INFINITY, |c| off.dot(&c.solve(&off)))
}

/// Its quantile: chi-square of three degrees of freedom, one in a thousand. A lesser probability would let turns of 0.3 °/s
/// pass on a unit of 3 °/√h.
pub(super) fn mean_rate_threshold() -> f64 {
    of_squares(3.0, 6.0, ONE_IN_1E3)
}
