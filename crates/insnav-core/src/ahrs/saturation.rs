//! Where a record's gyros saturate.

use crate::sample::ImuSample;

/// Share of the greatest rate from which a sample counts as at the limit.
const TOP: f64 = 0.97;
/// Share from which it counts as near.
const NEAR: f64 = 0.9;
/// Fewest samples at the limit.
const FEWEST: usize = 20;
/// A smooth peak has 1.2 times as many samples in its last 3 % as in the 7 % below; a limit has many more.
const CLIPPED: usize = 4;

/// The range of the gyros as the record shows it, rad/s: the rate at which an axis stays again and again. `None` where none does.
///
/// A body that turns at a steady rate looks the same, and no record can tell: say so to whoever can.
pub fn gyro_range(samples: &[ImuSample]) -> Option<f64> {
    let axis_range = |axis: usize| {
        let rates = || samples.iter().map(|s| s.angular_rate_b[axis].abs());
        let greatest = rates().fold(0.0, f64::max);
        let at_least = |share: f64| rates().filter(|r| *r >= share * greatest).count();
        let (top, near) = (at_least(TOP), at_least(NEAR));
        // At rest everything is near nothing.
        let clipped = greatest > 1.0 && top >= FEWEST && top >= CLIPPED * (near - top);
        clipped.then_some(greatest)
    };
    (0..3).filter_map(axis_range).reduce(f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::Time;
    use nalgebra::Vector3;
    use std::vec::Vec;

    fn swings(limit: f64) -> Vec<ImuSample> {
        (0..3000)
            .map(|i| {
                let rate = 8.0 * (0.02 * f64::from(i)).sin() * (0.0013 * f64::from(i)).cos();
                ImuSample {
                    time: Time::from_seconds(0.01 * f64::from(i)),
                    angular_rate_b: Vector3::new(rate.clamp(-limit, limit), 0.1, 0.0),
                    specific_force_b: Vector3::new(0.0, 0.0, -9.81),
                }
            })
            .collect()
    }

    #[test]
    fn a_limit_is_found_and_a_peak_is_none() {
        assert!((gyro_range(&swings(5.0)).unwrap() - 5.0).abs() < 1e-12);
        assert_eq!(gyro_range(&swings(100.0)), None);
        assert_eq!(gyro_range(&[]), None);
    }
}
