//! One stop as one measurement of a running filter: what it knew at the stop's begin and all inertial data of the stop together.
//!
//! ZUPT-1 and ZUPT-2 of \[Lobusov14\] are this, once in each position: what the first stop leaves undecided between azimuth and
//! drift along east stays in the covariance, and the second decides it.

use super::fitted::{LARGEST_DISAGREEMENT, QUIET_NIS, velocity_rms};
use super::free_run::Start;
use super::joint::{GLOBAL, Joint, MOST_PASSES, SETTLED};
use super::kalman;
use super::place::Place;
use super::problem::{Prior, Problem};
use super::rates::disagreement;
use super::record::Span;
use super::standing::Taper;
use super::task::{BEND, SHORTEST, TOLERANCE};
use super::{Record, Refusal};
use crate::attitude::log;
use crate::earth::Geodetic;
use crate::error::Result;
use crate::imu::ImuNoise;
use crate::time::Time;
use nalgebra::{SMatrix, SVector, UnitQuaternion, Vector3};
use std::vec;

/// A body stands still to this, m/s.
const STILL: f64 = 1e-4;

/// What a filter knows when a stop begins: its estimate, and the covariance of attitude (φ, n), gyro bias and accelerometer bias.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeforeStop {
    /// Where the body stands.
    pub position: Geodetic,
    /// Attitude, body to NED.
    pub q_nb: UnitQuaternion<f64>,
    /// Gyro bias, body, rad/s.
    pub gyro_bias: Vector3<f64>,
    /// Accelerometer bias, body, m/s².
    pub accel_bias: Vector3<f64>,
    /// Covariance of their errors.
    pub covariance: SMatrix<f64, 9, 9>,
}

/// What it knows of both ends once the whole stop has been looked at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FusedStop {
    /// The last instant of the data.
    pub at: Time,
    /// To be added to what was known of the begin: φ, gyro bias, accelerometer bias.
    pub correction_at_begin: SVector<f64, 9>,
    /// Attitude at the end, body to NED.
    pub q_nb: UnitQuaternion<f64>,
    /// Gyro bias at the end, body, rad/s.
    pub gyro_bias: Vector3<f64>,
    /// Accelerometer bias at the end, body, m/s².
    pub accel_bias: Vector3<f64>,
    /// Covariance of the errors at the begin (first nine) and at the end (last nine).
    pub covariance: SMatrix<f64, 18, 18>,
    /// Velocity at the begin and at the end, NED, m/s: a base that rocks moves, and who is taken to stand may still be braking. Over the
    /// stop it is zero in the mean.
    pub velocity_n: [Vector3<f64>; 2],
    /// Standard deviation of both, each horizontal axis, m/s.
    pub velocity_sigma: f64,
    /// Weights of the regression that the stop's rocking asked for; `None` on a quiet base, where a Kalman filter is better.
    pub taper: Option<Taper>,
}

impl FusedStop {
    /// Where a long stop tells its velocity worse than this, m/s, that of a body which stands takes its place.
    pub(crate) fn known_at_least_to(self, sigma: f64) -> Self {
        if self.velocity_sigma <= sigma {
            return self;
        }
        FusedStop {
            velocity_n: [Vector3::zeros(); 2],
            velocity_sigma: sigma,
            ..self
        }
    }
}

/// Fuse all inertial data of a record, in which the body stands, with what was known at its begin.
///
/// # Errors
/// `Alignment` with a [`Refusal`]: shorter than 40 s, a hole in the data, motion.
pub fn fuse_stop(record: &Record, before: &BeforeStop, noise: &ImuNoise) -> Result<FusedStop> {
    let span = whole(record)?;
    let begin_s = record.times[span.begin].seconds();
    let have_s = record.seconds(span.begin, span.end);
    if have_s < SHORTEST - TOLERANCE {
        return Err(Refusal::StopTooShort {
            begin_s,
            have_s,
            need_s: SHORTEST,
            reason: BEND,
        }
        .into());
    }
    record.require_whole(span)?;
    let mean = Start {
        q_nb: before.q_nb,
        gyro_bias: before.gyro_bias,
        accel_bias: before.accel_bias,
        velocity_n: Vector3::zeros(),
    };
    let prior = Prior {
        mean,
        covariance: before.covariance,
    };
    let problem = Problem {
        record,
        place: Place::new(&before.position),
        spans: vec![span],
        noise,
        gyro_scale_sigma: 0.0,
        heading: None,
        keeps_heading: false,
        knowledge: None,
        prior: Some(prior),
        start: mean,
    };
    let unfit = || crate::error::Error::from(Refusal::NoData);
    let plain = Joint::fit(&problem, Taper::None, false).ok_or_else(unfit)?;
    require_settled(&plain)?;
    let filtered = kalman::filter(&problem, &plain.start);
    let apart = |fit: &Joint, taper, left| {
        disagreement(&fit.stops[0], &fit.run, &problem.place, noise, taper, left).amax()
    };
    let quiet = filtered.nis / (filtered.dof as f64) < QUIET_NIS
        && apart(&plain, Taper::None, None) < LARGEST_DISAGREEMENT;
    let at = record.times[span.end];
    if let (true, Some(begin)) = (quiet, &filtered.begin) {
        let mut covariance = SMatrix::<f64, 18, 18>::zeros();
        let mut put = |i, j, block: &SMatrix<f64, GLOBAL, GLOBAL>| {
            covariance
                .fixed_view_mut::<GLOBAL, GLOBAL>(i, j)
                .copy_from(block);
        };
        put(0, 0, &begin.covariance);
        put(0, GLOBAL, &begin.with_end);
        put(GLOBAL, 0, &begin.with_end.transpose());
        put(GLOBAL, GLOBAL, &filtered.covariance);
        return Ok(FusedStop {
            at,
            correction_at_begin: begin.correction,
            q_nb: filtered.q_nb,
            gyro_bias: filtered.gyro_bias,
            accel_bias: filtered.accel_bias,
            covariance,
            velocity_n: [Vector3::zeros(); 2],
            velocity_sigma: STILL,
            taper: None,
        });
    }
    let taper = Taper::HannSquared;
    let (fit, covariance) = Joint::fit_between(&problem, taper, true).ok_or_else(unfit)?;
    require_settled(&fit)?;
    let disagreement_sigma = apart(&fit, taper, fit.sway.first());
    if disagreement_sigma > LARGEST_DISAGREEMENT {
        return Err(Refusal::NotStationary {
            begin_s,
            velocity_rms_m_per_s: velocity_rms(&fit.residuals[0]),
            disagreement_sigma,
        }
        .into());
    }
    let turn = log(&(fit.start.q_nb * mean.q_nb.inverse()));
    let gyro = fit.start.gyro_bias - mean.gyro_bias;
    let accel = fit.start.accel_bias - mean.accel_bias;
    let parts = [turn, gyro, accel];
    Ok(FusedStop {
        at,
        correction_at_begin: SVector::from_iterator(parts.iter().flatten().copied()),
        q_nb: fit.run.q_nb[fit.run.q_nb.len() - 1],
        gyro_bias: fit.start.gyro_bias,
        accel_bias: fit.start.accel_bias,
        covariance,
        velocity_n: [
            fit.start.velocity_n,
            fit.run.velocity_n[fit.run.velocity_n.len() - 1],
        ],
        velocity_sigma: STILL.hypot(from_the_middle(noise, problem.place.gravity, have_s)),
        taper: Some(taper),
    })
}

fn require_settled(fit: &Joint) -> Result<()> {
    if fit.step_sigmas <= SETTLED {
        return Ok(());
    }
    Err(Refusal::NotConverged {
        passes: MOST_PASSES,
        step_sigmas: fit.step_sigmas,
    }
    .into())
}

/// Standard deviation of the velocity at an end of a stop that is fitted about its middle: noise of the accelerometers, and of the tilt
/// that the gyros carry, over half of the length.
fn from_the_middle(noise: &ImuNoise, gravity: f64, length: f64) -> f64 {
    let half = 0.5 * length;
    let tilted = gravity * noise.gyro_white * (half.powi(3) / 3.0).sqrt();
    tilted.hypot(noise.accel_white * half.sqrt())
}

fn whole(record: &Record) -> Result<Span> {
    let (begin, end) = record.range().ok_or(Refusal::NoData)?;
    record.span(begin, end)
}
