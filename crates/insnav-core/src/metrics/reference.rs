//! What a solution is compared with: any subset of position, velocity and attitude at an instant.

use crate::earth::Geodetic;
use crate::stationary::STANDING_SPEED;
use crate::time::Time;
use nalgebra::{UnitQuaternion, Vector3};

/// Attitude of a reference point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum AttitudeReference {
    /// None.
    #[default]
    None,
    /// Any of roll, pitch and heading, rad; NaN where the reference has none.
    Angles {
        /// Roll, rad.
        roll: f64,
        /// Pitch, rad.
        pitch: f64,
        /// Heading clockwise from true north, rad.
        heading: f64,
    },
    /// Rotation from body (forward-right-down) to NED.
    Quaternion(UnitQuaternion<f64>),
}

/// One instant of a reference.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ReferencePoint {
    /// The instant, on the clock of the solution.
    pub time: Time,
    /// Position.
    pub position: Option<Geodetic>,
    /// Standard deviations of the position, NED, m; zero where the reference states none.
    pub position_sigma_n: Vector3<f64>,
    /// Velocity over ground, NED, m/s; NaN components are not compared.
    pub velocity_n: Option<Vector3<f64>>,
    /// Standard deviations of the velocity, NED, m/s; zero where the reference states none.
    pub velocity_sigma_n: Vector3<f64>,
    /// Attitude.
    pub attitude: AttitudeReference,
    /// Whether the body moves, where the reference says so itself.
    pub moving: Option<bool>,
}

impl ReferencePoint {
    /// Horizontal speed, m/s.
    pub fn horizontal_speed(&self) -> Option<f64> {
        let v = self.velocity_n?;
        let speed = v.xy().norm();
        speed.is_finite().then_some(speed)
    }

    /// Whether the body stands: the reference's own word, else its horizontal speed below 0.1 m/s; `None` when it has neither.
    pub fn standing(&self) -> Option<bool> {
        match self.moving {
            Some(moving) => Some(!moving),
            None => self.horizontal_speed().map(|speed| speed < STANDING_SPEED),
        }
    }

    /// The whole attitude, if the reference has all of it.
    pub fn q_nb(&self) -> Option<UnitQuaternion<f64>> {
        match self.attitude {
            AttitudeReference::Quaternion(q) => Some(q),
            AttitudeReference::Angles {
                roll,
                pitch,
                heading,
            } => {
                let all = roll.is_finite() && pitch.is_finite() && heading.is_finite();
                all.then(|| {
                    crate::attitude::Euler {
                        roll,
                        pitch,
                        heading,
                    }
                    .to_quaternion()
                })
            }
            AttitudeReference::None => None,
        }
    }

    /// Roll, pitch and heading, rad; NaN where there is none.
    pub fn angles(&self) -> Vector3<f64> {
        match self.attitude {
            AttitudeReference::Angles {
                roll,
                pitch,
                heading,
            } => Vector3::new(roll, pitch, heading),
            AttitudeReference::Quaternion(q) => {
                let e = crate::attitude::Euler::from_quaternion(&q);
                Vector3::new(e.roll, e.pitch, e.heading)
            }
            AttitudeReference::None => Vector3::repeat(f64::NAN),
        }
    }
}
