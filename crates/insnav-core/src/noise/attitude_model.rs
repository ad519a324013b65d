//! Error models of an attitude filter whose noise is to be identified.

use super::LinearModel;
use nalgebra::DMatrix;

impl LinearModel {
    /// Error of one attitude angle and of its gyro's bias: states (rad, rad/s), measured the angle, noise of both states.
    ///
    /// `step_s` T between samples; `bias_time_s` τ of the first-order Gauss–Markov bias, infinite for a random walk:
    ///
    /// ```text
    /// θ₊ = θ − T b + w₁      b₊ = e^(−T/τ) b + w₂      y = θ + v
    /// ```
    ///
    /// Errors are resolved in the navigation frame, true = (1 + θ×) estimate: nothing turns with the body, so that noise which
    /// is the same on all axes stays stationary in motion. The published scheme (\[Belokurov18\]) has the body's frame,
    /// halves of these elements that are not there, and a bias that is driven by the attitude.
    pub fn attitude_channel(step_s: f64, bias_time_s: f64) -> Self {
        LinearModel {
            f: DMatrix::from_row_slice(2, 2, &[1.0, -step_s, 0.0, (-step_s / bias_time_s).exp()]),
            g: DMatrix::identity(2, 2),
            h: DMatrix::from_row_slice(1, 2, &[1.0, 0.0]),
        }
    }

    /// Three [`attitude_channel`](Self::attitude_channel)s in one model: angles first, then biases.
    pub fn attitude_axes(step_s: f64, bias_time_s: f64) -> Self {
        let channel = Self::attitude_channel(step_s, bias_time_s);
        let axes = DMatrix::identity(3, 3);
        LinearModel {
            f: channel.f.kronecker(&axes),
            g: DMatrix::identity(6, 6),
            h: channel.h.kronecker(&axes),
        }
    }
}

/// Variance that a Gauss–Markov bias of steady sigma `sigma` gains in a step: σ² (1 − e^(−2T/τ)), unit of the bias squared.
///
/// Per step, not the density 2 σ²/τ.
pub fn bias_noise_per_step(sigma: f64, bias_time_s: f64, step_s: f64) -> f64 {
    -sigma * sigma * (-2.0 * step_s / bias_time_s).exp_m1()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DVector;

    /// A gyro that reads 1 °/s too much: the estimate runs ahead, the error (true less estimate) falls by 1° in a second.
    #[test]
    fn a_degree_per_second_is_a_degree_in_a_second() {
        let model = LinearModel::attitude_channel(0.01, f64::INFINITY);
        let mut error = DVector::from_vec(vec![0.0, 1.0]);
        for _ in 0..100 {
            error = &model.f * error;
        }
        assert!((error[0] + 1.0).abs() < 1e-12 && error[1] == 1.0);
    }

    #[test]
    fn attitude_does_not_drive_the_bias() {
        let model = LinearModel::attitude_axes(0.032, 100.0);
        assert_eq!(model.f.view((3, 0), (3, 3)).amax(), 0.0);
        assert_eq!(model.f[(1, 4)], -0.032);
        assert_eq!(model.f[(1, 3)], 0.0);
    }

    #[test]
    fn bias_keeps_its_sigma() {
        let (sigma, tau, step) = (0.3, 20.0f64, 0.5);
        let phi = (-step / tau).exp();
        let steady = bias_noise_per_step(sigma, tau, step) / (1.0 - phi * phi);
        assert!((steady - sigma * sigma).abs() < 1e-15);
    }
}
