//! One step of the error dynamics, as the covariance kernel takes it.

use super::columns::{Columns, States};
use super::layout::CAPACITY;

/// Φ and Q of one step: Φ = D A V X, three shears of three rows each and a decay, Q diagonal.
///
/// Applied one after the other, the shears use the old velocity for the position and the old attitude for the velocity. The
/// product differs from I + F dt in second order only; whoever needs Φ itself applies [`Transition::times`], never I + F dt.
#[derive(Clone, Copy, Debug)]
pub struct Transition {
    /// Rows of Φ − I for the position.
    pub position: Columns<3>,
    /// Rows of Φ − I for the velocity.
    pub velocity: Columns<3>,
    /// Rows of Φ − I for the attitude.
    pub attitude: Columns<3>,
    /// Factor of each state; 1 for position, velocity, attitude and constants.
    pub decay: States,
    /// Variance that each state gains.
    pub noise: States,
}

impl Default for Transition {
    fn default() -> Self {
        Transition {
            position: Columns::default(),
            velocity: Columns::default(),
            attitude: Columns::default(),
            decay: [1.0; CAPACITY],
            noise: [0.0; CAPACITY],
        }
    }
}

impl Transition {
    pub(super) const POSITION_ROW: usize = 0;
    pub(super) const VELOCITY_ROW: usize = 3;
    pub(super) const ATTITUDE_ROW: usize = 6;
    /// The first state with a decay.
    pub(super) const SLOW: usize = 9;

    /// Φ x.
    pub fn times(&self, x: &States) -> States {
        let mut out = *x;
        let shears = [
            (Self::POSITION_ROW, &self.position),
            (Self::VELOCITY_ROW, &self.velocity),
            (Self::ATTITUDE_ROW, &self.attitude),
        ];
        for (row, e) in shears {
            let add = e.times(&out);
            for (out, add) in out[row..].iter_mut().zip(add) {
                *out += add;
            }
        }
        for (out, decay) in out.iter_mut().zip(self.decay) {
            *out *= decay;
        }
        out
    }
}
