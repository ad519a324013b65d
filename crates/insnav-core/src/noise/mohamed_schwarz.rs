//! Innovation-based adaptation after Mohamed and Schwarz, kept for comparison.

use nalgebra::{SMatrix, SVector};

/// Mean of νν<sup>T</sup> over a window of the last `W` innovations, and the Q or R that \[MohamedSchwarz99\] make of it.
///
/// A method to compare with, not one to use: Q and R cannot both come from one covariance. Taken together they feed each
/// other and the gain goes to one; Q alone is right only with the true R, and Q̂ = L Ĉ Lᵀ has the rank of the measurement.
/// [`als_solve`](super::als_solve) uses the covariances at all lags, which do tell the two apart.
#[derive(Clone, Debug, PartialEq)]
pub struct MohamedSchwarz<const P: usize, const W: usize> {
    window: [SVector<f64, P>; W],
    next: usize,
    filled: usize,
}

impl<const P: usize, const W: usize> MohamedSchwarz<P, W> {
    /// An empty window.
    pub fn new() -> Self {
        const { assert!(W > 0, "an empty window has no mean") };
        MohamedSchwarz {
            window: [SVector::zeros(); W],
            next: 0,
            filled: 0,
        }
    }

    /// Take an innovation (or, for [`measurement_noise_of_residuals`](Self::measurement_noise_of_residuals), a residual).
    pub fn push(&mut self, innovation: &SVector<f64, P>) {
        self.window[self.next] = *innovation;
        self.next = (self.next + 1) % W;
        self.filled = (self.filled + 1).min(W);
    }

    /// Mean of νν<sup>T</sup> over the window; `None` until it is full.
    pub fn covariance(&self) -> Option<SMatrix<f64, P, P>> {
        (self.filled == W).then(|| {
            let sum = self
                .window
                .iter()
                .fold(SMatrix::zeros(), |sum, v| sum + v * v.transpose());
            sum / W as f64
        })
    }

    /// Q̂ = L Ĉ Lᵀ of the whole state, its steady-state form, with `gain` L (n × p).
    pub fn process_noise<const N: usize>(
        &self,
        gain: &SMatrix<f64, N, P>,
    ) -> Option<SMatrix<f64, N, N>> {
        Some(gain * self.covariance()? * gain.transpose())
    }

    /// R̂ = Ĉ − H P⁻ Hᵀ of the innovations. May be indefinite, and is as published.
    pub fn measurement_noise<const N: usize>(
        &self,
        h: &SMatrix<f64, P, N>,
        predicted: &SMatrix<f64, N, N>,
    ) -> Option<SMatrix<f64, P, P>> {
        Some(self.covariance()? - h * predicted * h.transpose())
    }

    /// R̂ = Ĉ + H P⁺ Hᵀ, where the window holds residuals after the update: positive definite by its form.
    pub fn measurement_noise_of_residuals<const N: usize>(
        &self,
        h: &SMatrix<f64, P, N>,
        updated: &SMatrix<f64, N, N>,
    ) -> Option<SMatrix<f64, P, P>> {
        Some(self.covariance()? + h * updated * h.transpose())
    }
}

impl<const P: usize, const W: usize> Default for MohamedSchwarz<P, W> {
    fn default() -> Self {
        Self::new()
    }
}

/// The recursion Q ← t Q + (1 − t) L ν νᵀ Lᵀ of \[Belokurov18\], t = 0.3 there.
///
/// A method to compare with, not one to use. The source it is ascribed to has a window mean; a t of 0.3 remembers one and a
/// half samples, so that Q follows single innovations. What comes out is G Q Gᵀ of the whole state, not Q.
#[derive(Clone, Debug, PartialEq)]
pub struct ForgettingProcessNoise<const N: usize> {
    /// t, the share that is kept at each step.
    pub retention: f64,
    /// Covariance of the process noise of a step, of the whole state.
    pub process: SMatrix<f64, N, N>,
}

impl<const N: usize> ForgettingProcessNoise<N> {
    /// The recursion of the paper, begun at `process`.
    pub fn new(process: SMatrix<f64, N, N>) -> Self {
        ForgettingProcessNoise {
            retention: 0.3,
            process,
        }
    }

    /// Take an innovation with the gain that it was used with.
    pub fn push<const P: usize>(
        &mut self,
        gain: &SMatrix<f64, N, P>,
        innovation: &SVector<f64, P>,
    ) {
        let correction = gain * innovation;
        self.process = self.process * self.retention
            + correction * correction.transpose() * (1.0 - self.retention);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix1, Matrix1x2, Matrix2, Matrix2x1, Vector1};

    #[test]
    fn window_is_the_last_samples_only() {
        let mut method = MohamedSchwarz::<1, 3>::new();
        for v in [100.0, 1.0, 2.0] {
            assert_eq!(method.covariance(), None);
            method.push(&Vector1::new(v));
        }
        method.push(&Vector1::new(3.0));
        assert_eq!(method.covariance(), Some(Matrix1::new(14.0 / 3.0)));
        let gain = Matrix2x1::new(0.5, 0.1);
        let q = method.process_noise(&gain).expect("full");
        // Of rank one, whatever the window.
        assert!(q.determinant().abs() < 1e-15 && (q[(0, 0)] - 14.0 / 12.0).abs() < 1e-15);
        let (h, p) = (
            Matrix1x2::new(1.0, 0.0),
            Matrix2::from_diagonal_element(2.0),
        );
        let r = method.measurement_noise(&h, &p).expect("full")[0];
        let residual = method.measurement_noise_of_residuals(&h, &p).expect("full")[0];
        assert!(
            (r - (14.0 / 3.0 - 2.0)).abs() < 1e-15 && (residual - (14.0 / 3.0 + 2.0)).abs() < 1e-15
        );
    }

    #[test]
    fn recursion_keeps_three_tenths() {
        let mut q = ForgettingProcessNoise::new(Matrix1::new(10.0));
        q.push(&Matrix1::new(0.5), &Vector1::new(4.0));
        assert!((q.process[0] - (0.3 * 10.0 + 0.7 * 4.0)).abs() < 1e-15);
    }
}
