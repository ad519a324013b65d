//! Standing by GNSS speed.

use crate::sample::GnssVelocity;
use crate::solution::Motion;
use crate::time::Time;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use serde::{Deserialize, Serialize};

/// Below this horizontal speed a receiver is taken to stand, m/s.
pub const STANDING_SPEED: f64 = 0.1;

/// For so long a velocity speaks, s: twice the interval of the slowest usual receiver. In an outage nobody knows.
const SPEAKS_FOR: f64 = 2.0;

/// Says that the body stands while GNSS says that its speed is below [`STANDING_SPEED`].
///
/// A label only: the filter is not told. A receiver without velocity never stands.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GnssSpeed {
    motion: Motion,
    heard: Heard,
    last: Option<Time>,
}

/// What a receiver's velocity says at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Heard {
    /// Horizontal speed, m/s.
    pub speed: f64,
    /// Whether there is a vertical velocity too.
    pub vertical: bool,
}

impl Default for GnssSpeed {
    fn default() -> Self {
        GnssSpeed {
            motion: Motion::Moving,
            heard: Heard::default(),
            last: None,
        }
    }
}

impl GnssSpeed {
    /// Take a velocity.
    pub fn observe(&mut self, fix: &GnssVelocity) {
        let speed = fix.velocity_n.x.hypot(fix.velocity_n.y);
        self.motion = match self.motion_at(fix.time) {
            _ if speed >= STANDING_SPEED => Motion::Moving,
            Motion::Moving => Motion::Stationary { since: fix.time },
            standing => standing,
        };
        self.heard = Heard {
            speed,
            vertical: fix.velocity_n.z.is_finite(),
        };
        self.last = Some(fix.time);
    }

    /// The last velocity, while it is not too old.
    pub fn heard_at(&self, now: Time) -> Option<Heard> {
        let last = self.last?;
        (now.since(last) <= SPEAKS_FOR).then_some(self.heard)
    }

    /// What the last velocity said, while it is not too old.
    pub fn motion_at(&self, now: Time) -> Motion {
        match self.last {
            Some(last) if now.since(last) <= SPEAKS_FOR => self.motion,
            _ => Motion::Moving,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn a_stop_lasts_while_velocities_say_so_and_no_longer() {
        let mut speed = GnssSpeed::default();
        let at = Time::from_seconds;
        assert_eq!(speed.motion_at(at(0.0)), Motion::Moving);
        let mut see = |t: f64, north: f64| {
            speed.observe(&GnssVelocity {
                time: at(t),
                velocity_n: Vector3::new(north, 0.0, 0.0),
                covariance_n: None,
            });
            speed
        };
        assert_eq!(see(1.0, 5.0).motion_at(at(1.0)), Motion::Moving);
        let standing = Motion::Stationary { since: at(2.0) };
        assert_eq!(see(2.0, 0.05).motion_at(at(2.0)), standing);
        let seen = see(3.0, 0.02);
        assert_eq!(seen.motion_at(at(4.9)), standing);
        assert_eq!(
            seen.motion_at(at(5.1)),
            Motion::Moving,
            "an outage may hide a start"
        );
        let again = Motion::Stationary { since: at(9.0) };
        assert_eq!(see(9.0, 0.02).motion_at(at(9.0)), again);
    }
}
