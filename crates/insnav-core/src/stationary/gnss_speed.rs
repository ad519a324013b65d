//! Standing by GNSS speed.

use crate::sample::GnssVelocity;
use crate::solution::Motion;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

/// Below this horizontal speed a receiver is taken to stand, m/s.
pub const STANDING_SPEED: f64 = 0.1;

/// Says that the body stands while GNSS says that its speed is below [`STANDING_SPEED`].
///
/// A label only: the filter is not told. A receiver without velocity never stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GnssSpeed {
    motion: Motion,
}

impl Default for GnssSpeed {
    fn default() -> Self {
        GnssSpeed {
            motion: Motion::Moving,
        }
    }
}

impl GnssSpeed {
    /// Take a velocity.
    pub fn observe(&mut self, fix: &GnssVelocity) {
        let speed = fix.velocity_n.x.hypot(fix.velocity_n.y);
        self.motion = match self.motion {
            _ if speed >= STANDING_SPEED => Motion::Moving,
            Motion::Moving => Motion::Stationary { since: fix.time },
            standing => standing,
        };
    }

    /// What the last velocity said.
    pub fn motion(&self) -> Motion {
        self.motion
    }
}
