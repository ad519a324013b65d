//! A gap in the inertial data: how it is crossed while GNSS goes on.

use crate::config::VehicleKind;
use crate::filter::{ATTITUDE, Eskf, POSITION, VELOCITY};
use crate::imu::STANDARD_GRAVITY;
use crate::mechanization::Increment;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
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

    /// Widen by what nobody sees over a step, before it is made: what is wrong at its end is not left out of the way.
    pub(super) fn widen(&mut self, step: &Increment, filter: &mut Eskf) {
        let before = self.crossed;
        self.crossed += step.dt;
        let grown = self.crossed.powi(2) - before.powi(2);
        // The integral of an error that lasts has T⁴/4; of one that grows by independent steps as much, T⁴/6.
        let lasts = (self.crossed.powi(4) - before.powi(4)) / 12.0;
        let (force, rate) = (FORCE_SIGMA.powi(2), RATE_SIGMA.powi(2));
        let by_tilt = rate * STANDARD_GRAVITY.powi(2) * lasts;
        let of = Matrix3::from_diagonal_element;
        filter.widen(POSITION, &of(force * lasts));
        filter.widen(VELOCITY, &of(force * grown + by_tilt));
        filter.widen(ATTITUDE, &of(rate * grown));
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::earth::Geodetic;
    use crate::filter::InitialSigma;
    use crate::imu::{ImuErrors, ImuGrade};
    use crate::mechanization::NavState;
    use crate::time::Time;
    use nalgebra::{UnitQuaternion, Vector3};

    /// However the way is cut.
    #[test]
    fn the_whole_of_a_gap_is_what_its_steps_are() {
        let nav = NavState {
            time: Time(0),
            position: Geodetic::from_degrees(50.0, 14.0, 250.0),
            velocity_n: Vector3::zeros(),
            q_nb: UnitQuaternion::identity(),
        };
        for (length, cuts) in [(1.9, vec![0.33, 0.71]), (0.25, vec![]), (40.0, vec![7.0])] {
            let sigma = InitialSigma {
                position: Vector3::zeros(),
                velocity: Vector3::zeros(),
                attitude: Vector3::zeros(),
                gyro_bias: Vector3::zeros(),
                accel_bias: Vector3::zeros(),
            };
            let noise = ImuGrade::Consumer.noise();
            let mut filter = Eskf::new(nav, ImuErrors::default(), &sigma, noise);
            let whole = Increment {
                time: nav.time.plus(length),
                dt: length,
                rotation_b: Vector3::zeros(),
                velocity_b: Vector3::zeros(),
            };
            let (mut gap, mut rest, mut steps) = (Gap::over(&whole), whole, 0);
            for cut in cuts.iter().map(|s| nav.time.plus(*s)).chain([whole.time]) {
                let (mut part, after) = rest.split_at(cut);
                rest = after;
                while part.dt > 0.0 {
                    let (step, left) = gap.split(&part);
                    gap.widen(&step, &mut filter);
                    part = left;
                    steps += 1;
                }
            }
            let p = filter.base_covariance();
            let (force, attitude) = (FORCE_SIGMA * length, RATE_SIGMA * length);
            let tilted = STANDARD_GRAVITY * attitude * length / 12f64.sqrt();
            let expected = [force * length / 12f64.sqrt(), force.hypot(tilted), attitude];
            for i in 0..9 {
                let off = p[(i, i)].sqrt() / expected[i / 3] - 1.0;
                assert!(off.abs() < 1e-9, "{length} s, state {i}: {off}");
            }
            assert!((3..=103).contains(&steps), "{steps}");
        }
    }
}
