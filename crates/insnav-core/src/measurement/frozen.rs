//! A receiver that gives the same position over and over while the body moves.

use crate::earth::Geodetic;
use crate::sample::GnssPosition;
use crate::time::Time;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Slower than this may be standing, m/s.
const LEAST_SPEED: f64 = 0.3;
/// A shorter way may be less than the last digit of the position, m: five decimals of a degree are a metre.
const LEAST_WAY: f64 = 1.5;
/// The filter alone, without a GNSS velocity, is believed to move for so long, s.
const BELIEVED: f64 = 60.0;

/// A fix against the one before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Repetition {
    /// Another position.
    New,
    /// The same to the last digit, as it is where a receiver stands or holds its position.
    Same,
    /// The same to the last digit although the body has gone on.
    Frozen,
}

/// What the body does according to the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moving {
    /// Velocity of the filter, NED, m/s.
    pub velocity_n: Vector3<f64>,
    /// Its covariance.
    pub covariance_n: Matrix3<f64>,
    /// Horizontal speed by GNSS, m/s, if one came lately.
    pub gnss_speed: Option<f64>,
}

/// The last position, and since when it is the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Frozen {
    position: Option<Geodetic>,
    since: Option<Time>,
}

impl Frozen {
    /// Judge a fix and remember it.
    pub fn judge(&mut self, fix: &GnssPosition, moving: &Moving) -> Repetition {
        let same = self.position == Some(fix.position);
        if !same {
            *self = Frozen {
                position: Some(fix.position),
                since: Some(fix.time),
            };
            return Repetition::New;
        }
        let since = self.since.map_or(0.0, |since| fix.time.since(since));
        let speed = moving.velocity_n.xy().norm();
        let variance = moving.covariance_n[(0, 0)] + moving.covariance_n[(1, 1)];
        let moves = speed > LEAST_SPEED + 4.0 * variance.max(0.0).sqrt();
        let confirmed = moving
            .gnss_speed
            .map_or(since < BELIEVED, |speed| speed > LEAST_SPEED);
        if moves && confirmed && speed * since > LEAST_WAY {
            Repetition::Frozen
        } else {
            Repetition::Same
        }
    }
}
