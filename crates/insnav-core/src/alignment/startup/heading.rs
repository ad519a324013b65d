//! Where the heading of a start with GNSS comes from, in the order in which the sources are trusted.

use super::{Fixes, GIVEN_SIGMA, Startup, UNKNOWN_SIGMA};
use crate::alignment::HeadingSource;
use crate::alignment::antenna::by_antenna;
use crate::alignment::course::{self, Course, Tilt};
use crate::alignment::levelling::Level;
use crate::alignment::magnetic::{Compass, by_magnetometer};
use crate::alignment::moving_base::{Known, MovingBase, moving_base};
use crate::alignment::track::{Inertial, Track};
use crate::attitude::Euler;
use crate::earth::{EARTH_RATE, Geodetic};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// The velocities that told the attitude are used again as measurements: its sigma as a prior is widened so that this counts for
/// 4 %. More would make a prior of tens of degrees of a heading that is right to one.
pub(super) const BASE_WIDENING: f64 = 5.0;

/// Standard deviation of the heading of a magnetometer that nobody has calibrated in its vehicle, rad (15°).
const COMPASS_SIGMA: f64 = 0.262;

/// Which sources may make a start now, beside those that always may: what is given, and antennas.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ask {
    /// No other.
    Sure,
    /// The course of so many fixes.
    Course(usize),
    /// Velocities, whichever way the vehicle looks.
    MovingBase,
    /// There is nothing to wait for any more.
    Anything,
}

impl Startup {
    /// Given, else by antennas, else by the course: in this order, since a user knows more than the log, and two antennas more
    /// than a course, which supposes that the vehicle moves where it looks.
    pub(super) fn heading(&self, ask: Ask, track: &Track, tilt: &Tilt) -> Option<Course> {
        if let Some((heading, sigma)) = self.given() {
            return Some(at_begin(heading, sigma, HeadingSource::Given, tilt));
        }
        let by_course = || match (ask, self.fixes()) {
            (Ask::Course(count), Fixes::Velocities(all)) => {
                course::by_velocity(&all[..count], track, tilt)
            }
            (Ask::Course(count), Fixes::Positions(all)) => {
                course::by_position(&all[..count], track)
            }
            _ => None,
        };
        by_antenna(&self.headings, track, tilt).or_else(by_course)
    }

    /// Attitude by velocities, when nothing better tells the heading.
    pub(super) fn by_moving_base(
        &self,
        ask: Ask,
        imu: &[Inertial],
        place: &Geodetic,
        rough_bias: &Vector3<f64>,
        rate_sigma: f64,
    ) -> Option<MovingBase> {
        if !matches!(ask, Ask::MovingBase | Ask::Anything) {
            return None;
        }
        // A mean rate at rest has the Earth's horizontal rate in it, of which only the size is known.
        let sigma = rate_sigma.hypot(EARTH_RATE * place.latitude.cos());
        let (gyro_bias, gyro_sigma) = if sigma < self.noise.gyro_bias_sigma {
            (*rough_bias, sigma)
        } else {
            (Vector3::zeros(), self.noise.gyro_bias_sigma)
        };
        let known = Known {
            gyro_bias,
            gyro_sigma,
            lever_arm_b: self.lever_arm_b,
            velocity_floor: self.velocity_floor,
        };
        moving_base(imu, &self.velocities, place, &self.noise, &known)
    }

    /// The heading by a magnetometer, when nothing better comes any more.
    pub(super) fn by_magnetometer(
        &self,
        imu: &[Inertial],
        level: (&UnitQuaternion<f64>, f64),
        gyro_bias: &Vector3<f64>,
    ) -> Option<Course> {
        let sigma = self.settings.magnetic_sigma_deg;
        let compass = Compass {
            declination: self
                .settings
                .declination_deg
                .unwrap_or_default()
                .to_radians(),
            sigma: sigma.map_or(COMPASS_SIGMA, f64::to_radians),
        };
        by_magnetometer(&self.fields, imu, level, gyro_bias, &compass)
    }

    /// The heading of the settings and its standard deviation, rad.
    pub(super) fn given(&self) -> Option<(f64, f64)> {
        let sigma = self.settings.heading_sigma_deg;
        let sigma = sigma.map_or(GIVEN_SIGMA, f64::to_radians);
        self.settings
            .heading_deg
            .map(|heading| (heading.to_radians(), sigma))
    }
}

/// The heading of a moving base, widened.
pub(super) fn of_base(base: &MovingBase) -> Course {
    Course {
        heading: Euler::from_quaternion(&base.q_nb).heading,
        sigma: BASE_WIDENING * base.heading_sigma,
        at: base.at,
        source: HeadingSource::MovingBase,
        reversing: false,
    }
}

/// The level of a moving base, widened, but not beyond that of the levelling that it replaces.
pub(super) fn level_of_base(base: &MovingBase, level: &Level) -> Level {
    let heading = Euler::from_quaternion(&base.q_nb).heading;
    let own = base.covariance_n.diagonal().xy().max().sqrt();
    let tilt_sigma = (BASE_WIDENING * own).min(level.tilt_sigma).max(own);
    Level {
        q_level: UnitQuaternion::from_scaled_axis(Vector3::z() * -heading) * base.q_nb,
        tilt_sigma,
        own_sigma: tilt_sigma,
        // Widened as a whole: what of it is a bias has no weight left.
        turned: Matrix3::zeros(),
        ..*level
    }
}

/// None.
pub(super) fn unknown(tilt: &Tilt) -> Course {
    at_begin(0.0, UNKNOWN_SIGMA, HeadingSource::Unknown, tilt)
}

fn at_begin(heading: f64, sigma: f64, source: HeadingSource, tilt: &Tilt) -> Course {
    Course {
        heading,
        sigma,
        at: tilt.begin,
        source,
        reversing: false,
    }
}
