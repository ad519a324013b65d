//! Heading from a magnetometer: the horizontal direction of the field over the first seconds, and the declination.

use super::HeadingSource;
use super::course::Course;
use super::track::Inertial;
use crate::attitude::{exp, wrap_angle};
use crate::sample::MagneticField;
use nalgebra::{UnitQuaternion, Vector3};

/// The first seconds are enough: what an uncalibrated magnetometer is off by does not average out, s.
const WINDOW: f64 = 10.0;
/// Fewest samples.
const FEWEST: usize = 3;
/// The Earth's field, T: from 22 µT (South Atlantic) to 67 µT (near the poles), with what a vehicle adds. What is outside is not a
/// field in tesla, or not the Earth's.
pub const EARTH_FIELD: [f64; 2] = [15e-6, 90e-6];
/// Less than this across gravity is no direction, T.
const LEAST_HORIZONTAL: f64 = 5e-6;

/// How headings of a magnetometer are taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Compass {
    /// Magnetic north from true north, positive to the east, rad.
    pub(super) declination: f64,
    /// Standard deviation of a heading, rad.
    pub(super) sigma: f64,
}

/// The heading at the first of the inertial samples, with the level there, the standard deviation of that and the gyro bias.
pub(super) fn by_magnetometer(
    fields: &[MagneticField],
    imu: &[Inertial],
    (q_level, tilt_sigma): (&UnitQuaternion<f64>, f64),
    gyro_bias: &Vector3<f64>,
    compass: &Compass,
) -> Option<Course> {
    let begin = imu.first()?.time;
    let mut fields = fields.iter().filter(|f| f.time >= begin).peekable();
    let (mut q, mut sum, mut count) = (*q_level, Vector3::zeros(), 0);
    for pair in imu.windows(2) {
        if pair[0].time.since(begin) > WINDOW {
            break;
        }
        while let Some(field) = fields.next_if(|f| f.time < pair[1].time) {
            sum += q * field.field_b;
            count += 1;
        }
        let rate = (pair[0].rate_b + pair[1].rate_b) * 0.5 - gyro_bias;
        q *= exp(&(rate * pair[1].time.since(pair[0].time)));
    }
    let mean: Vector3<f64> = sum / f64::from(count.max(1));
    let horizontal = mean.xy().norm();
    if (count as usize) < FEWEST
        || !(EARTH_FIELD[0]..=EARTH_FIELD[1]).contains(&mean.norm())
        || horizontal < LEAST_HORIZONTAL
    {
        return None;
    }
    Some(Course {
        heading: wrap_angle(compass.declination - mean.y.atan2(mean.x)),
        // Where the field dips, a tilt turns its horizontal part.
        sigma: compass.sigma.hypot(tilt_sigma * mean.z / horizontal),
        at: begin,
        source: HeadingSource::Magnetic,
        reversing: false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Euler;
    use crate::time::Time;
    use std::vec::Vec;

    /// Prague: 49.5 µT, dipping by 66°, declination 5°.
    const NORTH: f64 = 20.1e-6;
    const DOWN: f64 = 45.2e-6;
    const DECLINATION: f64 = 0.087;

    fn field_n() -> Vector3<f64> {
        let (s, c) = DECLINATION.sin_cos();
        Vector3::new(c * NORTH, s * NORTH, DOWN)
    }

    /// A body that turns at a rate from an attitude on, and what is seen of the field.
    fn turning(from: Euler, rate_b: Vector3<f64>) -> (Vec<Inertial>, Vec<MagneticField>) {
        let at = |i: u32| Time::from_seconds(100.0 + 0.01 * f64::from(i));
        let q = |i: u32| from.to_quaternion() * exp(&(rate_b * (0.01 * f64::from(i))));
        let imu = |i| Inertial {
            time: at(i),
            rate_b,
            force_b: Vector3::zeros(),
        };
        let field = |i| MagneticField {
            time: at(i),
            field_b: q(i).inverse() * field_n(),
        };
        let fields = (0..1200).step_by(2).map(field).collect();
        ((0..1200).map(imu).collect(), fields)
    }

    fn heading(from: Euler, rate_b: Vector3<f64>, declination: f64, factor: f64) -> Option<Course> {
        let (imu, mut fields) = turning(from, rate_b);
        for f in &mut fields {
            f.field_b *= factor;
        }
        let level = Euler {
            heading: 0.0,
            ..from
        }
        .to_quaternion();
        let compass = Compass {
            declination,
            sigma: 0.26,
        };
        by_magnetometer(&fields, &imu, (&level, 0.01), &Vector3::zeros(), &compass)
    }

    #[test]
    fn the_heading_at_the_begin_of_a_body_that_tilts_and_turns() {
        let from = Euler::from_degrees(12.0, -20.0, 210.0);
        for rate in [Vector3::zeros(), Vector3::new(0.05, -0.1, 0.4)] {
            let found = heading(from, rate, DECLINATION, 1.0).expect("a field");
            let error = wrap_angle(found.heading - from.heading);
            // Exact but for rounding: the rate is constant.
            assert!(error.abs() < 1e-9, "{error}");
            // tan(66°) times the tilt beside the compass's own.
            assert!((found.sigma - 0.26_f64.hypot(0.0225)).abs() < 1e-4);
            let without = heading(from, rate, 0.0, 1.0).expect("a field");
            let apart = wrap_angle(found.heading - without.heading);
            assert!((apart - DECLINATION).abs() < 1e-9);
        }
    }

    /// Gauss and microtesla in place of tesla, and a normalised field.
    #[test]
    fn what_is_not_the_earths_field_in_tesla_is_refused() {
        let level = Euler::from_degrees(0.0, 0.0, 30.0);
        for factor in [1e4, 1e6, 2e4, 0.1, f64::NAN] {
            assert_eq!(heading(level, Vector3::zeros(), 0.0, factor), None);
        }
    }
}
