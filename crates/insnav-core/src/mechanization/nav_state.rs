//! Position, velocity and attitude, and how an increment moves them.

use super::increment::Increment;
use crate::attitude::{exp, left_jacobian};
use crate::earth::{Geodetic, LocalEarth};
use crate::time::Time;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Where the body is, how it moves and how it is turned, at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NavState {
    /// The instant.
    pub time: Time,
    /// Position of the IMU.
    pub position: Geodetic,
    /// Velocity over ground, NED, m/s.
    pub velocity_n: Vector3<f64>,
    /// Rotation from body (forward-right-down) to NED: `v_n = q_nb * v_b`.
    pub q_nb: UnitQuaternion<f64>,
}

/// One step of the mechanization as its error dynamics see it: mean values over the interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Length, s.
    pub dt: f64,
    /// Mean specific force in n, m/s².
    pub specific_force_n: Vector3<f64>,
    /// Body axes in n (C_b^n) in the middle of the interval.
    pub axes_n: Matrix3<f64>,
    /// Velocity in the middle, NED, m/s.
    pub velocity_n: Vector3<f64>,
    /// The Earth at the middle.
    pub earth: LocalEarth,
}

impl NavState {
    /// Move over one increment (sensor errors already taken out).
    ///
    /// NED mechanization ([Groves13] section 5.4, [Savage98b]): the velocity gain is rotated by the whole left Jacobian of the
    /// rotation, gravity, Coriolis and both frame rates are taken in the middle of the interval. Stays below 89° of latitude.
    pub fn advance(&mut self, increment: &Increment) -> Interval {
        let dt = increment.dt;
        let half = 0.5 * dt;
        let v0 = self.velocity_n;
        let start = LocalEarth::at(&self.position);

        // The gain of velocity by specific force, in the navigation axes of the begin.
        let gain_n = self.q_nb * (left_jacobian(&increment.rotation_b) * increment.velocity_b);
        let acceleration_at = |earth: &LocalEarth, v: &Vector3<f64>| {
            let coriolis = (earth.earth_rate_n() * 2.0 + earth.transport_rate_n(v)).cross(v);
            Vector3::new(0.0, 0.0, earth.gravity()) - coriolis
        };

        // Middle of the interval, predicted with the accelerations of its begin.
        let v_mid = v0 + (gain_n + acceleration_at(&start, &v0) * dt) * 0.5;
        let middle = start.moved(&((v0 + v_mid) * (0.5 * half)));
        let turn_n = (middle.earth_rate_n() + middle.transport_rate_n(&v_mid)) * dt;
        // The axes of n turn by −ω_in dt meanwhile: half of it applies, on average, to the gain.
        let gain_n = gain_n - turn_n.cross(&gain_n) * 0.5;
        self.velocity_n = v0 + gain_n + acceleration_at(&middle, &v_mid) * dt;

        let v_mean = (v0 + self.velocity_n) * 0.5;
        self.position = Geodetic {
            latitude: self.position.latitude + v_mean.x * dt / middle.meridian,
            longitude: self.position.longitude
                + v_mean.y * dt / (middle.transverse * middle.cos_latitude),
            height: self.position.height - v_mean.z * dt,
        };

        let before = self.q_nb;
        let mut q = exp(&-turn_n) * before * exp(&increment.rotation_b);
        q.renormalize_fast();
        self.q_nb = q;
        self.time = increment.time;

        Interval {
            dt,
            specific_force_n: if dt > 0.0 {
                gain_n / dt
            } else {
                Vector3::zeros()
            },
            axes_n: (before * exp(&(increment.rotation_b * 0.5)))
                .to_rotation_matrix()
                .into_inner(),
            velocity_n: v_mean,
            earth: middle,
        }
    }
}
