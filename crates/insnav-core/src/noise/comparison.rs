//! The methods for comparison with sizes at run time.

use super::Refusal;
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use std::vec::Vec;

/// [`MohamedSchwarz`](super::MohamedSchwarz) with its sizes at run time; see there what it is worth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InnovationWindow {
    channels: usize,
    length: usize,
    /// Innovations since the last full block of `length`, one after the other.
    block: Vec<f64>,
    /// Sum of their νν<sup>T</sup>.
    sum: Vec<f64>,
    /// Of the block before: the sum of νν<sup>T</sup> from its k-th to its last one, at k p².
    before: Vec<f64>,
}

impl InnovationWindow {
    /// An empty window for `length` innovations of `channels` components.
    ///
    /// # Errors
    /// [`Refusal::Setting`] for a size of zero.
    pub fn new(channels: usize, length: usize) -> Result<Self, Refusal> {
        for (what, size) in [("number of channels", channels), ("window", length)] {
            if size == 0 {
                return Err(Refusal::Setting {
                    what,
                    value: 0.0,
                    expected: "at least one",
                });
            }
        }
        Ok(InnovationWindow {
            channels,
            length,
            block: Vec::new(),
            sum: Vec::new(),
            before: Vec::new(),
        })
    }

    /// Number of components.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Innovations in a full window.
    pub fn length(&self) -> usize {
        self.length
    }

    /// Take an innovation, or a residual after the update.
    ///
    /// # Errors
    /// [`Refusal::Shape`] for another number of components.
    pub fn push(&mut self, innovation: &[f64]) -> Result<(), Refusal> {
        if innovation.len() != self.channels {
            return Err(Refusal::Shape {
                what: "innovation",
                found: std::format!("{} components", innovation.len()),
                expected: std::format!("{}", self.channels),
            });
        }
        let p = self.channels;
        self.block.extend_from_slice(innovation);
        self.sum.resize(p * p, 0.0);
        add_product(&mut self.sum, innovation);
        if self.block.len() == self.length * p {
            // What leaves the window is never subtracted: a large innovation, or one that is no number, would leave its
            // rounding behind.
            self.before.clear();
            self.before.resize(self.length * p * p, 0.0);
            self.sum.fill(0.0);
            let sums = self.before.chunks_exact_mut(p * p).rev();
            for (kept, innovation) in sums.zip(self.block.chunks_exact(p).rev()) {
                add_product(&mut self.sum, innovation);
                kept.copy_from_slice(&self.sum);
            }
            self.sum.fill(0.0);
            self.block.clear();
        }
        Ok(())
    }

    /// Mean of νν<sup>T</sup> over the window; `None` until it is full.
    pub fn covariance(&self) -> Option<DMatrix<f64>> {
        let p = self.channels;
        let older = self.before.get(self.block.len() * p..)?.get(..p * p)?;
        let sums = older.iter().zip(&self.sum);
        let mean = sums.map(|(older, newer)| (older + newer) / self.length as f64);
        Some(DMatrix::from_iterator(p, p, mean))
    }

    /// Q̂ = L Ĉ Lᵀ of the whole state with `gain` L (n × p).
    ///
    /// # Errors
    /// [`Refusal::Shape`] for a gain of another width.
    pub fn process_noise(&self, gain: &DMatrix<f64>) -> Result<Option<DMatrix<f64>>, Refusal> {
        shape("gain", gain, gain.nrows(), self.channels)?;
        Ok(self.covariance().map(|c| gain * c * gain.transpose()))
    }

    /// R̂ = Ĉ − H P⁻ Hᵀ of innovations, as published: may be indefinite.
    ///
    /// # Errors
    /// [`Refusal::Shape`] for matrices that do not fit.
    pub fn measurement_noise(
        &self,
        h: &DMatrix<f64>,
        predicted: &DMatrix<f64>,
    ) -> Result<Option<DMatrix<f64>>, Refusal> {
        let hph = self.projected(h, predicted)?;
        Ok(self.covariance().map(|c| c - hph))
    }

    /// R̂ = Ĉ + H P⁺ Hᵀ, where the window holds residuals after the update.
    ///
    /// # Errors
    /// [`Refusal::Shape`] for matrices that do not fit.
    pub fn measurement_noise_of_residuals(
        &self,
        h: &DMatrix<f64>,
        updated: &DMatrix<f64>,
    ) -> Result<Option<DMatrix<f64>>, Refusal> {
        let hph = self.projected(h, updated)?;
        Ok(self.covariance().map(|c| c + hph))
    }

    fn projected(&self, h: &DMatrix<f64>, p: &DMatrix<f64>) -> Result<DMatrix<f64>, Refusal> {
        shape("H", h, self.channels, h.ncols())?;
        shape("P", p, h.ncols(), h.ncols())?;
        Ok(h * p * h.transpose())
    }
}

/// [`ForgettingProcessNoise`](super::ForgettingProcessNoise) with its size at run time; see there what it is worth.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ForgettingNoise {
    /// t, the share that is kept at each step.
    pub retention: f64,
    /// Covariance of the process noise of a step, of the whole state.
    #[serde(with = "super::stored")]
    pub process: DMatrix<f64>,
}

impl ForgettingNoise {
    /// Take an innovation with the gain that it was used with: Q ← t Q + (1 − t) L ν νᵀ Lᵀ.
    ///
    /// # Errors
    /// [`Refusal::Shape`] where gain and innovation do not fit.
    pub fn push(&mut self, gain: &DMatrix<f64>, innovation: &[f64]) -> Result<(), Refusal> {
        shape("gain", gain, self.process.nrows(), innovation.len())?;
        let correction = gain * DVector::from_column_slice(innovation);
        self.process = &self.process * self.retention
            + &correction * correction.transpose() * (1.0 - self.retention);
        Ok(())
    }
}

fn add_product(sum: &mut [f64], v: &[f64]) {
    for (column, b) in sum.chunks_exact_mut(v.len()).zip(v) {
        for (s, a) in column.iter_mut().zip(v) {
            *s += a * b;
        }
    }
}

fn shape(what: &'static str, m: &DMatrix<f64>, rows: usize, columns: usize) -> Result<(), Refusal> {
    if m.shape() == (rows, columns) {
        return Ok(());
    }
    Err(Refusal::Shape {
        what,
        found: std::format!("{} x {}", m.nrows(), m.ncols()),
        expected: std::format!("{rows} x {columns}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::{ForgettingProcessNoise, MohamedSchwarz};
    use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix3x2, Vector2};

    fn dynamic<const N: usize, const M: usize>(m: &nalgebra::SMatrix<f64, N, M>) -> DMatrix<f64> {
        DMatrix::from_column_slice(N, M, m.as_slice())
    }

    /// Products of matrices of other storage may be summed in another order: a rounding or two.
    fn same<const N: usize, const M: usize>(
        a: Option<DMatrix<f64>>,
        b: Option<nalgebra::SMatrix<f64, N, M>>,
    ) -> bool {
        match (a, b) {
            (Some(a), Some(b)) => (a - dynamic(&b)).amax() <= 1e-14 * b.amax(),
            (a, b) => a.is_none() && b.is_none(),
        }
    }

    #[test]
    fn both_are_those_of_fixed_size() {
        let mut fixed = MohamedSchwarz::<2, 4>::new();
        let mut window = InnovationWindow::new(2, 4).expect("sizes");
        let gain = Matrix3x2::new(0.5, 0.1, -0.2, 0.3, 0.7, 0.4);
        let h = Matrix2x3::new(1.0, 0.2, 0.0, -0.3, 1.0, 0.5);
        let p = Matrix3::new(2.0, 0.1, 0.0, 0.1, 1.0, 0.3, 0.0, 0.3, 4.0);
        let mut q = ForgettingProcessNoise::new(p);
        let mut noise = ForgettingNoise {
            retention: q.retention,
            process: dynamic(&p),
        };
        for k in 0..9 {
            let t = f64::from(k);
            let nu = Vector2::new((1.7 * t).sin(), (0.9 * t * t).cos());
            fixed.push(&nu);
            window.push(nu.as_slice()).expect("two components");
            assert_eq!(window.covariance().is_some(), k >= 3);
            assert!(same(window.covariance(), fixed.covariance()));
            let (g, hd, pd) = (dynamic(&gain), dynamic(&h), dynamic(&p));
            assert!(same(
                window.process_noise(&g).expect("fits"),
                fixed.process_noise(&gain)
            ));
            let r = window.measurement_noise(&hd, &pd).expect("fits");
            assert!(same(r, fixed.measurement_noise(&h, &p)));
            let r = window
                .measurement_noise_of_residuals(&hd, &pd)
                .expect("fits");
            assert!(same(r, fixed.measurement_noise_of_residuals(&h, &p)));
            q.push(&gain, &nu);
            noise.push(&g, nu.as_slice()).expect("fits");
            assert!(same(Some(noise.process.clone()), Some(q.process)));
        }
    }

    #[test]
    fn what_left_the_window_leaves_nothing_behind() {
        for length in [1, 2, 5, 7] {
            let mut window = InnovationWindow::new(2, length).expect("sizes");
            let record: Vec<[f64; 2]> = (0..60)
                .map(|k| match k {
                    20 => [1e12, -1e9],
                    33 => [f64::NAN, 1.0],
                    _ => [f64::from(k).sin(), (0.7 * f64::from(k * k)).cos()],
                })
                .collect();
            for (k, nu) in record.iter().enumerate() {
                window.push(nu).expect("two components");
                let Some(mean) = window.covariance() else {
                    assert!(k + 1 < length);
                    continue;
                };
                assert!(k + 1 >= length);
                let last = &record[k + 1 - length..=k];
                let expected = DMatrix::from_fn(2, 2, |a, b| {
                    last.iter().map(|v| v[a] * v[b]).sum::<f64>() / length as f64
                });
                let largest = last.iter().flatten().filter(|v| v.is_finite());
                let scale = largest.fold(0.0, |m: f64, v| m.max(v * v));
                // Sums of seven products in another order.
                let same =
                    |a: f64, b: f64| (a.is_nan() && b.is_nan()) || (a - b).abs() <= 1e-14 * scale;
                let all = mean.iter().zip(&expected).all(|(a, b)| same(*a, *b));
                assert!(all, "{length} at {k}: {mean} {expected}");
            }
        }
    }

    #[test]
    fn other_sizes_are_refused() {
        assert!(InnovationWindow::new(0, 3).is_err() && InnovationWindow::new(2, 0).is_err());
        let mut window = InnovationWindow::new(2, 3).expect("sizes");
        assert!(window.push(&[1.0]).is_err());
        assert!(window.process_noise(&DMatrix::zeros(3, 3)).is_err());
        let p = dynamic(&Matrix2::<f64>::identity());
        assert!(window.measurement_noise(&DMatrix::zeros(2, 3), &p).is_err());
        let mut noise = ForgettingNoise {
            retention: 0.3,
            process: p,
        };
        assert!(noise.push(&DMatrix::zeros(2, 2), &[1.0]).is_err());
    }
}
