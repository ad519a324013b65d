//! Position, velocity and attitude, and how an increment moves them.

use super::increment::Increment;
use crate::attitude::{exp, left_jacobian_times};
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
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
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

impl Interval {
    /// This interval and the next as one: means over both, and the Earth of the later.
    #[must_use]
    pub fn and(&self, next: &Interval) -> Self {
        let dt = self.dt + next.dt;
        let (before, after) = (self.dt / dt, next.dt / dt);
        Interval {
            dt,
            specific_force_n: self.specific_force_n * before + next.specific_force_n * after,
            axes_n: self.axes_n * before + next.axes_n * after,
            velocity_n: self.velocity_n * before + next.velocity_n * after,
            earth: next.earth,
        }
    }
}

impl NavState {
    /// Move over one increment (sensor errors already taken out).
    ///
    /// NED mechanization (\[Groves13\] section 5.4, \[Savage98b\]): the velocity gain is rotated by the whole left Jacobian of the
    /// rotation, gravity, Coriolis and both frame rates are taken in the middle of the interval. Stays below 89° of latitude.
    pub fn advance(&mut self, increment: &Increment) -> Interval {
        let dt = increment.dt;
        let half = 0.5 * dt;
        let v0 = self.velocity_n;
        let start = LocalEarth::at(&self.position);

        // The gain of velocity by specific force, in the navigation axes of the begin.
        let gain_n = self.q_nb * left_jacobian_times(&increment.rotation_b, &increment.velocity_b);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{Euler, log};
    use crate::earth::{EARTH_RATE, gravity, meridian_radius, transverse_radius};
    use proptest::prelude::*;

    fn at_rest(latitude_deg: f64, attitude_deg: [f64; 3]) -> NavState {
        let [roll, pitch, heading] = attitude_deg;
        NavState {
            time: Time(0),
            position: Geodetic::from_degrees(latitude_deg, 20.0, 300.0),
            velocity_n: Vector3::zeros(),
            q_nb: Euler::from_degrees(roll, pitch, heading).to_quaternion(),
        }
    }

    /// What the sensors feel over `dt` at a velocity that stays as it is, against axes that turn with the navigation frame.
    fn steady(nav: &NavState, dt: f64) -> Increment {
        let earth = LocalEarth::at(&nav.position);
        let (earth_rate, transport_rate) = (
            earth.earth_rate_n(),
            earth.transport_rate_n(&nav.velocity_n),
        );
        let force_n = (earth_rate * 2.0 + transport_rate).cross(&nav.velocity_n)
            - Vector3::new(0.0, 0.0, earth.gravity());
        let to_b = nav.q_nb.inverse();
        Increment {
            time: nav.time.plus(dt),
            dt,
            rotation_b: to_b * (earth_rate + transport_rate) * dt,
            velocity_b: to_b * force_n * dt,
        }
    }

    proptest! {
        /// In two parts or in one. What differs is what the trapezoid of the position leaves out within one interval, and
        /// what the frame's rate (ω_in, 2e-4 rad/s at most here) makes of it.
        #[test]
        fn split_equals_whole(
            latitude_deg in -80.0..80.0f64, angles in prop::array::uniform3(-180.0..180.0f64),
            velocity in prop::array::uniform3(-60.0..60.0f64), rate in prop::array::uniform3(-1.2..1.2f64),
            force in prop::array::uniform3(-17.0..17.0f64), dt in 0.002..0.05f64, share in 0.0..1.0f64,
        ) {
            let mut whole = at_rest(latitude_deg, angles);
            whole.velocity_n = Vector3::from(velocity);
            let mut parts = whole;
            let (rate, force) = (Vector3::from(rate), Vector3::from(force));
            let increment = Increment {
                time: Time::from_seconds(dt), dt, rotation_b: rate * dt, velocity_b: force * dt,
            };
            whole.advance(&increment);
            let (head, tail) = increment.split_at(Time::from_seconds(dt * share));
            parts.advance(&head);
            parts.advance(&tail);

            prop_assert_eq!(parts.time, whole.time);
            // Largest deviation of the velocity from a straight line: |v̈| dt²/8.
            let bend = rate.norm() * force.norm() * dt * dt / 8.0;
            let frame_rate = 2e-4;
            let position = whole.position.offset_to(&parts.position).norm();
            let velocity = (whole.velocity_n - parts.velocity_n).norm();
            let attitude = log(&(whole.q_nb * parts.q_nb.inverse())).norm();
            // Rounding of a longitude in radians is 4e-16 of it, or 4e-9 m.
            prop_assert!(position < bend * dt + 1e-8, "{position:e} {:e}", bend * dt);
            prop_assert!(velocity < 4.0 * frame_rate * bend * dt + 1e-13, "{velocity:e}");
            prop_assert!(attitude < bend * dt / 1e6 + 2e-15, "{attitude:e}");
        }

        #[test]
        fn standing_body_stays(latitude_deg in -85.0..85.0f64, angles in prop::array::uniform3(-180.0..180.0f64)) {
            let start = at_rest(latitude_deg, angles);
            let mut nav = start;
            for _ in 0..6000 {
                // The sensors are fixed to the ground, not to the computed state.
                let increment = Increment { time: nav.time.plus(0.01), ..steady(&start, 0.01) };
                nav.advance(&increment);
            }
            // Two products and a normalisation round each of four components twice (6e-17), a rotation is twice its
            // quaternion's change, and the same numbers come again at every step.
            let tilt = 6000.0 * 3.0 * 2.0 * 2.0 * 2.0 * 6e-17;
            prop_assert!(log(&(nav.q_nb * start.q_nb.inverse())).norm() < tilt);
            // It tilts gravity; and the frame's turn within a step acts to first order, its square leaves ω² g dt².
            let acceleration = 9.83 * (EARTH_RATE * EARTH_RATE * 1e-4 + tilt);
            prop_assert!(nav.velocity_n.norm() < acceleration * 60.0, "{}", nav.velocity_n);
            prop_assert!(start.position.offset_to(&nav.position).norm() < 0.5 * acceleration * 3600.0 + 1e-9);
        }

        /// Along a parallel at constant speed everything is constant in the turning axes, so the way is known in closed form:
        /// λ = λ₀ + v t / ((N + h) cos L). Any step length must give it.
        #[test]
        fn eastward_cruise_follows_the_parallel(
            latitude_deg in -80.0..80.0f64, speed in -250.0..250.0f64, dt in 0.01..0.5f64,
        ) {
            let mut nav = at_rest(latitude_deg, [2.0, 5.0, 80.0]);
            nav.velocity_n.y = speed;
            let start = nav;
            let steps = 500;
            for _ in 0..steps {
                let increment = Increment { time: nav.time.plus(dt), ..steady(&start, dt) };
                nav.advance(&increment);
            }
            let t = dt * f64::from(steps);
            let l = start.position.latitude;
            let radius = (transverse_radius(l) + start.position.height) * l.cos();
            let longitude = start.position.longitude + speed * t / radius;
            // As above with the whole turn of the frame, and half a unit in the last place of the longitude (3e-17 rad) per
            // step, always to the same side.
            let turn = (EARTH_RATE + speed.abs() / radius) * dt;
            let bound = 0.5 * 9.83 * turn * turn * t * t + 500.0 * 3e-17 * 6.4e6 + 1e-8;
            prop_assert!((nav.position.longitude - longitude).abs() * radius < bound);
            prop_assert!((nav.position.latitude - l).abs() * 6.4e6 < bound);
            prop_assert!((nav.position.height - start.position.height).abs() < bound);
        }
    }

    /// A resting body believed to move north oscillates with T = 2π √(M/g) (\[Groves13\] section 5.7.2, Schuler). On the equator,
    /// where the Foucault turn vanishes; the height is held, as its own instability would mix in.
    #[test]
    fn wrong_velocity_oscillates_with_schulers_period() {
        let mut nav = at_rest(0.0, [0.0, 0.0, 30.0]);
        nav.position.height = 0.0;
        let rest = nav;
        nav.velocity_n.x = 0.1;
        let dt = 0.1;
        let mut crossings = [0.0; 2];
        let mut found = 0;
        for i in 0..60_000 {
            let before = nav.velocity_n.x;
            nav.advance(&steady(&rest, dt));
            nav.position.height = 0.0;
            nav.velocity_n.z = 0.0;
            if before * nav.velocity_n.x <= 0.0 && found < 2 {
                crossings[found] = dt * (f64::from(i) + before / (before - nav.velocity_n.x));
                found += 1;
            }
        }
        assert_eq!(found, 2, "a quarter and three quarters of 84 minutes");
        let at = rest.position;
        let period = core::f64::consts::TAU * (meridian_radius(at.latitude) / gravity(&at)).sqrt();
        let measured = 2.0 * (crossings[1] - crossings[0]);
        // With the other radius of curvature, 0.7 % larger, the period would be 0.3 % longer.
        assert!(
            (measured / period - 1.0).abs() < 1e-5,
            "{measured} {period}"
        );
        assert!((period - 5057.0).abs() < 5.0);
    }

    #[test]
    fn empty_interval_changes_nothing() {
        let mut nav = at_rest(50.0, [1.0, 2.0, 3.0]);
        nav.velocity_n = Vector3::new(3.0, -4.0, 0.5);
        let before = nav;
        let nothing = Vector3::zeros();
        let interval = nav.advance(&Increment {
            time: Time(0),
            dt: 0.0,
            rotation_b: nothing,
            velocity_b: nothing,
        });
        assert_eq!(
            (nav.position, nav.velocity_n),
            (before.position, before.velocity_n)
        );
        assert!(log(&(nav.q_nb * before.q_nb.inverse())).norm() < 1e-15);
        assert_eq!(interval.specific_force_n, nothing);
    }

    /// The error dynamics linearise about these: they must be what they say.
    #[test]
    fn interval_tells_the_means() {
        let mut nav = at_rest(-35.0, [10.0, -5.0, 120.0]);
        nav.velocity_n = Vector3::new(20.0, 5.0, -1.0);
        let start = nav;
        let increment = Increment {
            time: Time::from_seconds(0.02),
            dt: 0.02,
            rotation_b: Vector3::new(0.01, -0.02, 0.015),
            velocity_b: Vector3::new(0.05, 0.02, -0.2),
        };
        let interval = nav.advance(&increment);
        assert_eq!(interval.dt, 0.02);
        assert!((interval.velocity_n - (start.velocity_n + nav.velocity_n) * 0.5).norm() < 1e-15);
        let (half, _) = increment.split_at(Time::from_seconds(0.01));
        let mut middle = start;
        middle.advance(&half);
        // The frame's turn in half the interval is 1e-6 rad.
        assert!((interval.axes_n - middle.q_nb.to_rotation_matrix().into_inner()).amax() < 2e-6);
        assert!((interval.earth.sin_latitude - middle.position.latitude.sin()).abs() < 1e-12);
        // Without Coriolis and gravity, the velocity's change is the force's: 1e-3 m/s² of Coriolis here.
        let change = (nav.velocity_n - start.velocity_n) / 0.02
            - Vector3::new(0.0, 0.0, gravity(&start.position));
        assert!((change - interval.specific_force_n).norm() < 5e-3);
    }
}
