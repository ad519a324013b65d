//! North at the start, where the gyros feel the Earth turn.

use super::heading::Ask;
use super::{REST_AGAIN, Startup};
use crate::alignment::rest::{Rest, rest_at_begin};
use crate::alignment::stops::{Record, coarse_attitude, rate_limit};
use crate::alignment::tied::{Errors, Joint, Rates, sigmas};
use crate::alignment::track::inertial;
use crate::alignment::{Alignment, HeadingSource};
use crate::earth::{Geodetic, LocalEarth};
use crate::imu::ImuErrors;
use crate::mechanization::IncrementBuilder;
use crate::sample::Sample;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Less rest does not show the Earth's rate through people who move about, s.
const LEAST_REST: f64 = 30.0;
/// North is looked for where the gyros' biases and what rest shows of the rates leave less than this, rad (5°).
const LARGEST_SIGMA: f64 = 0.087;
/// Standard deviations of the coarse start, rad, beside what the biases make of it: tilt (0.1°) and heading (10°). Rocking moves it, and
/// the same rest tells the filter of attitude and biases together, in a linear range, when it has begun; a prior that claimed what
/// rest says already would count that twice. Where the filter is not told of stops, the heading's is what rest shows.
const TILT_SIGMA: f64 = 1.7e-3;
const HEADING_SIGMA: f64 = 0.17;

/// The q-method over stretches of half the rest is noisier than the best there is: over 24 starts of 45 s its errors were 1.64 times
/// what the limit alone would state.
const OVER_THE_LIMIT: f64 = 1.7;

/// Attitude at the first sample, and the standard deviation of its heading beside what `rates` says.
pub(super) struct North {
    pub(super) q_nb: UnitQuaternion<f64>,
    heading_sigma: f64,
    rates: Rates,
}

impl North {
    /// With a heading known to `heading_sigma`, rad.
    pub(super) fn new(q_nb: UnitQuaternion<f64>, heading_sigma: f64) -> Self {
        North {
            q_nb,
            heading_sigma,
            rates: Rates::Unused,
        }
    }
}

impl Startup {
    /// Whether the gyros feel the Earth turn: the sigma of the heading that this rest and the unit's biases leave, rad.
    pub(super) fn feels_the_earth(&self, place: &Geodetic, rest: &Rest) -> Option<f64> {
        if rest.span < LEAST_REST || rest.doubtful_until.is_some() {
            return None;
        }
        let earth = LocalEarth::at(place);
        let horizontal = earth.earth_rate_n().x;
        let tan = earth.sin_latitude / earth.cos_latitude;
        let sigma = (self.noise.gyro_bias_sigma / horizontal)
            .hypot(self.noise_of_north(&earth, rest))
            .hypot(tan * self.noise.accel_bias_sigma / earth.gravity());
        // Near a pole nothing is left of the horizontal rate.
        (horizontal > 0.0 && sigma < LARGEST_SIGMA).then_some(sigma)
    }

    /// What white noise leaves of the heading, rad.
    fn noise_of_north(&self, earth: &LocalEarth, rest: &Rest) -> f64 {
        let rate = rate_limit(&self.noise, earth.gravity(), rest.span);
        OVER_THE_LIMIT * rate / earth.earth_rate_n().x
    }

    /// The covariance of a start by the gyros. Its biases are those of the class: they have been left at zero.
    pub(super) fn joint_of_north(&self, north: &North, place: &Geodetic) -> Joint {
        let errors = Errors {
            turned: Matrix3::identity(),
            level_sigma: TILT_SIGMA,
            heading_sigma: north.heading_sigma,
            gyro_sigma: Vector3::repeat(self.noise.gyro_bias_sigma),
            accel_sigma: self.noise.accel_bias_sigma,
            rates: north.rates,
        };
        errors.joint(&north.q_nb, place)
    }

    /// Coarse alignment in the inertial frame from the rest that the data begin with; `None` where the unit or the rest is not
    /// good enough. Samples are sorted.
    pub(super) fn north(&self, place: &Geodetic, rest: &Rest) -> Option<North> {
        self.feels_the_earth(place, rest)?;
        let mut builder = IncrementBuilder::default();
        let begin = self.samples.iter().find(|s| s.is_inertial())?.time();
        let increments = self
            .samples
            .iter()
            .take_while(|s| s.time().since(begin) <= rest.span)
            .filter_map(|sample| match sample {
                Sample::Imu(s) => builder.push(s),
                Sample::ImuIncrement(s) => builder.push_increment(s),
                _ => None,
            });
        let q_nb = coarse_attitude(&Record::new(increments), place)?;
        Some(if self.stops_are_used {
            North::new(q_nb, HEADING_SIGMA)
        } else {
            North {
                q_nb,
                heading_sigma: self.noise_of_north(&LocalEarth::at(place), rest),
                rates: Rates::North,
            }
        })
    }

    /// A start with GNSS by the gyros, when the rest that the data begin with is over or has lasted long enough. That is asked of
    /// every second, and given up when the data do not begin with rest.
    pub(super) fn by_gyros(&mut self, waited: f64) -> Option<Alignment> {
        if self.north_is_decided || waited < LEAST_REST + REST_AGAIN * self.judged_rest as f64 {
            return None;
        }
        self.judged_rest += 1;
        self.sort();
        let rest = rest_at_begin(&inertial(&self.samples), &self.noise);
        if rest.as_ref().is_some_and(|rest| !rest.over) {
            return None;
        }
        self.north_is_decided = true;
        let place = self.positions.first()?.position;
        let north = self.north(&place, &rest?)?;
        let mut start = self.align(Ask::Sure)?;
        if start.heading_source != HeadingSource::Unknown {
            return Some(start);
        }
        let moved = start.nav.q_nb * self.lever_arm_b - north.q_nb * self.lever_arm_b;
        start.nav.position = start.nav.position.offset(&moved);
        start.nav.q_nb = north.q_nb;
        // What rest shows of the biases is told to the filter with the heading.
        start.imu_errors = ImuErrors::default();
        start.covariance = self.joint_of_north(&north, &place);
        [start.sigma.attitude, start.sigma.gyro_bias] = sigmas(&start.covariance);
        start.heading_source = HeadingSource::Gyrocompass;
        start.heading_at = start.nav.time;
        Some(start)
    }
}
