//! Methods without a fit through the stops: levelling, coarse alignment, the loop.

use super::coarse;
use super::free_run::{FreeRun, Start};
use super::gyrocompass::levelling_loop;
use super::level;
use super::record::Span;
use super::task::Task;
use super::{AlignmentMethod, AlignmentResult, Refusal};
use crate::attitude::{Euler, exp, log};
use crate::error::Result;
use nalgebra::{UnitQuaternion, Vector3};
use std::string::{String, ToString};

/// The shortest stop for levelling, s.
const SHORTEST_LEVEL: f64 = 1.0;

impl Task<'_> {
    pub(super) fn levelling(
        &self,
        reason: String,
        predicted: Option<f64>,
    ) -> Result<AlignmentResult> {
        let span = self.spans[self.spans.len() - 1];
        let have_s = self.length(span);
        if have_s < SHORTEST_LEVEL {
            return Err(Refusal::StopTooShort {
                begin_s: self.begin_s(span),
                have_s,
                need_s: SHORTEST_LEVEL,
                reason: "vibration does not average out of gravity in less",
            }
            .into());
        }
        self.record.require_whole(span)?;
        self.require_still(span)?;
        let heading = self.told_at_last()?;
        let levelled = level::level(self.record, span, &self.place, &self.options.noise, heading);
        self.require_hemisphere((levelled.q_nb * levelled.gyro_bias).z)?;
        let predicted = predicted.unwrap_or_else(|| self.predicted_azimuth_sigma());
        let mut result = self.result(
            AlignmentMethod::Levelling,
            reason,
            levelled.q_nb,
            levelled.gyro_bias,
            Vector3::zeros(),
            levelled.covariance,
        );
        match self.options.heading {
            Some((told, _)) => {
                result.azimuth = Some(told.rem_euclid(core::f64::consts::TAU));
            }
            None => {
                result.azimuth_sigma = predicted;
                result.observable[2] = false;
            }
        }
        Ok(result)
    }

    /// Methods that look at one stop (the last), leave the biases alone and say so in the covariance.
    pub(super) fn single(&self, method: AlignmentMethod) -> Result<AlignmentResult> {
        let span = self.spans[self.spans.len() - 1];
        self.require_still(span)?;
        let q_nb = match method {
            AlignmentMethod::TwoVector => {
                let start = coarse::two_vector(self.record, span);
                self.carried(span, &start)
            }
            AlignmentMethod::Coarse => {
                let start = coarse::inertial_frame(self.record, span, &self.place);
                self.carried(span, &start)
            }
            _ => {
                let start = coarse::inertial_frame(self.record, span, &self.place);
                let heading = Euler::from_quaternion(&start.q_nb).heading;
                let q_level = exp(&Vector3::new(0.0, 0.0, -heading)) * start.q_nb;
                let found = levelling_loop(self.record, span.begin, span, &self.place, q_level);
                exp(&Vector3::new(0.0, 0.0, found.azimuth())) * found.q_level
            }
        };
        // The loop settles in the first half.
        let share = if method == AlignmentMethod::Gyrocompass {
            0.5
        } else {
            1.0
        };
        let noise = &self.options.noise;
        // A mean of rates with tilt free, as the velocity shows it: the quadratic fit's variance, which is what the loop's
        // integrator and the q-method attain or miss by a few per cent.
        let length = share * self.length(span);
        let rate_variance = 10.0 / 7.0 * noise.gyro_white.powi(2) / length
            + 120.0 / 7.0 * (noise.accel_white / self.place.gravity).powi(2) / length.powi(3);
        // Where the attitude was found: in the middle of all stretches, at the begin, or by the loop, which holds level and averages
        // the heading over the second half.
        let carried = match method {
            AlignmentMethod::TwoVector => [length; 2],
            AlignmentMethod::Coarse => [0.5 * length; 2],
            _ => [0.0, 0.5 * length],
        };
        let place = &self.place;
        let covariance =
            level::covariance(&q_nb, place, noise, length, Some(rate_variance), carried);
        Ok(self.result(
            method,
            "asked for".to_string(),
            q_nb,
            Vector3::zeros(),
            Vector3::zeros(),
            covariance,
        ))
    }

    /// The heading that is told, and its sigma, at the begin of the last stop: the gyros carry it there from the first, by which it
    /// also tells their bias.
    pub(super) fn told_at_last(&self) -> Result<Option<(f64, f64)>> {
        let Some((told, sigma)) = self.options.heading else {
            return Ok(None);
        };
        let [first, .., last] = self.spans.as_slice() else {
            return Ok(Some((told, sigma)));
        };
        self.record.require_whole(self.whole())?;
        self.require_still(*first)?;
        let noise = &self.options.noise;
        let heading = Some((told, sigma));
        let levelled = level::level(self.record, *first, &self.place, noise, heading);
        let mut q = levelled.q_nb;
        let nodes = &self.record.nodes[first.end..last.begin];
        for node in nodes {
            let (rotation, _) = node.corrected(&levelled.gyro_bias, &Vector3::zeros());
            q = exp(&-(self.place.earth_n * node.dt)) * q * rotation;
        }
        let time: f64 = nodes.iter().map(|node| node.dt).sum();
        let turn = log(&(q * levelled.q_nb.inverse())).norm();
        let rate = levelled.covariance.diagonal().fixed_rows::<3>(3).max();
        let carried = (noise.gyro_white.powi(2) + rate * time) * time;
        let scale = self.options.gyro_scale_sigma * turn;
        let sigma = (sigma * sigma + carried + scale * scale).sqrt();
        Ok(Some((Euler::from_quaternion(&q).heading, sigma)))
    }

    /// The attitude at the end of a stop from that at its begin.
    pub(super) fn carried(&self, span: Span, start: &Start) -> UnitQuaternion<f64> {
        let run = FreeRun::new(self.record, span, &self.place, start);
        run.q_nb[run.q_nb.len() - 1]
    }
}
