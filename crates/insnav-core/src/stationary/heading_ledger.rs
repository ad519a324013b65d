//! What a stop does to the heading, booked as it happens, in two accounts.
//!
//! *Growth* is what holding lets through: by how much the heading has left the one that is held. Propagation makes it, the updates
//! of the hold take most of it back; where the attitude is constant, it is what is turned along with a body that surely moved.
//! *Corrections* are what was learnt meanwhile of the error that the heading had when the stop began: by how much the held
//! heading itself was moved, by fixes, zero velocities, means at rest, or through what heading and gyro bias have in common. A
//! mode that holds no heading (`off`, `zupt`) has propagation in the one and all updates in the other; what keeps a heading
//! rate at zero (`zihr`) is a hold.
//!
//! Both together are all that happened: heading after − heading before = correction at entry + growth + corrections.

use crate::attitude::wrap_angle;
use serde::{Deserialize, Serialize};

/// The two accounts, rad.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct HeadingLedger {
    /// Heading when something was booked last.
    heading: f64,
    /// The one that is held, likewise.
    held: f64,
    growth: f64,
    corrections: f64,
}

impl HeadingLedger {
    /// Begin with this heading, which is held from now on.
    pub fn open(heading: f64) -> Self {
        HeadingLedger {
            heading,
            held: heading,
            growth: 0.0,
            corrections: 0.0,
        }
    }

    /// What made the heading this since the last booking was growth.
    pub fn grown(&mut self, heading: f64) {
        self.growth += wrap_angle(heading - self.heading);
        self.heading = heading;
    }

    /// A measurement made it this, and the held one `held`; without a held one, all of it was a correction.
    pub fn learnt(&mut self, heading: f64, held: Option<f64>) {
        let change = wrap_angle(heading - self.heading);
        let correction = match held {
            Some(held) => wrap_angle(held - core::mem::replace(&mut self.held, held)),
            None => change,
        };
        self.corrections += correction;
        self.growth += change - correction;
        self.heading = heading;
    }

    /// Growth so far.
    pub fn growth(&self) -> f64 {
        self.growth
    }

    /// Corrections so far.
    pub fn corrections(&self) -> f64 {
        self.corrections
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gyro that drifts by 0.3 over the stop, a hold that takes it back, and 0.05 that is learnt; across north.
    #[test]
    fn drift_that_is_taken_back_is_no_growth_and_what_is_learnt_is_no_drift() {
        let north = core::f64::consts::TAU;
        let mut ledger = HeadingLedger::open(north - 0.1);
        for i in 0..100 {
            let learnt = 5e-4 * f64::from(i);
            let held = wrap_angle(north - 0.1 + learnt);
            ledger.grown(wrap_angle(held + 0.003));
            ledger.learnt(
                wrap_angle(held + 5e-4 + 1e-6 * f64::from(i)),
                Some(wrap_angle(held + 5e-4)),
            );
        }
        assert!((ledger.corrections() - 0.05).abs() < 1e-12, "{ledger:?}");
        assert!((ledger.growth() - 99e-6).abs() < 1e-12, "{ledger:?}");
    }

    #[test]
    fn without_a_held_heading_propagation_is_growth_and_updates_are_corrections() {
        let mut ledger = HeadingLedger::open(1.0);
        ledger.grown(1.2);
        ledger.learnt(1.15, None);
        ledger.grown(1.25);
        assert!((ledger.growth() - 0.3).abs() < 1e-12);
        assert!((ledger.corrections() + 0.05).abs() < 1e-12);
    }
}
