//! A start with GNSS, put together: level, heading carried back to the first sample, position and velocity there.

use super::heading::{Ask, BASE_WIDENING, level_of_base, of_base, unknown};
use super::{Startup, UNKNOWN_SIGMA};
use crate::alignment::course::{Course, Tilt};
use crate::alignment::first_fix::{FirstFix, first_fix};
use crate::alignment::levelling::{Level, level, level_with_velocity};
use crate::alignment::tied::{Errors, ROUNDED, Rates, USED_AGAIN, sigmas, untied};
use crate::alignment::track::{Inertial, Track, inertial};
use crate::alignment::{Alignment, HeadingSource};
use crate::earth::{EARTH_RATE, earth_rate_n};
use crate::filter::InitialSigma;
use crate::imu::ImuErrors;
use crate::mechanization::NavState;
use crate::sample::GnssPosition;
use crate::stationary::GyroSteps;
use crate::time::Time;
use nalgebra::Vector3;

/// The first fix is used again as a measurement: its sigma as a prior is widened so that this counts for 1 %.
const PRIOR_WIDENING: f64 = 10.0;

/// What is known of the gyros at a start.
struct Gyros {
    bias: Vector3<f64>,
    /// Beside what the attitude makes of it.
    sigma: Vector3<f64>,
    rates: Rates,
    /// What steps of their values do to the mean, rad/s.
    rounding: f64,
}

impl Startup {
    pub(super) fn align(&mut self, ask: Ask) -> Option<Alignment> {
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
        let found = self.heading(ask, &track, &tilt);
        let base = match found {
            Some(_) => None,
            None => self.by_moving_base(ask, &imu, &fix.position, &rough_bias, rate_sigma),
        };
        let course = found
            .or(base.as_ref().map(of_base))
            .or_else(|| {
                let level = (&level.q_level, level.tilt_sigma);
                (ask == Ask::Anything)
                    .then(|| self.by_magnetometer(&imu, level, &rough_bias))
                    .flatten()
            })
            .unwrap_or_else(|| unknown(&tilt));
        self.used_heading = (course.source == HeadingSource::Antenna).then_some(course.at);
        let carried = match base {
            // It is the attitude at the first sample already.
            Some(_) => 0.0,
            None => rate_sigma * course.at.since(begin).abs(),
        };
        let heading_sigma = course.sigma.hypot(carried).min(UNKNOWN_SIGMA);
        let level = if let Some(base) = base.filter(|_| level.standing_rate.is_none()) {
            level_of_base(&base, &level)
        } else if level.standing_rate.is_none() {
            let heading = (course.heading, heading_sigma);
            level_with_velocity(&imu, &self.velocities, heading, &level, &self.noise)
                .unwrap_or(level)
        } else {
            level
        };
        let q_nb = level.facing(course.heading);
        let gyros = match (bias, base) {
            (Some((rate, sigma)), _) => {
                let earth_rate_b =
                    q_nb.inverse_transform_vector(&earth_rate_n(fix.position.latitude));
                // The bias moves on while the filter takes over.
                let beside = sigma
                    .hypot(0.1 * self.noise.gyro_bias_sigma)
                    .hypot(EARTH_RATE * untied(heading_sigma));
                Gyros {
                    bias: rate - earth_rate_b,
                    sigma: rounding.map(|r| r.hypot(beside)),
                    rates: Rates::Biases,
                    rounding: rounding.amax(),
                }
            }
            (None, Some(base)) => Gyros {
                bias: base.gyro_bias,
                sigma: (base.gyro_bias_sigma * BASE_WIDENING)
                    .inf(&Vector3::repeat(self.noise.gyro_bias_sigma)),
                rates: Rates::Unused,
                rounding: 0.0,
            },
            (None, None) => Gyros {
                bias: Vector3::zeros(),
                sigma: Vector3::repeat(self.noise.gyro_bias_sigma),
                rates: Rates::Unused,
                rounding: 0.0,
            },
        };
        let mut alignment = self.assemble(&imu, &fix, &level, &course, heading_sigma, &gyros);
        let position = &mut alignment.sigma.position;
        *position = position.sup(&(scatter * 2.0));
        Some(alignment)
    }

    /// What the steps of the gyros' values do to their mean at rest, standard deviations, rad/s.
    pub(super) fn rounding(&self, imu: &[Inertial]) -> Vector3<f64> {
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

    fn assemble(
        &self,
        imu: &[Inertial],
        fix: &GnssPosition,
        level: &Level,
        course: &Course,
        heading_sigma: f64,
        gyros: &Gyros,
    ) -> Alignment {
        let begin = imu[0].time;
        let q_nb = level.facing(course.heading);
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
        let again = if level.standing_s > 0.0 {
            USED_AGAIN
        } else {
            1.0
        };
        let errors = Errors {
            turned: level.turned,
            level_sigma: (again * level.own_sigma).hypot(gyros.rounding * ROUNDED),
            heading_sigma,
            gyro_sigma: gyros.sigma,
            accel_sigma: self.noise.accel_bias_sigma,
            rates: gyros.rates,
        };
        let covariance = errors.joint(&q_nb, &nav.position);
        let [attitude, gyro_bias] = sigmas(&covariance);
        let spread = velocity_sigma * since.abs() + 0.5 * since * since;
        Alignment {
            nav,
            imu_errors: ImuErrors {
                gyro_bias: gyros.bias,
                ..ImuErrors::default()
            },
            sigma: InitialSigma {
                position: fix_sigma.map(|s| (PRIOR_WIDENING * s).hypot(spread).max(1.0)),
                velocity: Vector3::repeat(velocity_sigma),
                attitude,
                gyro_bias,
                accel_bias: Vector3::repeat(self.noise.accel_bias_sigma),
            },
            covariance,
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
