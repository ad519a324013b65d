//! Batch mode: a stop's inertial data are looked at together when it is over, from what was known when it began.
//!
//! While the stop lasts, zero velocities lead the filter; what they taught is thrown away at its end. Both are made of the same
//! data, and who uses them twice believes them twice.

use crate::alignment::{FusedStop, Record, fuse_stop};
use crate::config::StationaryConfig;
use crate::error::{Error, Result};
use crate::filter::{ACCEL_SCALE, Eskf, GYRO_SCALE, Gate, Settling};
use crate::imu::ImuNoise;
use crate::measurement::KnownVelocityModel;
use crate::mechanization::Increment;
use crate::solution::NotFused;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::boxed::Box;
use std::collections::VecDeque;

/// The last of a stop is left out, s: who sets off rocks before anybody sees it.
const TAIL: f64 = 1.0;
/// A stop is looked at in pieces of this length, s: biases wander, and memory is not endless.
const PIECE: f64 = 1800.0;

/// What a stop says of attitude and biases may differ from what was known by so many sigmas.
const MOST_SIGMAS: f64 = 6.0;

/// The stop that lasts.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Batch {
    /// Of the velocity at the begin, before the stop shows it, m/s.
    velocity_sigma: f64,
    settling: Settling,
    noise: ImuNoise,
    /// The filter at the begin.
    begin: Box<Eskf>,
    record: Record,
    /// What may be a begin of motion already.
    tail: VecDeque<Increment>,
    tail_s: f64,
    /// Whether something else was measured meanwhile, which going back would lose.
    disturbed: bool,
}

impl Batch {
    /// Come to rest: from here on the data are kept.
    pub(super) fn enter(config: &StationaryConfig, noise: &ImuNoise, filter: &Eskf) -> Self {
        Batch {
            velocity_sigma: config.velocity_sigma_m_per_s,
            settling: Settling {
                attitude: 0.0,
                position: config.position_walk_m_per_sqrt_s,
            },
            // Not that of the stop itself: rocking is no white noise, and the fit looks for it.
            noise: *noise,
            begin: Box::new(filter.clone()),
            record: Record::default(),
            tail: VecDeque::new(),
            tail_s: 0.0,
            disturbed: false,
        }
    }

    /// Keep one raw increment.
    pub(super) fn keep(&mut self, raw: &Increment) {
        self.tail.push_back(*raw);
        self.tail_s += raw.dt;
        while let Some(oldest) = self.tail.front()
            && self.tail_s - oldest.dt >= TAIL
        {
            self.tail_s -= oldest.dt;
            self.record.push(oldest);
            self.tail.pop_front();
        }
    }

    /// Something else than standing was measured.
    pub(super) fn disturb(&mut self) {
        self.disturbed = true;
    }

    /// Whether there is a piece to be looked at before the stop is over.
    pub(super) fn is_full(&self) -> bool {
        self.record
            .range()
            .is_some_and(|(begin, end)| end.since(begin) >= PIECE)
    }

    /// Go back to the begin, and from there to here with the whole stop. `Some`: why not; the filter is then where zero velocities
    /// have led it.
    ///
    /// # Errors
    /// As [`Eskf::update`].
    pub(super) fn fuse(self, filter: &mut Eskf) -> Result<Option<NotFused>> {
        if self.disturbed {
            return Ok(Some(NotFused::Disturbed));
        }
        let layout = self.begin.covariance().layout();
        let has_scale = self.begin.nominal().imu_errors.has_scale();
        if has_scale || layout.has(GYRO_SCALE) || layout.has(ACCEL_SCALE) {
            return Ok(Some(NotFused::Scale));
        }
        // How still the body stood is seen first: the velocity with which it came to rest is then known as well.
        let about_zero = KnownVelocityModel {
            velocity_n: Vector3::zeros(),
            sigma: self.velocity_sigma,
        };
        let looked = self.look(&about_zero).and_then(|(_, stop)| {
            self.look(&KnownVelocityModel {
                velocity_n: stop.velocity_n[0],
                sigma: stop.velocity_sigma,
            })
        });
        let (mut fused, stop) = match looked {
            Ok(both) => both,
            Err(Error::Alignment(refusal)) => return Ok(Some(refusal.into())),
            Err(error) => return Err(error),
        };
        let known = fused.before_stop().covariance.diagonal();
        let sigmas = stop
            .correction_at_begin
            .zip_map(&known, |moved, variance| moved.abs() / variance.sqrt())
            .max();
        if sigmas > MOST_SIGMAS {
            return Ok(Some(NotFused::Inconsistent { sigmas }));
        }
        if !fused.pass_stop(&stop, &self.settling) {
            return Ok(Some(NotFused::Singular));
        }
        // What has not filled a node, and the tail.
        for raw in self.record.rest().into_iter().chain(self.tail) {
            fused.propagate(&raw);
        }
        *filter = fused;
        Ok(None)
    }

    /// The filter as it came to rest with this velocity, and what the stop then says.
    fn look(&self, velocity: &KnownVelocityModel) -> Result<(Eskf, FusedStop)> {
        let mut rested = (*self.begin).clone();
        let now = rested.nominal().nav.time;
        rested.update(velocity, now, &mut Gate::lenient())?;
        rested.forget_velocity(velocity.sigma);
        let stop = fuse_stop(&self.record, &rested.before_stop(), &self.noise)?;
        Ok((rested, stop.known_at_least_to(self.velocity_sigma)))
    }
}
