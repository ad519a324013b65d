//! Static mode: the body rests. Position and attitude are constants, the velocity is zero, and what the inertial unit measures
//! shows its errors: means of a second are measurements, nothing is integrated.
//!
//! This is the limit of a held pose for a noise of zero (stochastic cloning of position and attitude), at the cost of two
//! small updates a second. Should the body move all the same (somebody gets in), the gyros have been added up beside: that
//! second is then taken back and the attitude follows them.

use super::standing::told;
use crate::config::StationaryConfig;
use crate::earth::earth_rate_n;
use crate::error::Result;
use crate::filter::{ATTITUDE, Eskf, GYRO_BIAS, Gate, POSITION, Settling, Update};
use crate::imu::ImuNoise;
use crate::measurement::{StandingForceModel, StandingRateModel, ZeroVelocityAid};
use crate::mechanization::Increment;
use crate::solution::Sink;
use crate::stationary::Rounding;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// Length of the means, s.
const MEAN: f64 = 1.0;
/// What is left at the end of a stop counts as a mean from this length on, s.
const SHORTEST: f64 = 0.05;
/// So many means in a row that do not fit end the stop.
const PATIENCE: u32 = 3;
/// NIS of three degrees of freedom of a mean that does not fit: by chance once in a hundred million, since one second that is
/// taken back turns the heading by what the gyros' noise is in it, and a stop of an hour has 7200 means.
const MISFIT_NIS: f64 = 40.13;
/// With a heading that is known no better, the Earth's rate does not tell the gyros' bias from the heading, rad.
const VAGUE_HEADING: f64 = 0.2;
/// Velocity that a start may have gained unseen, over the density of the accelerometers' noise, √s: a mean of a second shows
/// no less than nine densities of acceleration, for 1.2 s; a third of what that makes is a sigma.
const UNSEEN: f64 = 3.5;
/// And the way, over that velocity, s.
const UNSEEN_FOR: f64 = 0.6;
/// Nothing is learnt from a measurement of so much more variance than the prediction.
const MUTE: f64 = 1e12;

/// Means, and how a body at rest moves.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Resting {
    settling: Settling,
    velocity_sigma: f64,
    zero_velocity: ZeroVelocityAid,
    /// White noise of gyros and accelerometers at rest: vibration under way is in neither mean.
    gyro_white: f64,
    accel_white: f64,
    sum: Sum,
    /// By how much the errors lag behind the nav state, s.
    behind: f64,
    misfits: u32,
    worst: f64,
    /// What the steps in which the gyros' values come do to their means, as last told.
    rounding: Rounding,
    /// Whether a mean has been used that was taken to be finer than that.
    taught: [bool; 3],
    took_back: bool,
}

/// What the unit has measured since the last mean.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Sum {
    rotation_b: Vector3<f64>,
    velocity_b: Vector3<f64>,
    dt: f64,
}

impl Resting {
    pub(super) fn new(config: &StationaryConfig, noise: &ImuNoise) -> Self {
        let at_rest = config.noise_at_rest(noise);
        Resting {
            gyro_white: at_rest.gyro_white,
            accel_white: at_rest.accel_white,
            settling: Settling {
                attitude: config.attitude_walk_deg_per_sqrt_hour.to_radians() / 60.0,
                position: config.position_walk_m_per_sqrt_s,
            },
            velocity_sigma: config.velocity_sigma_m_per_s,
            zero_velocity: ZeroVelocityAid::new(config),
            sum: Sum::default(),
            behind: 0.0,
            misfits: 0,
            worst: 0.0,
            rounding: Rounding::default(),
            taught: [false; 3],
            took_back: false,
        }
    }

    /// Come to rest: one zero velocity, from which everything learns; afterwards the velocity is zero by definition.
    pub(super) fn enter(&mut self, filter: &mut Eskf) -> Result<Update> {
        self.sum = Sum::default();
        self.behind = 0.0;
        (self.misfits, self.worst) = (0, 0.0);
        // The weight of a velocity known to `velocity_sigma`.
        let dt = self.zero_velocity.interval_for(self.velocity_sigma);
        let update = self.zero_velocity.observe(dt, filter)?;
        filter.forget_velocity(self.velocity_sigma);
        let now = filter.nominal().nav.time;
        filter.stay(now, 0.0, &self.settling);
        Ok(update)
    }

    /// Pass over one raw increment: it is added up, nothing else.
    pub(super) fn pass(&mut self, raw: &Increment, filter: &mut Eskf) {
        self.sum.rotation_b += raw.rotation_b;
        self.sum.velocity_b += raw.velocity_b;
        self.sum.dt += raw.dt;
        self.behind += raw.dt;
        filter.stay(raw.time, 0.0, &self.settling);
    }

    /// Bring the errors up to the nav state.
    pub(super) fn catch_up(&mut self, filter: &mut Eskf) {
        let (now, dt) = (filter.nominal().nav.time, core::mem::take(&mut self.behind));
        filter.stay(now, dt, &self.settling);
    }

    /// Once a second: what the means say.
    pub(super) fn observe(
        &mut self,
        rounding: &Rounding,
        filter: &mut Eskf,
        sink: &mut impl Sink,
    ) -> Result<()> {
        self.took_back = false;
        if self.sum.dt < MEAN {
            return Ok(());
        }
        self.rounding = *rounding;
        self.use_means(filter, sink)
    }

    /// Whether the last mean was taken back, and the attitude turned instead.
    pub(super) fn took_back(&self) -> bool {
        self.took_back
    }

    /// The worst NIS of late, when what was measured has not fitted a body at rest for some time.
    pub(super) fn contradiction(&self) -> Option<f64> {
        (self.misfits >= PATIENCE).then_some(self.worst)
    }

    /// Rise: what was measured since the last mean is used, the velocity is what a body that starts may have.
    pub(super) fn leave(&mut self, filter: &mut Eskf, sink: &mut impl Sink) -> Result<()> {
        self.took_back = false;
        self.catch_up(filter);
        let outcome = if self.sum.dt >= SHORTEST {
            self.use_means(filter, sink)
        } else {
            Ok(())
        };
        let unseen = UNSEEN * self.accel_white;
        let way = unseen * UNSEEN_FOR;
        filter.forget_velocity(self.velocity_sigma.hypot(unseen));
        filter.widen(POSITION, &Matrix3::from_diagonal_element(way * way));
        outcome
    }

    fn use_means(&mut self, filter: &mut Eskf, sink: &mut impl Sink) -> Result<()> {
        self.catch_up(filter);
        self.widen(filter);
        let sum = core::mem::take(&mut self.sum);
        let (force, rate) = (self.force_model(&sum), self.rate_model(&sum, filter));
        let now = filter.nominal().nav.time;
        let looks = [
            filter.update(&force, now, &mut Gate::closed())?,
            filter.update(&rate, now, &mut Gate::closed())?,
        ];
        if looks.iter().any(|look| look.nis > MISFIT_NIS) {
            self.worst = looks.iter().map(|look| look.nis).fold(self.worst, f64::max);
            self.misfits += 1;
            self.took_back = true;
            for look in &looks {
                sink.update(look);
            }
            turn(&sum, filter);
            return Ok(());
        }
        (self.misfits, self.worst) = (0, 0.0);
        let mut gate = Gate::open();
        told(filter.update(&force, now, &mut gate), sink)
            .and(told(filter.update(&rate, now, &mut gate), sink))
    }

    /// Give the bias back, once, what means taught of it before the steps were seen.
    fn widen(&mut self, filter: &mut Eskf) {
        let mut extra = Matrix3::zeros();
        for (axis, taught) in self.taught.iter_mut().enumerate() {
            if self.rounding.step[axis] <= 0.0 {
                *taught |= self.rounding.sigma[axis] <= 0.0;
            } else if core::mem::take(taught) {
                extra[(axis, axis)] = self.rounding.sigma[axis].powi(2);
            }
        }
        filter.widen(GYRO_BIAS, &extra);
    }

    fn force_model(&self, sum: &Sum) -> StandingForceModel {
        StandingForceModel {
            specific_force_b: sum.velocity_b / sum.dt,
            variance: self.accel_white * self.accel_white / sum.dt,
        }
    }

    /// The mean rate with its variance: white noise, and what does not average out.
    fn rate_model(&self, sum: &Sum, filter: &Eskf) -> StandingRateModel {
        let white = self.gyro_white * self.gyro_white / sum.dt;
        let nav = &filter.nominal().nav;
        let to_b = nav.q_nb.inverse().to_rotation_matrix().into_inner();
        let earth_rate_n = earth_rate_n(nav.position.latitude);
        let heading = filter.attitude_covariance_n()[(2, 2)];
        let is_vague = heading >= VAGUE_HEADING * VAGUE_HEADING;
        let covariance = filter.covariance();
        let block = |with| covariance.block(GYRO_BIAS, with);
        let mut known = block(GYRO_BIAS).unwrap_or_else(Matrix3::zeros).diagonal();
        // What a vague heading has to do with the biases already is not looked for again: the rest of them has nothing to do with it.
        let cross = block(ATTITUDE).map_or_else(Vector3::zeros, |c| c.column(2).into_owned());
        let by_heading = if is_vague {
            known -= cross.component_mul(&cross) / heading;
            -cross / heading
        } else {
            Vector3::zeros()
        };
        // A mean of coarse steps is off by up to half of one, however long it is taken; one value that repeats tells nothing.
        let mut lasting = self.rounding.sigma.map(|sigma| sigma * sigma);
        if is_vague {
            let horizontal = earth_rate_n.x;
            let down_b = to_b.column(2);
            lasting += down_b.map(|d| 0.5 * horizontal * horizontal * (1.0 - d * d).max(0.0));
        }
        StandingRateModel {
            angular_rate_b: sum.rotation_b / sum.dt,
            variance: Vector3::from_fn(|i, _| white + not_below(lasting[i], known[i])),
            earth_rate_tells: !is_vague,
            by_heading,
        }
    }
}

/// The variance of a measurement that brings a prior down to `lasting` at best, however often it is taken: an error that does
/// not average out.
fn not_below(lasting: f64, prior: f64) -> f64 {
    if lasting <= 0.0 {
        0.0
    } else if prior <= lasting {
        MUTE * lasting
    } else {
        lasting * prior / (prior - lasting)
    }
}

/// The body did turn: follow the gyros over the time of the sum.
fn turn(sum: &Sum, filter: &mut Eskf) {
    let raw = Increment {
        time: filter.nominal().nav.time,
        dt: sum.dt,
        rotation_b: sum.rotation_b,
        velocity_b: sum.velocity_b,
    };
    let rotation_b = raw.corrected(&filter.nominal().imu_errors).rotation_b;
    filter.turn(&rotation_b, sum.dt);
}
