//! The constant rotation between two sets of axes.

use crate::attitude::{exp, log};
use nalgebra::{UnitQuaternion, Vector3};

/// Mean of rotations: the one around which the rotation vectors of all add up to zero. `None` when there are none.
///
/// Unique while no two differ by half a turn.
pub fn mean_rotation(rotations: &[UnitQuaternion<f64>]) -> Option<UnitQuaternion<f64>> {
    let mut mean = *rotations.first()?;
    for _ in 0..20 {
        let sum: Vector3<f64> = rotations.iter().map(|q| log(&(mean.inverse() * q))).sum();
        let step = sum / rotations.len() as f64;
        mean *= exp(&step);
        if step.norm() < 1e-14 {
            break;
        }
    }
    Some(mean)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn symmetric_deviations_leave_the_middle() {
        let middle = exp(&Vector3::new(0.3, -1.0, 2.0));
        let d = [
            Vector3::new(0.1, 0.0, 0.0),
            Vector3::new(0.0, 0.2, 0.05),
            Vector3::new(0.3, -0.1, 0.2),
        ];
        let all: Vec<_> = d
            .iter()
            .flat_map(|d| [middle * exp(d), middle * exp(&-d)])
            .collect();
        assert!(mean_rotation(&all).unwrap().angle_to(&middle) < 1e-12);
        assert!(mean_rotation(&[]).is_none());
    }
}
