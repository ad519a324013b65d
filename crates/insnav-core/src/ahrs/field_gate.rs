//! Is the measured magnetic field that of the Earth here?

#[cfg(not(feature = "std"))]
use nalgebra::RealField;
use nalgebra::{UnitQuaternion, Vector3};

/// A gate on the length and the dip of the magnetic field, against what they were over the first samples with a tilt that was known.
///
/// It judges the heading alone: what it refuses is left out of the heading, never of the tilt. Iron that changes neither length
/// nor dip (a disturbance across the field, horizontally) is not seen; of that an innovation tells, once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldGate {
    /// Largest change of the length, as a share of it.
    pub length_share: f64,
    /// Largest change of the dip, rad.
    pub dip: f64,
    /// Number of samples that make the reference.
    pub learning: u32,
    length_mean: f64,
    dip_mean: f64,
    learnt: u32,
}

impl Default for FieldGate {
    /// 2 % and 1.5°, ten times the noise of a MEMS magnetometer at 30 Hz; a second of learning there.
    fn default() -> Self {
        FieldGate {
            length_share: 0.02,
            dip: 1.5f64.to_radians(),
            learning: 31,
            length_mean: 0.0,
            dip_mean: 0.0,
            learnt: 0,
        }
    }
}

impl FieldGate {
    /// Whether a field (body axes, any unit) is that of the reference, seen from an attitude of which only the tilt is used. The first
    /// samples whose tilt is known make the reference; until there is one, every field is.
    pub fn fits(
        &mut self,
        field_b: &Vector3<f64>,
        q_nb: &UnitQuaternion<f64>,
        tilt_known: bool,
    ) -> bool {
        let field_n = q_nb * field_b;
        let (length, dip) = (field_n.norm(), field_n.z.atan2(field_n.xy().norm()));
        if !length.is_finite() {
            return false;
        }
        if self.learnt < self.learning {
            if !tilt_known {
                return true;
            }
            self.learnt += 1;
            self.length_mean += (length - self.length_mean) / f64::from(self.learnt);
            self.dip_mean += (dip - self.dip_mean) / f64::from(self.learnt);
            return true;
        }
        (length - self.length_mean).abs() <= self.length_share * self.length_mean
            && (dip - self.dip_mean).abs() <= self.dip
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Euler;

    #[test]
    fn length_and_dip_are_those_of_the_first_samples() {
        let field_n = Vector3::new(20.0, 0.0, 45.0);
        let mut gate = FieldGate::default();
        let lying = Euler::from_degrees(90.0, 0.0, 0.0).to_quaternion();
        for _ in 0..100 {
            // Of no use: where down is, is not known.
            assert!(gate.fits(&field_n, &lying, false));
        }
        let mut fits = |disturbance: Vector3<f64>, heading: f64| {
            let q = Euler::from_degrees(30.0, -20.0, heading).to_quaternion();
            gate.fits(&(q.inverse() * (field_n + disturbance)), &q, true)
        };
        for i in 0..31 {
            assert!(fits(Vector3::zeros(), f64::from(i) * 10.0));
        }
        assert!(fits(Vector3::zeros(), 200.0));
        assert!(fits(Vector3::new(0.3, -0.3, 0.5), 0.0));
        // Along the field its length, across it in the meridian its dip: five per cent.
        let along = field_n * 0.05;
        assert!(!fits(along, 0.0) && !fits(-along, 0.0));
        assert!(!fits(Vector3::new(45.0, 0.0, -20.0) * 0.05, 0.0));
        // Across it horizontally neither: the heading's own gate has to see that one.
        assert!(fits(Vector3::new(0.0, 2.0, 0.0), 0.0));
        assert!(!fits(Vector3::repeat(f64::NAN), 0.0));
    }
}
