//! One source of a start at a time, for whoever studies it alone: [`Startup`](super::Startup) chooses among all of them.

use super::levelling::{from_force, level};
use super::magnetic::{Compass, by_magnetometer};
use super::moving_base::{self, Known, MovingBase};
use super::track::inertial;
use crate::attitude::exp;
use crate::earth::Geodetic;
use crate::imu::ImuNoise;
use crate::sample::{GnssVelocity, MagneticField, Sample};
use nalgebra::{UnitQuaternion, Vector3};
use std::vec::Vec;

/// Attitude with heading zero of a body whose accelerometers feel nothing but the reaction to gravity (\[Groves13\] eq. 5.101).
///
/// `specific_force_b` in any unit; a bias b of an accelerometer tilts it by b/g.
pub fn level_from_force(specific_force_b: &Vector3<f64>) -> UnitQuaternion<f64> {
    from_force(specific_force_b)
}

/// An attitude at the first inertial sample, found by a magnetometer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MagneticStart {
    /// Body to NED, true north by the declination.
    pub q_nb: UnitQuaternion<f64>,
    /// Standard deviation of roll and pitch, rad.
    pub tilt_sigma: f64,
    /// Heading, rad.
    pub heading: f64,
    /// Its standard deviation, rad: that of the compass, and what the tilt turns a field that dips.
    pub heading_sigma: f64,
}

/// Attitude at the first inertial sample by gravity and a magnetic field, over the first ten seconds of it.
///
/// `samples` are inertial ones and fields in the order of time; `declination` is magnetic north from true north, positive to the east,
/// `compass_sigma` what the magnetometer in its vehicle is worth, both in rad. `None` with fewer than three fields, or fields that
/// are not the Earth's in tesla ([`EARTH_FIELD`](super::EARTH_FIELD)).
pub fn magnetic_start(
    samples: &[Sample],
    noise: &ImuNoise,
    gyro_bias: &Vector3<f64>,
    declination: f64,
    compass_sigma: f64,
) -> Option<MagneticStart> {
    let imu = inertial(samples);
    let fields: Vec<MagneticField> = samples
        .iter()
        .filter_map(|sample| match sample {
            Sample::Magnetic(field) => Some(*field),
            _ => None,
        })
        .collect();
    let level = level(&imu, &[], &[], noise)?;
    let compass = Compass {
        declination,
        sigma: compass_sigma,
    };
    let found = by_magnetometer(
        &fields,
        &imu,
        (&level.q_level, level.tilt_sigma),
        gyro_bias,
        &compass,
    )?;
    Some(MagneticStart {
        q_nb: exp(&Vector3::new(0.0, 0.0, found.heading)) * level.q_level,
        tilt_sigma: level.tilt_sigma,
        heading: found.heading,
        heading_sigma: found.sigma,
    })
}

/// What is known beforehand of a unit that is aligned on a moving base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovingBaseOptions {
    /// Gyro bias, rad/s.
    pub gyro_bias: Vector3<f64>,
    /// Its standard deviation, rad/s; `None`: that of the unit's noise.
    pub gyro_bias_sigma: Option<f64>,
    /// Antenna from the IMU, body, m.
    pub lever_arm_b: Vector3<f64>,
    /// Least standard deviation of a velocity that is believed, m/s.
    pub velocity_floor: f64,
}

/// Attitude at the first inertial sample from GNSS velocities, whichever way the vehicle looks: velocity integration formula
/// (\[WuPan13\]), a guess by the q-method (\[Shuster81\]) and a filter about it, whose covariance is the result's.
///
/// `samples` are inertial ones and velocities in the order of time, `place` is where it is to a kilometre. `None` where the velocities do
/// not tell the heading to three degrees, tell several, or contradict the inertial data.
pub fn moving_base_start(
    samples: &[Sample],
    place: &Geodetic,
    noise: &ImuNoise,
    options: &MovingBaseOptions,
) -> Option<MovingBase> {
    let imu = inertial(samples);
    imu.first()?;
    let velocities: Vec<GnssVelocity> = samples
        .iter()
        .filter_map(|sample| match sample {
            Sample::GnssVelocity(velocity) => Some(*velocity),
            _ => None,
        })
        .collect();
    let known = Known {
        gyro_bias: options.gyro_bias,
        gyro_sigma: options.gyro_bias_sigma.unwrap_or(noise.gyro_bias_sigma),
        lever_arm_b: options.lever_arm_b,
        velocity_floor: options.velocity_floor,
    };
    moving_base::moving_base(&imu, &velocities, place, noise, &known)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{Euler, wrap_angle};
    use crate::imu::{ImuGrade, STANDARD_GRAVITY};
    use crate::sample::ImuSample;
    use crate::time::Time;

    #[test]
    fn level_is_that_of_the_force_whatever_its_length() {
        for (roll, pitch) in [(0.0, 0.0), (30.0, -50.0), (-170.0, 80.0)] {
            let attitude = Euler::from_degrees(roll, pitch, 0.0).to_quaternion();
            for length in [1.0, STANDARD_GRAVITY] {
                let force = attitude.inverse() * Vector3::new(0.0, 0.0, -length);
                let apart = level_from_force(&force).angle_to(&attitude);
                assert!(apart < 1e-7, "{roll} {pitch}: {apart}");
            }
        }
    }

    /// A body at rest in a field of 20 µT to the north of a declination and 45 µT down.
    fn at_rest(attitude: &Euler, declination: f64) -> Vec<Sample> {
        let q_bn = attitude.to_quaternion().inverse();
        let (s, c) = declination.sin_cos();
        let field_b = q_bn * Vector3::new(20e-6 * c, 20e-6 * s, 45e-6);
        let mut samples = Vec::new();
        for i in 0..1500 {
            let time = Time::from_seconds(0.01 * f64::from(i));
            samples.push(Sample::Magnetic(MagneticField { time, field_b }));
            samples.push(Sample::Imu(ImuSample {
                time,
                angular_rate_b: Vector3::zeros(),
                specific_force_b: q_bn * Vector3::new(0.0, 0.0, -STANDARD_GRAVITY),
            }));
        }
        samples
    }

    #[test]
    fn a_magnetometer_tells_heading_and_level() {
        let attitude = Euler::from_degrees(8.0, -15.0, 130.0);
        let noise = ImuGrade::Consumer.noise();
        let samples = at_rest(&attitude, 0.1);
        let found = magnetic_start(&samples, &noise, &Vector3::zeros(), 0.1, 0.2).expect("a field");
        assert!(found.q_nb.angle_to(&attitude.to_quaternion()) < 1e-7);
        assert!(found.heading_sigma > 0.2);
        // Without its declination the field tells magnetic north.
        let magnetic = magnetic_start(&samples, &noise, &Vector3::zeros(), 0.0, 0.2);
        let off = wrap_angle(magnetic.expect("a field").heading - attitude.heading);
        assert!((off + 0.1).abs() < 1e-7, "{off}");
        let without: Vec<Sample> = samples.into_iter().filter(Sample::is_inertial).collect();
        assert_eq!(
            magnetic_start(&without, &noise, &Vector3::zeros(), 0.1, 0.2),
            None
        );
    }

    #[test]
    fn a_base_that_rests_tells_no_heading() {
        let samples = at_rest(&Euler::from_degrees(0.0, 0.0, 40.0), 0.0);
        let options = MovingBaseOptions {
            gyro_bias: Vector3::zeros(),
            gyro_bias_sigma: None,
            lever_arm_b: Vector3::zeros(),
            velocity_floor: 0.05,
        };
        let place = Geodetic::from_degrees(50.0, 14.0, 0.0);
        let noise = ImuGrade::Consumer.noise();
        assert_eq!(moving_base_start(&samples, &place, &noise, &options), None);
        assert_eq!(moving_base_start(&[], &place, &noise, &options), None);
    }
}
