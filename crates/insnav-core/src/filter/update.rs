//! What a filter tells about one measurement: one record for every kind.

use crate::time::Time;
use serde::{Deserialize, Serialize};

/// What became of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Used as it stands.
    Accepted,
    /// Used with its covariance enlarged until it just passed the gate.
    Inflated,
    /// Not used: the gate found it incompatible with the prediction.
    Rejected,
    /// Used after the filter's own uncertainty was widened until it fitted: a run of refused measurements agreed with each
    /// other, and this is the one that decided.
    Reset,
    /// Not used: the receiver repeats its position to the last digit while the body moves.
    Frozen,
}

impl Verdict {
    /// Whether the measurement moved the filter.
    pub fn is_used(self) -> bool {
        match self {
            Verdict::Accepted | Verdict::Inflated | Verdict::Reset => true,
            Verdict::Rejected | Verdict::Frozen => false,
        }
    }
}

/// One measurement as the filter saw it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Update {
    /// Instant of the measurement.
    pub time: Time,
    /// Name of its model, as in the configuration and the report.
    pub measurement: &'static str,
    /// Number of components, 1 to 3.
    pub dof: usize,
    /// Measured minus predicted, in the units of the measurement; components beyond `dof` are 0.
    pub residual: [f64; 3],
    /// Standard deviations of the residual as predicted (root of the diagonal of S); components beyond `dof` are 0.
    pub sigma: [f64; 3],
    /// Normalised innovation squared rᵀ S⁻¹ r with the covariance of this one measurement (without what it is weighed down by
    /// for following the one before it closely); its mean over a consistent run is `dof`.
    pub nis: f64,
    /// What became of it.
    pub verdict: Verdict,
}
