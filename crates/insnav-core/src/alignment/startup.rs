//! The start of a run: keeps samples until attitude, position and heading are known at the first of them.

use super::course::{self, Course, Tilt};
use super::first_fix::{FirstFix, first_fix};
use super::levelling::{Level, from_force, level, level_with_velocity};
use super::rest::rest_at_begin;
use super::track::{Inertial, Track, inertial};
use super::{Alignment, HeadingSource};
use crate::attitude::Euler;
use crate::config::{AlignmentConfig, Config, VehicleKind};
use crate::earth::{EARTH_RATE, Geodetic, earth_rate_n};
use crate::error::{Error, Result};
use crate::filter::InitialSigma;
use crate::imu::{ImuErrors, ImuNoise, STANDARD_GRAVITY};
use crate::mechanization::NavState;
use crate::sample::{GnssPosition, GnssVelocity, Sample};
use crate::stationary::GyroSteps;
use crate::time::Time;
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::vec::Vec;

/// After so long without a course the run begins with an unknown heading, s.
const PATIENCE: f64 = 3600.0;
/// Inertial data needed for a start whose heading is given, s.
const LEAST_DATA: f64 = 10.0;
/// Standard deviation of a given heading without one of its own, rad (5°).
const GIVEN_SIGMA: f64 = 0.087;
/// A uniform distribution over the circle: π/√3.
const UNKNOWN_SIGMA: f64 = 1.813_8;
/// Velocity of a body at rest that no piece of [`rest_at_begin`] shows, m/s.
const REST_VELOCITY: f64 = 0.02;
/// Without GNSS, rest is looked at anew after so long, s.
const REST_AGAIN: f64 = 1.0;
/// The first fix is used again as a measurement: its sigma as a prior is widened so that this counts for 1 %.
const PRIOR_WIDENING: f64 = 10.0;

/// Why a run without GNSS cannot begin.
const NO_REST: &str = "the inertial data do not begin with rest: a second without any motion, or four of a vehicle that stands with its engine on";

/// Samples since the first, and the search for a start.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Startup {
    settings: AlignmentConfig,
    vehicle: VehicleKind,
    noise: ImuNoise,
    lever_arm_b: Vector3<f64>,
    /// Where the run begins, when no GNSS is to tell.
    place: Option<Geodetic>,
    samples: Vec<Sample>,
    first_inertial: Option<Time>,
    positions: Vec<GnssPosition>,
    velocities: Vec<GnssVelocity>,
    /// How many fixes (velocities if there are any, else positions) have been judged for a course, or seconds for rest.
    judged: usize,
}

/// What gives the course.
enum Fixes<'a> {
    Velocities(&'a [GnssVelocity]),
    Positions(&'a [GnssPosition]),
}

impl Fixes<'_> {
    fn time(&self, i: usize) -> Option<Time> {
        match self {
            Fixes::Velocities(all) => all.get(i).map(|v| v.time),
            Fixes::Positions(all) => all.get(i).map(|p| p.time),
        }
    }
}

impl Startup {
    /// With no sample yet.
    pub fn new(config: &Config, noise: ImuNoise) -> Self {
        Startup {
            settings: config.alignment,
            vehicle: config.vehicle.kind,
            noise,
            lever_arm_b: Vector3::from(config.gnss.lever_arm_b_m.unwrap_or_default()),
            place: config.place_without_gnss().map(|(place, _)| place),
            samples: Vec::new(),
            first_inertial: None,
            positions: Vec::new(),
            velocities: Vec::new(),
            judged: 0,
        }
    }

    /// Keep a sample.
    pub fn push(&mut self, sample: Sample) {
        self.samples.push(sample);
        match sample {
            Sample::GnssPosition(p) => self.positions.push(p),
            Sample::GnssVelocity(v) => {
                if self.velocities.is_empty() {
                    // From now on it is velocities that are judged, from the first one.
                    self.judged = 0;
                }
                self.velocities.push(v);
            }
            Sample::Imu(_) | Sample::ImuIncrement(_) => {
                let first = self.first_inertial.get_or_insert(sample.time());
                *first = sample.time().min(*first);
            }
            Sample::Heading(_) | Sample::Standstill(_) | Sample::Speed(_) => {}
        }
    }

    /// Everything kept, in the order of time.
    pub fn into_samples(mut self) -> Vec<Sample> {
        self.sort();
        self.samples
    }

    fn sort(&mut self) {
        self.samples.sort_by_key(|s| (s.time(), s.is_inertial()));
        self.positions.sort_by_key(|p| p.time);
        self.velocities.sort_by_key(|v| v.time);
    }

    /// A start, if the newest sample has made one possible. Cheap unless it has a chance.
    pub fn try_align(&mut self) -> Option<Alignment> {
        let newest = self.samples.last().filter(|s| s.is_inertial())?.time();
        let waited = newest.since(self.first_inertial?);
        if let Some(place) = self.place {
            if waited < REST_AGAIN * (self.judged + 1) as f64 {
                return None;
            }
            self.judged += 1;
            return self.at_rest(place, false);
        }
        self.positions.first()?;
        if self.settings.heading_deg.is_some() {
            return if waited >= LEAST_DATA {
                self.align(None)
            } else {
                None
            };
        }
        if waited > PATIENCE {
            return self.align(None);
        }
        if self.vehicle != VehicleKind::Car {
            return None;
        }
        // A fix is judged once the gyros have come past it, since it is they who carry its course back to the start.
        if self.fixes().time(self.judged)? > newest {
            return None;
        }
        self.judged += 1;
        let count = self.judged;
        let promising = match self.fixes() {
            Fixes::Velocities(all) => course::fast_enough(&all[count - 1]),
            Fixes::Positions(all) => course::far_enough(&all[..count]).is_some(),
        };
        if promising {
            self.align(Some(count))
                .filter(|a| a.heading_source != HeadingSource::Unknown)
        } else {
            None
        }
    }

    /// Receivers that give velocities are judged by them; chords are for those that give none.
    fn fixes(&self) -> Fixes<'_> {
        if self.velocities.is_empty() {
            Fixes::Positions(&self.positions)
        } else {
            Fixes::Velocities(&self.velocities)
        }
    }

    /// A start with whatever is there, at the end of a log.
    ///
    /// # Errors
    /// `NotStarted` without inertial samples; without a position; or, when GNSS is not used, without a second of rest.
    pub fn align_with_what_there_is(&mut self) -> Result<Alignment> {
        if self.first_inertial.is_none() {
            return Err(Error::NotStarted {
                missing: "no inertial sample",
            });
        }
        if let Some(place) = self.place {
            return self
                .at_rest(place, true)
                .ok_or(Error::NotStarted { missing: NO_REST });
        }
        if self.positions.is_empty() {
            return Err(Error::NotStarted {
                missing: "no valid GNSS position",
            });
        }
        self.align(None).ok_or(Error::NotStarted {
            missing: "fewer than two inertial samples",
        })
    }

    /// A start at rest at `place`, once motion has begun or there has been enough of it; with `hurry`, with what there is.
    ///
    /// The position's sigma is zero, since positions count from there. So is the heading's where nobody tells it: headings then
    /// count from it, and the Earth's horizontal rate, whose direction is not known, is left in the gyro bias.
    fn at_rest(&mut self, place: Geodetic, hurry: bool) -> Option<Alignment> {
        self.sort();
        let imu = inertial(&self.samples);
        let begin = imu.first()?.time;
        let rest = rest_at_begin(&imu, &self.noise).filter(|rest| rest.over || hurry)?;
        let told = self.samples.iter().find_map(|s| match s {
            Sample::Heading(h) => Some((h.heading, h.sigma)),
            _ => None,
        });
        let given = self.settings.heading_deg.map(|heading| {
            let sigma = self.settings.heading_sigma_deg;
            (
                heading.to_radians(),
                sigma.map_or(GIVEN_SIGMA, f64::to_radians),
            )
        });
        let (heading, heading_sigma, heading_source) = match given.or(told) {
            Some((heading, sigma)) => (heading, sigma, HeadingSource::Given),
            None => (0.0, 0.0, HeadingSource::Relative),
        };
        let q_nb =
            UnitQuaternion::from_scaled_axis(Vector3::z() * heading) * from_force(&rest.force_b);
        let mut earth_rate_n = earth_rate_n(place.latitude);
        let mut direction = heading_sigma.min(1.0);
        if heading_source == HeadingSource::Relative {
            earth_rate_n.x = 0.0;
            direction = 1.0;
        }
        let tilt_sigma = rest.force_sigma.hypot(self.noise.accel_bias_sigma) / STANDARD_GRAVITY;
        let gyro_sigma = rest
            .rate_sigma
            .hypot(0.1 * self.noise.gyro_bias_sigma)
            .hypot(EARTH_RATE * direction);
        let rounding = self.rounding(&imu);
        let gyro_sigma =
            Vector3::from_fn(|k, _| gyro_sigma.hypot(rounding[k]).hypot(rest.rate_doubt[k]));
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
                attitude: Vector3::new(tilt_sigma, tilt_sigma, heading_sigma),
                gyro_bias: gyro_sigma,
                accel_bias: Vector3::repeat(self.noise.accel_bias_sigma),
            },
            standing_s: rest.span,
            heading_source,
            heading_at: begin,
            rates_doubtful_until: rest.doubtful_until,
            reversing: false,
        })
    }

    fn align(&mut self, fixes: Option<usize>) -> Option<Alignment> {
        self.sort();
        let imu = inertial(&self.samples);
        let begin = imu.first()?.time;
        let after = self.positions.partition_point(|p| p.time < begin);
        let first = after.min(self.positions.len().checked_sub(1)?);
        let FirstFix { fix, scatter } = first_fix(&self.positions, first, &self.velocities)?;
        let level = level(&imu, &self.positions, &self.velocities, &self.noise)?;
        let bias = level
            .standing_rate
            .filter(|(rate, _)| rate.norm() < self.believable_rate());
        // A mean rate at rest has the Earth's rate in it; the track takes out its vertical part itself.
        let earth_down = Vector3::z() * (EARTH_RATE * fix.position.latitude.sin());
        let rough_bias = bias.map_or_else(Vector3::zeros, |(rate, _)| {
            rate + level.q_level.inverse_transform_vector(&earth_down)
        });
        let track = Track::new(&imu, &level, &rough_bias, fix.position.latitude);
        let rounding = match bias {
            Some(_) => self.rounding(&imu),
            None => Vector3::zeros(),
        };
        // What the gyros add while they carry the heading back.
        let rate_sigma = bias.map_or(self.noise.gyro_bias_sigma, |(_, sigma)| {
            (sigma + self.noise.gyro_bias_sigma * 0.1).hypot(rounding.amax())
        });
        let tilt = Tilt {
            begin,
            sigma: level.tilt_sigma,
            rate_sigma,
        };
        let course = self.heading(fixes, &track, &tilt);
        let carried = rate_sigma * course.at.since(begin).abs();
        let heading_sigma = course.sigma.hypot(carried).min(UNKNOWN_SIGMA);
        let level = if level.standing_rate.is_none() {
            let heading = (course.heading, heading_sigma);
            level_with_velocity(&imu, &self.velocities, heading, &level, &self.noise)
                .unwrap_or(level)
        } else {
            level
        };
        let mut alignment = self.assemble(&imu, &fix, &level, &course, heading_sigma, bias);
        let position = &mut alignment.sigma.position;
        *position = position.sup(&(scatter * 2.0));
        let gyro_bias = &mut alignment.sigma.gyro_bias;
        *gyro_bias = gyro_bias.zip_map(&rounding, f64::hypot);
        Some(alignment)
    }

    /// What the steps of the gyros' values do to their mean at rest, standard deviations, rad/s.
    fn rounding(&self, imu: &[Inertial]) -> Vector3<f64> {
        let mut steps = GyroSteps::new(self.noise.gyro_bias_sigma);
        let mut last = None;
        for s in imu {
            steps.push(last.map_or(0.0, |last| s.time.since(last)), &s.rate_b);
            last = Some(s.time);
        }
        steps.rounding().sigma
    }

    /// A standing rate above this is no bias but a turn, rad/s.
    fn believable_rate(&self) -> f64 {
        4.0 * self.noise.gyro_bias_sigma + EARTH_RATE
    }

    fn heading(&self, fixes: Option<usize>, track: &Track, tilt: &Tilt) -> Course {
        let other = |heading, sigma, source| Course {
            heading,
            sigma,
            at: tilt.begin,
            source,
            reversing: false,
        };
        if let Some(heading) = self.settings.heading_deg {
            let sigma = self
                .settings
                .heading_sigma_deg
                .map_or(GIVEN_SIGMA, f64::to_radians);
            return other(heading.to_radians(), sigma, HeadingSource::Given);
        }
        let found = fixes.and_then(|count| match self.fixes() {
            Fixes::Velocities(all) => course::by_velocity(&all[..count], track, tilt),
            Fixes::Positions(all) => course::by_position(&all[..count], track),
        });
        found.unwrap_or_else(|| other(0.0, UNKNOWN_SIGMA, HeadingSource::Unknown))
    }

    fn assemble(
        &self,
        imu: &[Inertial],
        fix: &GnssPosition,
        level: &Level,
        course: &Course,
        heading_sigma: f64,
        bias: Option<(Vector3<f64>, f64)>,
    ) -> Alignment {
        let begin = imu[0].time;
        let q_nb = UnitQuaternion::from_scaled_axis(Vector3::z() * course.heading) * level.q_level;
        let earth_rate_b = q_nb.inverse_transform_vector(&earth_rate_n(fix.position.latitude));
        let (gyro_bias, gyro_sigma) = match bias {
            // The Earth rate is known up to the heading's error; the bias moves on while the filter takes over.
            Some((rate, sigma)) => (
                rate - earth_rate_b,
                sigma
                    .hypot(0.1 * self.noise.gyro_bias_sigma)
                    .hypot(EARTH_RATE * heading_sigma.min(1.0)),
            ),
            None => (Vector3::zeros(), self.noise.gyro_bias_sigma),
        };
        let (velocity_n, velocity_sigma) = self.velocity_at(begin, level.standing_s > 0.0);
        let since = begin.since(fix.time);
        let lever_n = q_nb * self.lever_arm_b;
        let fix_sigma = fix
            .covariance_n
            .map_or(Vector3::repeat(3.0), |c| c.diagonal().map(f64::sqrt));
        let nav = NavState {
            time: begin,
            position: fix.position.offset(&(velocity_n * since - lever_n)),
            velocity_n,
            q_nb,
        };
        let spread = velocity_sigma * since.abs() + 0.5 * since * since;
        Alignment {
            nav,
            imu_errors: ImuErrors {
                gyro_bias,
                ..ImuErrors::default()
            },
            sigma: InitialSigma {
                position: fix_sigma.map(|s| (PRIOR_WIDENING * s).hypot(spread).max(1.0)),
                velocity: Vector3::repeat(velocity_sigma),
                attitude: Vector3::new(level.tilt_sigma, level.tilt_sigma, heading_sigma),
                gyro_bias: Vector3::repeat(gyro_sigma),
                accel_bias: Vector3::repeat(self.noise.accel_bias_sigma),
            },
            standing_s: level.standing_s,
            heading_source: course.source,
            heading_at: course.at,
            rates_doubtful_until: None,
            reversing: course.reversing,
        }
    }

    /// Velocity at the begin, NED, and its standard deviation as a prior.
    fn velocity_at(&self, begin: Time, standing: bool) -> (Vector3<f64>, f64) {
        if standing {
            return (Vector3::zeros(), 0.3);
        }
        let nearest = self.velocities.iter().min_by(|a, b| {
            a.time
                .since(begin)
                .abs()
                .total_cmp(&b.time.since(begin).abs())
        });
        if let Some(v) = nearest.filter(|v| v.time.since(begin).abs() < 2.0) {
            let down = if v.velocity_n.z.is_nan() {
                0.0
            } else {
                v.velocity_n.z
            };
            return (
                Vector3::new(v.velocity_n.x, v.velocity_n.y, down),
                1.0 + v.time.since(begin).abs(),
            );
        }
        // Positions only: the mean velocity over the first seconds.
        let mut early = self
            .positions
            .iter()
            .filter(|p| (-1.0..4.0).contains(&p.time.since(begin)));
        if let (Some(a), Some(b)) = (early.next(), early.next_back())
            && b.time.since(a.time) >= 1.0
        {
            return (
                a.position.offset_to(&b.position) / b.time.since(a.time),
                5.0,
            );
        }
        (Vector3::zeros(), 20.0)
    }
}

impl Alignment {
    /// Roll, pitch and heading at the first sample.
    pub fn euler(&self) -> Euler {
        Euler::from_quaternion(&self.nav.q_nb)
    }
}
