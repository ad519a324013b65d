//! What an identification says.

use nalgebra::DMatrix;
use std::string::String;
use std::vec::Vec;

/// χ² by degree of freedom above which a model does not fit: motion that is not modelled, or coloured noise.
pub const LARGEST_CHI2_PER_DOF: f64 = 3.0;

/// What became of an unknown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Estimated.
    Estimated,
    /// Estimated, and at the end of what is possible: a variance of zero, or a covariance that is singular along it.
    OnBound,
    /// Given.
    Known,
    /// Not identifiable from these data, whose standard error exceeds the value: kept at what it was before.
    Held,
}

/// Noise as estimated, with what it is worth.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Names of the unknowns, as in the basis.
    pub names: Vec<String>,
    /// θ, known values included.
    pub theta: Vec<f64>,
    /// One sigma of each; 0 for what is known or held.
    pub standard_errors: Vec<f64>,
    /// Covariance of θ.
    pub covariance: DMatrix<f64>,
    /// What became of each.
    pub verdicts: Vec<Verdict>,
    /// Q at θ, g × g, per step.
    pub q: DMatrix<f64>,
    /// R at θ, p × p.
    pub r: DMatrix<f64>,
    /// Weighted sum of squares of what the model leaves of the lag covariances.
    pub chi2: f64,
    /// Lag covariances less unknowns.
    pub dof: usize,
    /// Number of independent combinations of the free unknowns that are determined: all of them, or there is no estimate.
    pub rank: usize,
    /// Condition number of the scaled columns.
    pub condition: f64,
    /// The combination of unknowns that is determined worst, with shares.
    pub weakest: Vec<(String, f64)>,
    /// How often the weight was taken anew.
    pub reweights: usize,
}

impl Estimate {
    /// Whether the lag covariances look like those of the model: χ² at most three times its degrees of freedom.
    ///
    /// An estimate that does not fit is not one of white noise: unmodelled acceleration passes for process noise, and ends
    /// worse than the data sheet. Keep what was used before.
    pub fn fits(&self) -> bool {
        self.chi2 <= LARGEST_CHI2_PER_DOF * self.dof as f64
    }

    /// Unknowns of which the data say no more than an upper limit: their standard error exceeds the value.
    pub fn not_identified(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.theta.len()).filter(|i| {
            matches!(self.verdicts[*i], Verdict::Estimated | Verdict::OnBound)
                && self.standard_errors[*i] >= self.theta[*i].abs()
        })
    }
}
