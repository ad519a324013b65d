//! The gate: is a residual compatible with its prediction?

use super::update::Verdict;
use serde::{Deserialize, Serialize};

/// Chi-square quantiles at 1 − 1e-4 for 1, 2 and 3 degrees of freedom (\[Abramowitz64\] 26.4).
const ONE_IN_TEN_THOUSAND: [f64; 3] = [15.136_7, 18.420_7, 21.107_5];

/// A chi-square gate with a way back: after too long without an accepted measurement it lets the next ones in with their
/// covariance enlarged, so that a filter that has drifted out of its own bounds is pulled home instead of locked out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gate {
    /// Largest NIS accepted, by degrees of freedom 1, 2, 3.
    pub limit: [f64; 3],
    /// Rejections in a row after which measurements are inflated instead.
    pub patience: u32,
    rejected_in_a_row: u32,
}

impl Default for Gate {
    fn default() -> Self {
        Gate {
            limit: ONE_IN_TEN_THOUSAND,
            patience: 10,
            rejected_in_a_row: 0,
        }
    }
}

impl Gate {
    /// The verdict on a NIS with `dof` degrees of freedom (1 to 3); remembers it.
    pub fn judge(&mut self, nis: f64, dof: usize) -> Verdict {
        if nis <= self.limit[dof - 1] {
            self.rejected_in_a_row = 0;
            return Verdict::Accepted;
        }
        self.rejected_in_a_row = self.rejected_in_a_row.saturating_add(1);
        if self.rejected_in_a_row > self.patience {
            Verdict::Inflated
        } else {
            Verdict::Rejected
        }
    }

    /// A gate that lets nothing through, to look at a measurement without using it.
    pub fn closed() -> Self {
        Gate {
            limit: [-1.0; 3],
            patience: u32::MAX,
            rejected_in_a_row: 0,
        }
    }

    /// A gate that widens whatever does not fit.
    pub fn lenient() -> Self {
        Gate {
            patience: 0,
            ..Gate::default()
        }
    }

    /// A gate that lets everything through.
    pub fn open() -> Self {
        Gate {
            limit: [f64::INFINITY; 3],
            ..Gate::default()
        }
    }

    /// A gate that never widens by itself: for what is true most of the time only, or where the owner decides what to do about
    /// a run of refusals.
    pub fn strict() -> Self {
        Gate {
            patience: u32::MAX,
            ..Gate::default()
        }
    }

    /// The factor on S that brings a NIS to the limit.
    pub fn inflation(&self, nis: f64, dof: usize) -> f64 {
        (nis / self.limit[dof - 1]).max(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_degrees_of_freedom_have_a_closed_form() {
        assert!((ONE_IN_TEN_THOUSAND[1] + 2.0 * 1e-4_f64.ln()).abs() < 1e-4);
    }

    #[test]
    fn rejects_then_lets_in_then_rejects_again() {
        let mut gate = Gate {
            patience: 3,
            ..Gate::default()
        };
        let bad = 1e3;
        for _ in 0..3 {
            assert_eq!(gate.judge(bad, 3), Verdict::Rejected);
        }
        assert_eq!(gate.judge(bad, 3), Verdict::Inflated);
        assert_eq!(gate.judge(2.0, 3), Verdict::Accepted);
        assert_eq!(
            gate.judge(bad, 3),
            Verdict::Rejected,
            "an accepted one starts the count anew"
        );
        assert_eq!(
            gate.judge(f64::NAN, 3),
            Verdict::Rejected,
            "NaN is never accepted"
        );
    }
}
