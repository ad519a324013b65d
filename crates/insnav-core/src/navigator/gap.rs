//! A gap in the inertial data: how it is crossed while GNSS goes on.

use crate::config::VehicleKind;
use crate::filter::{ATTITUDE, Eskf, VELOCITY};
use crate::imu::STANDARD_GRAVITY;
use crate::mechanization::Increment;
use nalgebra::Matrix3;

/// What a vehicle may do unseen, beyond what the samples at both ends show: rate, rad/s, and specific force, m/s².
const RATE_SIGMA: f64 = 0.1;
const FORCE_SIGMA: f64 = 1.0;
/// A car goes round a corner in this time, s: no linear filter bridges that, and its course tells the heading anew.
const LONGEST_OF_CARS: f64 = 2.0;
/// Others may never find their heading again, s.
const LONGEST: f64 = 5.0;
/// Uncertainty grows in steps of so many seconds, or of a hundredth of the gap.
const STEP: f64 = 0.1;

/// The longest gap in the inertial data, s, that is bridged while GNSS is used: after a longer one a run ends and another begins.
pub fn longest_bridged(vehicle: VehicleKind) -> f64 {
    match vehicle {
        VehicleKind::Car => LONGEST_OF_CARS,
        _ => LONGEST,
    }
}

/// A gap, up to where it has been crossed.
///
/// Rate and force may be wrong all along, so that the errors of attitude and velocity grow with time, not with its root: over T seconds
/// their variances are σ²T². They grow on the way, and what they are at one instant they have done to the position by then: a fix in the
/// middle tells of the first half, nothing of the second.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gap {
    crossed: f64,
    step: f64,
}

impl Gap {
    /// Before the whole increment over it.
    pub(super) fn over(whole: &Increment) -> Self {
        Gap {
            crossed: 0.0,
            step: STEP.max(0.01 * whole.dt),
        }
    }

    /// The next step of `rest`, and what is left after it.
    pub(super) fn split(&self, rest: &Increment) -> (Increment, Increment) {
        rest.split_at(rest.time.plus(self.step - rest.dt))
    }

    /// Widen what nobody saw over the step that was just made.
    pub(super) fn widen(&mut self, step: &Increment, filter: &mut Eskf) {
        let before = self.crossed;
        self.crossed += step.dt;
        let grown = self.crossed * self.crossed - before * before;
        let of = |sigma: f64| Matrix3::from_diagonal_element(sigma * sigma * grown);
        filter.widen(VELOCITY, &of(FORCE_SIGMA));
        filter.widen(ATTITUDE, &of(RATE_SIGMA));
    }
}

/// An increment over a gap. A unit that did not count on in between gives that of its last interval alone, which gravity
/// shows: it is then held for the whole gap, as rates are.
pub(super) fn held_over_gap(increment: &Increment) -> Increment {
    let expected = STANDARD_GRAVITY * increment.dt;
    let seen = increment.velocity_b.norm();
    let factor = if seen > 0.0 && seen < 0.5 * expected {
        expected / seen
    } else {
        1.0
    };
    Increment {
        rotation_b: increment.rotation_b * factor,
        velocity_b: increment.velocity_b * factor,
        ..*increment
    }
}
