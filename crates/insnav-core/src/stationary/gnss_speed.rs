//! What the receiver said last about the speed.

use crate::sample::GnssVelocity;
use crate::time::Time;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

/// Below this horizontal speed a reference is taken to stand, m/s.
pub const STANDING_SPEED: f64 = 0.1;

/// For so long a velocity speaks, s: twice the interval of the slowest usual receiver. In an outage nobody knows.
const SPEAKS_FOR: f64 = 2.0;

/// Remembers the last velocity, while it speaks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GnssSpeed {
    last: Option<(Time, Heard)>,
}

/// What a receiver's velocity says at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Heard {
    /// Horizontal speed, m/s.
    pub speed: f64,
    /// Whether there is a vertical velocity too.
    pub vertical: bool,
}

impl GnssSpeed {
    /// Take a velocity.
    pub fn observe(&mut self, fix: &GnssVelocity) {
        let heard = Heard {
            speed: fix.velocity_n.x.hypot(fix.velocity_n.y),
            vertical: fix.velocity_n.z.is_finite(),
        };
        self.last = Some((fix.time, heard));
    }

    /// The last velocity, while it is not too old.
    pub fn heard_at(&self, now: Time) -> Option<Heard> {
        let (last, heard) = self.last?;
        (now.since(last) <= SPEAKS_FOR).then_some(heard)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn a_velocity_speaks_for_two_seconds() {
        let mut speed = GnssSpeed::default();
        let at = Time::from_seconds;
        assert_eq!(speed.heard_at(at(0.0)), None);
        speed.observe(&GnssVelocity {
            time: at(1.0),
            velocity_n: Vector3::new(3.0, -4.0, f64::NAN),
            covariance_n: None,
        });
        let heard = Heard {
            speed: 5.0,
            vertical: false,
        };
        assert_eq!(speed.heard_at(at(2.9)), Some(heard));
        assert_eq!(speed.heard_at(at(3.1)), None, "an outage may hide a start");
    }
}
