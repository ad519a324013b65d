//! Lag covariances of innovations as they come.

#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// Sums of products νₖ₊ⱼ νₖᵀ for the lags j = 0 … `J` − 1 of an innovation of `P` components, one sample at a time.
///
/// A fixed size, no allocation, no `std` ([`LagSums`](super::LagSums) is the same for sizes at run time). The innovations must come from one filter with a constant gain, after its transient;
/// their mean is taken to be zero. What several runs show is added up: [`end_run`](Self::end_run) keeps the sums and forgets
/// the samples, so that no product spans two runs.
///
/// ```
/// use insnav_core::noise::LagAccumulator;
/// use nalgebra::Vector1;
/// let mut lags = LagAccumulator::<1, 2>::new();
/// for nu in [1.0, 2.0, 4.0] {
///     lags.push(&Vector1::new(nu));
/// }
/// assert_eq!(lags.covariance(0)[0], (1.0 + 4.0 + 16.0) / 3.0);
/// assert_eq!(lags.covariance(1)[0], (2.0 * 1.0 + 4.0 * 2.0) / 2.0);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct LagAccumulator<const P: usize, const J: usize> {
    /// The last samples of this run, newest first, by axis: the lags of one axis lie side by side.
    history: [[f64; J]; P],
    filled: usize,
    /// Sums of ν(k+j)[a] ν(k)[b], at `[b][a][j]`.
    sums: [[[f64; J]; P]; P],
    /// Sums of the weights of these products, and of their squares.
    weights: Weights<[f64; J]>,
    squares: Weights<[f64; J]>,
    retention: f64,
}

/// A sum of weights for each lag. All samples but the first ones of a run count at all lags alike: one number does for them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Weights<L> {
    /// Of samples with all lags before them.
    common: f64,
    /// Of others, by lag, in units of `scale`.
    begins: L,
    scale: f64,
}

impl<L: AsRef<[f64]> + AsMut<[f64]>> Weights<L> {
    /// None; `begins` are as many zeros as lags.
    pub(super) fn new(begins: L) -> Self {
        Weights {
            common: 0.0,
            begins,
            scale: 1.0,
        }
    }

    /// A sample that has `filled` lags, itself among them; what was there is worth `retention` of it now.
    pub(super) fn push(&mut self, filled: usize, retention: f64) {
        self.common *= retention;
        self.scale *= retention;
        if filled == self.begins.as_ref().len() {
            self.common += 1.0;
            return;
        }
        // The unit back to one, before it is too small to divide by. Lags that reach before the run began have products with
        // zero: they count for nothing.
        for (lag, weight) in self.begins.as_mut().iter_mut().enumerate() {
            *weight = *weight * self.scale + f64::from(u8::from(lag < filled));
        }
        self.scale = 1.0;
    }

    pub(super) fn at(&self, lag: usize) -> f64 {
        self.common + self.begins.as_ref()[lag] * self.scale
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.common += other.common;
        let others = other.begins.as_ref();
        for (lag, weight) in self.begins.as_mut().iter_mut().enumerate() {
            *weight = *weight * self.scale + others[lag] * other.scale;
        }
        self.scale = 1.0;
    }

    /// Of how many products of full weight a mean is as good as, where `squares` are the sums of the squares: (Σw)² / Σw².
    pub(super) fn count(&self, squares: &Self, lag: usize) -> f64 {
        let sum = squares.at(lag);
        if sum > 0.0 {
            self.at(lag).powi(2) / sum
        } else {
            0.0
        }
    }
}

impl<const P: usize, const J: usize> LagAccumulator<P, J> {
    /// An empty accumulator that remembers everything.
    pub fn new() -> Self {
        Self::forgetting(1.0)
    }

    /// An empty accumulator whose products lose the factor `retention` (0 … 1) with each sample: 1 − 1/n remembers about n.
    pub fn forgetting(retention: f64) -> Self {
        const { assert!(P > 0 && J > 0, "no axis or no lag") };
        LagAccumulator {
            history: [[0.0; J]; P],
            filled: 0,
            sums: [[[0.0; J]; P]; P],
            weights: Weights::new([0.0; J]),
            squares: Weights::new([0.0; J]),
            retention: retention.clamp(0.0, 1.0),
        }
    }

    /// Take the next innovation. One that is not finite ends the run and is not used.
    pub fn push(&mut self, innovation: &SVector<f64, P>) {
        if innovation.iter().any(|v| !v.is_finite()) {
            self.end_run();
            return;
        }
        for (axis, value) in self.history.iter_mut().zip(innovation.iter()) {
            axis.copy_within(..J - 1, 1);
            axis[0] = *value;
        }
        self.filled = (self.filled + 1).min(J);
        let w = self.retention;
        for (older, sums) in self.history.iter().zip(&mut self.sums) {
            for (newest, sums) in innovation.iter().zip(sums) {
                for (sum, value) in sums.iter_mut().zip(older) {
                    *sum = w * *sum + newest * value;
                }
            }
        }
        self.weights.push(self.filled, w);
        self.squares.push(self.filled, w * w);
    }

    /// The next sample does not follow the last one: a gap, another log, a change of the gain.
    pub fn end_run(&mut self) {
        self.history = [[0.0; J]; P];
        self.filled = 0;
    }

    /// Add what another accumulator has gathered.
    pub fn merge(&mut self, other: &Self) {
        for b in 0..P {
            for a in 0..P {
                for j in 0..J {
                    self.sums[b][a][j] += other.sums[b][a][j];
                }
            }
        }
        self.weights.add(&other.weights);
        self.squares.add(&other.squares);
    }

    /// Ĉⱼ, the mean of νₖ₊ⱼ νₖᵀ, in squared units of the innovation; zero before the first product.
    pub fn covariance(&self, lag: usize) -> SMatrix<f64, P, P> {
        let weight = self.weights.at(lag).max(f64::MIN_POSITIVE);
        SMatrix::from_fn(|a, b| self.sums[b][a][lag] / weight)
    }

    /// Of how many products of full weight the mean at a lag is as good as: (Σw)² / Σw².
    pub fn count(&self, lag: usize) -> f64 {
        self.weights.count(&self.squares, lag)
    }
}

impl<const P: usize, const J: usize> Default for LagAccumulator<P, J> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Vector1, Vector2};

    fn innovation(k: usize) -> Vector2<f64> {
        let t = k as f64;
        Vector2::new((1.7 * t).sin(), (0.9 * t * t).cos())
    }

    #[test]
    fn sums_are_those_of_the_definition() {
        let mut lags = LagAccumulator::<2, 5>::new();
        let nu: Vec<_> = (0..40).map(innovation).collect();
        nu.iter().for_each(|v| lags.push(v));
        for j in 0..5 {
            let mut mean = SMatrix::<f64, 2, 2>::zeros();
            for k in 0..40 - j {
                mean += nu[k + j] * nu[k].transpose() / (40 - j) as f64;
            }
            // Forty rounded sums.
            assert!((lags.covariance(j) - mean).amax() < 1e-14);
            assert_eq!(lags.count(j), (40 - j) as f64);
        }
    }

    #[test]
    fn no_product_spans_two_runs() {
        let (mut joined, mut first, mut second) = (
            LagAccumulator::<2, 5>::new(),
            LagAccumulator::<2, 5>::new(),
            LagAccumulator::<2, 5>::new(),
        );
        for k in 0..20 {
            joined.push(&innovation(k));
            first.push(&innovation(k));
        }
        joined.push(&Vector2::new(f64::NAN, 1.0));
        for k in 50..90 {
            joined.push(&innovation(k));
            second.push(&innovation(k));
        }
        first.merge(&second);
        for j in 0..5 {
            assert!((joined.covariance(j) - first.covariance(j)).amax() < 1e-14);
            assert_eq!(joined.count(j), 60.0 - 2.0 * j as f64);
        }
    }

    #[test]
    fn what_is_forgotten_counts_less() {
        let mut lags = LagAccumulator::<1, 3>::forgetting(0.9);
        for k in 0..500 {
            lags.push(&Vector1::new(if k < 400 { 100.0 } else { 1.0 }));
        }
        // 0.9^100 of 10⁴ is left.
        let expected = 1.0 + 0.9f64.powi(100) * (1e4 - 1.0);
        assert!((lags.covariance(0)[0] - expected).abs() < 1e-9);
        // (1 + λ) / (1 − λ)
        assert!((lags.count(0) - 19.0).abs() < 1e-9);
    }
}
