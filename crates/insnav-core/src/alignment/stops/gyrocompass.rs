//! Gyrocompassing by a levelling loop: the paper's alignment mode.

use super::place::Place;
use super::record::{Record, Span};
use crate::attitude::exp;
use nalgebra::{UnitQuaternion, Vector2, Vector3};

/// Triple pole of the loop, rad/s: settled after a minute, and rocking of 10 s is damped sixfold.
const POLE: f64 = 0.1;

/// What the loop shows over a stop, in a level frame that only the Earth's vertical rate turns.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Loop {
    /// Mean, over the window's second half, of the controls that keep it level, about its x and y: the horizontal rate that the gyros sense, rad/s.
    pub(super) rate: Vector2<f64>,
    /// Body to level frame at the end.
    pub(super) q_level: UnitQuaternion<f64>,
    /// Body to level frame at the nodes of the window.
    pub(super) attitudes: std::vec::Vec<UnitQuaternion<f64>>,
    pub(super) window: Span,
}

/// Run the loop from node `from` through `window`; it settles until the middle of that, and its second half is averaged.
///
/// Third order: v̇ = f − 3p v, u = (3p²/g) v + (p³/g) ∫v as the turn that levels (\[Lobusov14\], alignment mode, eq. (1)).
pub(super) fn levelling_loop(
    record: &Record,
    from: usize,
    window: Span,
    place: &Place,
    q_level: UnitQuaternion<f64>,
) -> Loop {
    let gains = [
        3.0 * POLE,
        3.0 * POLE * POLE / place.gravity,
        POLE.powi(3) / place.gravity,
    ];
    let (mut q, mut v, mut integral) = (q_level, Vector2::zeros(), Vector2::<f64>::zeros());
    let (mut sum, mut time) = (Vector2::zeros(), 0.0);
    let mut attitudes = std::vec::Vec::with_capacity(window.end - window.begin + 1);
    for (k, node) in record.nodes.iter().enumerate().take(window.end).skip(from) {
        if k >= window.begin {
            attitudes.push(q);
        }
        let dt = node.dt;
        let gain = q * node.gain;
        v += Vector2::new(gain.x, gain.y) - v * (gains[0] * dt);
        integral += v * (gains[2] * dt);
        // Tilted about y, x feels gravity: a turn about y levels x, and one about −x levels y.
        let control = |v: &Vector2<f64>| Vector2::new(-v.y, v.x);
        let turn = -(control(&(v * gains[1])) + control(&integral));
        if k >= (window.begin + window.end) / 2 {
            // The integrator alone: the proportional part averages to nothing and only adds rocking.
            sum -= control(&integral) * dt;
            time += dt;
        }
        let frame = Vector3::new(turn.x, turn.y, place.earth_n.z) * dt;
        q = UnitQuaternion::new_normalize((exp(&-frame) * q * node.rotation).into_inner());
    }
    attitudes.push(q);
    Loop {
        rate: sum / time,
        q_level: q,
        attitudes,
        window,
    }
}

impl Loop {
    /// Azimuth of the level frame's x axis, clockwise from north, rad.
    pub(super) fn azimuth(&self) -> f64 {
        (-self.rate.y).atan2(self.rate.x)
    }
}
