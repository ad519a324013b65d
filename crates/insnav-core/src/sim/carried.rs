//! From the point that follows a path to the unit beside it, on a body that rocks about that point.

use super::drive::{BodyRocking, Wave};
use super::trajectory::Kinematics;
use crate::attitude::{exp, left_jacobian};
use crate::earth::LocalEarth;
use crate::mechanization::NavState;
use nalgebra::Vector3;

/// Step of the differences that give the angular acceleration, s: the remainder of fourth order of a tone of 0.1° and 2 Hz is
/// 4e-9 rad/s², rounding 1e-14.
const DIFFERENCE: f64 = 2e-3;

/// A unit carried by a rocking body.
pub(super) struct Carried<'a> {
    rocking: &'a BodyRocking,
    lever_b: Vector3<f64>,
}

impl<'a> Carried<'a> {
    /// `None` where the body does not rock and the unit follows the path itself.
    pub(super) fn of(rocking: &'a BodyRocking) -> Option<Self> {
        let lever_b = Vector3::from(rocking.lever_b_m);
        let still = [&rocking.roll, &rocking.pitch, &rocking.yaw]
            .iter()
            .all(|waves| waves.is_empty());
        (!still || lever_b != Vector3::zeros()).then_some(Carried { rocking, lever_b })
    }

    /// Rotation vector of the rocking and its rate, body axes.
    fn angles(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let of = |waves: &[Wave]| {
            waves.iter().fold((0.0, 0.0), |(value, rate), wave| {
                let omega = core::f64::consts::TAU * wave.frequency_hz;
                let (s, c) = (omega * t + wave.phase_deg.to_radians()).sin_cos();
                let amplitude = wave.amplitude_deg.to_radians();
                (value + amplitude * s, rate + amplitude * omega * c)
            })
        };
        let [x, y, z] = [&self.rocking.roll, &self.rocking.pitch, &self.rocking.yaw].map(|w| of(w));
        (Vector3::new(x.0, y.0, z.0), Vector3::new(x.1, y.1, z.1))
    }

    /// The unit's motion at `t` from that of the point on the path without rocking.
    ///
    /// f_unit = f_point + ω̇ × l + ω × (ω × l), with ω = ω_ib, and the gravitation that differs between the two. The level of the unit
    /// is another than that of the point by l/R. What turns ω_in besides the acceleration over the Earth's radius is left out of
    /// ω̇: 1e-9 rad/s².
    pub(super) fn unit(
        &self,
        point: &Kinematics,
        acceleration_n: &Vector3<f64>,
        point_rate_nb_b: impl Fn(f64) -> Vector3<f64>,
        t: f64,
    ) -> Kinematics {
        let (turned, turning) = self.angles(t);
        let back = exp(&-turned);
        // The right Jacobian takes the rate of a rotation vector to the body's rate; the way's own turn is seen through the rocking.
        let angular_rate_b = back * point.angular_rate_b + left_jacobian(&-turned) * turning;
        let q_nb = point.nav.q_nb * exp(&turned);
        let force_b = back * point.specific_force_b;
        let lever = self.lever_b;
        if lever == Vector3::zeros() {
            return Kinematics {
                nav: NavState { q_nb, ..point.nav },
                angular_rate_b,
                specific_force_b: force_b,
            };
        }

        let rate_nb_b = |at: f64| {
            let (turned, turning) = self.angles(at);
            exp(&-turned) * point_rate_nb_b(at) + left_jacobian(&-turned) * turning
        };
        let at = |i: f64| rate_nb_b(t + i * DIFFERENCE);
        let relative = ((at(1.0) - at(-1.0)) * 8.0 - (at(2.0) - at(-2.0))) / (12.0 * DIFFERENCE);
        let to_b = q_nb.inverse();
        let earth = LocalEarth::at(&point.nav.position);
        let (earth_rate, transport) = (
            earth.earth_rate_n(),
            earth.transport_rate_n(&point.nav.velocity_n),
        );
        let frame_rate_b = to_b * (earth_rate + transport);
        let acceleration_b = relative - (angular_rate_b - frame_rate_b).cross(&frame_rate_b)
            + to_b * earth.transport_rate_n(acceleration_n);

        let offset_n = q_nb * lever;
        let position = point.nav.position.offset(&offset_n);
        let (north, east) = (
            position.latitude - point.nav.position.latitude,
            position.longitude - point.nav.position.longitude,
        );
        let (sin, cos) = (0.5 * (position.latitude + point.nav.position.latitude)).sin_cos();
        // Of the unit's navigation frame against that of the point.
        let frame = Vector3::new(east * cos, -north, -east * sin);
        let gravity = |earth: &LocalEarth| Vector3::new(0.0, 0.0, earth.gravity());
        let gravity_less = gravity(&earth)
            - exp(&frame) * gravity(&LocalEarth::at(&position))
            - earth_rate.cross(&earth_rate.cross(&offset_n));
        let over_earth_b = angular_rate_b - to_b * earth_rate;
        let velocity_n = point.nav.velocity_n + q_nb * over_earth_b.cross(&lever);
        Kinematics {
            nav: NavState {
                time: point.nav.time,
                position,
                velocity_n: exp(&-frame) * velocity_n,
                q_nb: exp(&-frame) * q_nb,
            },
            angular_rate_b,
            specific_force_b: force_b
                + acceleration_b.cross(&lever)
                + angular_rate_b.cross(&angular_rate_b.cross(&lever))
                + to_b * gravity_less,
        }
    }
}
