//! A start at rest, without GNSS: levelled, with the gyros' bias from what rest shows, and a heading by definition if nobody tells it.

use super::Startup;
use super::gyrocompass::North;
use crate::alignment::levelling::from_force;
use crate::alignment::rest::{Rest, rest_at_begin};
use crate::alignment::tied::{Errors, ROUNDED, Rates, USED_AGAIN, sigmas, untied};
use crate::alignment::track::inertial;
use crate::alignment::{Alignment, HeadingSource};
use crate::earth::{EARTH_RATE, Geodetic, earth_rate_n};
use crate::filter::InitialSigma;
use crate::imu::{ImuErrors, STANDARD_GRAVITY};
use crate::mechanization::NavState;
use crate::time::Time;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Velocity of a body at rest that no piece of [`rest_at_begin`] shows, m/s.
const REST_VELOCITY: f64 = 0.02;

impl Startup {
    /// A start at rest at `place`, once motion has begun or there has been enough of it; with `hurry`, with what there is.
    ///
    /// The position's sigma is zero, since positions count from there. So is the heading's where nobody tells it: headings then
    /// count from it, and the Earth's horizontal rate, whose direction is not known, is left in the gyro bias. Gyros that feel that
    /// rate find north themselves.
    pub(super) fn at_rest(&mut self, place: Geodetic, hurry: bool) -> Option<Alignment> {
        self.sort();
        let imu = inertial(&self.samples);
        let begin = imu.first()?.time;
        let rest = rest_at_begin(&imu, &self.noise).filter(|rest| rest.over || hurry)?;
        let told = self
            .headings
            .first()
            .map(|h| (h.heading, h.sigma, HeadingSource::Antenna));
        let given = self
            .given()
            .map(|(heading, sigma)| (heading, sigma, HeadingSource::Given));
        let (heading, heading_sigma, heading_source) = match given.or(told) {
            Some(told) => told,
            None => {
                let north = self.place_is_told.then(|| self.north(&place, &rest));
                if let Some(north) = north.flatten() {
                    return Some(self.with_north(&north, begin, place, &rest));
                }
                // A mean rate at rest is bias for the most part, and ten seconds of it turn nothing.
                let tilt_sigma =
                    rest.force_sigma.hypot(self.noise.accel_bias_sigma) / STANDARD_GRAVITY;
                let level = (&from_force(&rest.force_b), tilt_sigma);
                self.by_magnetometer(&imu, level, &rest.rate_b)
                    .map_or((0.0, 0.0, HeadingSource::Relative), |course| {
                        (course.heading, course.sigma, HeadingSource::Magnetic)
                    })
            }
        };
        if heading_source == HeadingSource::Antenna {
            self.used_heading = self.headings.first().map(|h| h.time);
        }
        let q_nb =
            UnitQuaternion::from_scaled_axis(Vector3::z() * heading) * from_force(&rest.force_b);
        let feels = self.place_is_told && self.feels_the_earth(&place, &rest).is_some();
        if feels && self.stops_are_used && heading_source != HeadingSource::Relative {
            let north = North::new(q_nb, heading_sigma);
            return Some(Alignment {
                heading_source,
                ..self.with_north(&north, begin, place, &rest)
            });
        }
        let mut earth_rate_n = earth_rate_n(place.latitude);
        if heading_source == HeadingSource::Relative {
            earth_rate_n.x = 0.0;
        }
        // Of a heading that is zero by definition nobody knows anything.
        let turns = match heading_source {
            HeadingSource::Relative => EARTH_RATE,
            _ => EARTH_RATE * untied(heading_sigma),
        };
        let gyro_sigma = rest
            .rate_sigma
            .hypot(0.1 * self.noise.gyro_bias_sigma)
            .hypot(turns);
        let rounding = self.rounding(&imu);
        let errors = Errors {
            turned: Matrix3::identity(),
            level_sigma: (self.again() * rest.force_sigma / STANDARD_GRAVITY)
                .hypot(rounding.amax() * ROUNDED),
            heading_sigma,
            gyro_sigma: Vector3::from_fn(|k, _| {
                gyro_sigma.hypot(rounding[k]).hypot(rest.rate_doubt[k])
            }),
            accel_sigma: self.noise.accel_bias_sigma,
            rates: Rates::Biases,
        };
        let covariance = errors.joint(&q_nb, &place);
        let [attitude, gyro_bias] = sigmas(&covariance);
        Some(Alignment {
            nav: NavState {
                time: begin,
                position: place,
                velocity_n: Vector3::zeros(),
                q_nb,
            },
            imu_errors: ImuErrors {
                gyro_bias: rest.rate_b - q_nb.inverse_transform_vector(&earth_rate_n),
                ..ImuErrors::default()
            },
            sigma: InitialSigma {
                position: Vector3::zeros(),
                velocity: Vector3::repeat(REST_VELOCITY),
                attitude,
                gyro_bias,
                accel_bias: Vector3::repeat(self.noise.accel_bias_sigma),
            },
            covariance,
            standing_s: rest.span,
            heading_source,
            heading_at: begin,
            rates_doubtful_until: rest.doubtful_until,
            reversing: false,
        })
    }

    /// By how much the noise of a level is widened: nothing uses it again where nobody tells the filter that the body stands.
    fn again(&self) -> f64 {
        if self.stops_are_used { USED_AGAIN } else { 1.0 }
    }

    /// With north known and gyros that feel the Earth turn. Their biases are left at zero: what rest shows of them is told to the filter with the heading.
    fn with_north(&self, north: &North, begin: Time, place: Geodetic, rest: &Rest) -> Alignment {
        let covariance = self.joint_of_north(north, &place);
        let [attitude, gyro_bias] = sigmas(&covariance);
        Alignment {
            nav: NavState {
                time: begin,
                position: place,
                velocity_n: Vector3::zeros(),
                q_nb: north.q_nb,
            },
            imu_errors: ImuErrors::default(),
            sigma: InitialSigma {
                position: Vector3::zeros(),
                velocity: Vector3::repeat(REST_VELOCITY),
                attitude,
                gyro_bias,
                accel_bias: Vector3::repeat(self.noise.accel_bias_sigma),
            },
            covariance,
            standing_s: rest.span,
            heading_source: HeadingSource::Gyrocompass,
            heading_at: begin,
            rates_doubtful_until: None,
            reversing: false,
        }
    }
}
