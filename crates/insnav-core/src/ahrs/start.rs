//! The first attitude: force and field of a fraction of a second, in axes that do not turn.

use super::settings::AhrsSettings;
use crate::attitude::exp;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Fewest inertial samples.
const FEWEST: usize = 2;
/// A field is waited for this long, s; after that heading begins at zero.
const PATIENCE: f64 = 1.0;
/// Tilt that the level of a body that seems to rest may be off by: a steady push looks like rest, rad.
const TILT_SIGMA: f64 = 0.1;
/// A body that moves is levelled over until its tilt is as good as this, rad,
const TILT_SOUGHT: f64 = 0.15;
/// or for this long, s.
const LONGEST: f64 = 2.0;
/// Gravity differs so much from place to place, m/s².
const GRAVITY_RANGE: f64 = 0.03;
/// Heading by a field that is exact, rad.
const HEADING_SIGMA: f64 = 0.02;

/// Sums in the axes of the first sample.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Start {
    turned: UnitQuaternion<f64>,
    force: Vector3<f64>,
    force_squared: f64,
    field: Vector3<f64>,
    forces: usize,
    fields: usize,
    elapsed: f64,
}

/// An attitude and what it may be off by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    pub(super) attitude: UnitQuaternion<f64>,
    /// Of roll and pitch, rad.
    pub(super) tilt_sigma: f64,
    /// By how much the force of a quiet body is longer or shorter than gravity can be, m/s².
    pub(super) length_off: f64,
    /// The mean field in level axes, and the standard deviation of the heading by it, rad.
    pub(super) field: Option<(Vector3<f64>, f64)>,
}

impl Start {
    pub(super) fn new() -> Self {
        Start {
            turned: UnitQuaternion::identity(),
            force: Vector3::zeros(),
            force_squared: 0.0,
            field: Vector3::zeros(),
            forces: 0,
            fields: 0,
            elapsed: 0.0,
        }
    }

    pub(super) fn inertial(&mut self, rate: &Vector3<f64>, force: &Vector3<f64>, interval: f64) {
        self.turned *= exp(&(rate * interval));
        self.force += self.turned * force;
        self.force_squared += force.norm_squared();
        self.forces += 1;
        self.elapsed += interval;
    }

    pub(super) fn field(&mut self, field: &Vector3<f64>) {
        self.field += self.turned * field;
        self.fields += 1;
    }

    /// The attitude now, when enough was seen; heading `heading` where there is no field, `field_off` the share that a field may be off by.
    pub(super) fn level(
        &self,
        settings: &AhrsSettings,
        heading: f64,
        field_off: f64,
    ) -> Option<Level> {
        let enough = self.forces >= FEWEST && self.elapsed >= settings.start_interval;
        if !enough || (self.fields == 0 && self.elapsed < PATIENCE) {
            return None;
        }
        let count = self.forces as f64;
        let mean = self.force / count;
        let down = -mean.try_normalize(1e-6 * settings.gravity)?;
        // Acceleration shows as scatter, and as a length that is not gravity's.
        let scatter = (self.force_squared / count - mean.norm_squared())
            .max(0.0)
            .sqrt();
        let off = scatter + (mean.norm() - settings.gravity).abs();
        // The mean acceleration is what the velocity gained, which is not much after a while.
        let gained = core::f64::consts::SQRT_2 * settings.velocity_sigma / self.elapsed;
        let tilt_sigma = TILT_SIGMA.hypot(off.min(gained) / settings.gravity);
        if tilt_sigma > TILT_SOUGHT && self.elapsed < LONGEST {
            return None;
        }
        let field = self.field / self.fields.max(1) as f64;
        let east_of_field = down.cross(&field).try_normalize(1e-3 * field.norm());
        let (north, field_sigma) = match east_of_field {
            Some(east) if self.fields > 0 => {
                let (across, along) = (field.cross(&down).norm(), field.dot(&down));
                // Where the field dips, a tilt turns its horizontal part.
                let off = (field_off * field.norm()).hypot(tilt_sigma * along) / across;
                let sigma = HEADING_SIGMA.hypot(off);
                (east.cross(&down), Some(sigma.min(1.0)))
            }
            _ => (any_across(&down), None),
        };
        let axes = [north, down.cross(&north), down];
        let matrix = Matrix3::from_rows(&axes.map(|a| a.transpose()));
        let level = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix));
        let mut attitude = level * self.turned;
        if field_sigma.is_none() {
            let now = crate::attitude::Euler::from_quaternion(&attitude).heading;
            attitude = exp(&Vector3::new(0.0, 0.0, heading - now)) * attitude;
        }
        let quiet = scatter < settings.rest.accel_scatter;
        let length_off = (mean.norm() - settings.gravity).abs() - GRAVITY_RANGE;
        Some(Level {
            attitude,
            tilt_sigma,
            length_off: if quiet { length_off.max(0.0) } else { 0.0 },
            field: field_sigma.map(|sigma| (level * field, sigma)),
        })
    }
}

/// A unit vector across another.
fn any_across(down: &Vector3<f64>) -> Vector3<f64> {
    let axis = if down.x.abs() < 0.8 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    (axis - down * down.dot(&axis)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Euler;

    fn started(
        attitude: Euler,
        rate: Vector3<f64>,
        with_field: bool,
    ) -> (Level, UnitQuaternion<f64>) {
        let (mut start, mut q) = (Start::new(), attitude.to_quaternion());
        for _ in 0..120 {
            q *= exp(&(rate * 0.01));
            start.inertial(
                &rate,
                &(q.conjugate() * Vector3::new(0.0, 0.0, -9.806_65)),
                0.01,
            );
            if with_field {
                start.field(&(q.conjugate() * Vector3::new(20.0, 0.0, 45.0)));
            }
        }
        (start.level(&AhrsSettings::default(), 0.7, 0.02).unwrap(), q)
    }

    #[test]
    fn force_and_field_give_the_attitude_at_the_end() {
        for (roll, pitch, heading) in [(10.0, -20.0, 130.0), (170.0, 5.0, -60.0), (0.0, 90.0, 0.0)]
        {
            let from = Euler::from_degrees(roll, pitch, heading);
            let (level, truth) = started(from, Vector3::new(0.2, -0.3, 0.5), true);
            assert!(level.attitude.angle_to(&truth) < 1e-9);
            let (field, _) = level.field.unwrap();
            assert!((field - Vector3::new(20.0, 0.0, 45.0)).norm() < 1e-9);
        }
    }

    #[test]
    fn without_a_field_the_heading_is_what_was_asked() {
        let (level, truth) = started(
            Euler::from_degrees(10.0, -20.0, 130.0),
            Vector3::zeros(),
            false,
        );
        let (got, want) = (
            Euler::from_quaternion(&level.attitude),
            Euler::from_quaternion(&truth),
        );
        assert!((got.heading - 0.7).abs() < 1e-9);
        assert!((got.roll - want.roll).abs() < 1e-9 && (got.pitch - want.pitch).abs() < 1e-9);
        assert!(level.field.is_none());
    }
}
