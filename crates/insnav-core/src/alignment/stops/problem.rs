//! What every batch method is given: the record, the stops, the place and the unit.

use super::free_run::{FreeRun, Start};
use super::joint::GLOBAL;
use super::place::Place;
use super::record::{Record, Span};
use crate::attitude::log;
use crate::imu::ImuNoise;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use std::vec::Vec;

/// Normal gravity differs from gravity by so much, m/s² (30 mGal).
const GRAVITY_SIGMA: f64 = 3e-4;

/// The data and what is known beforehand.
#[derive(Clone, Debug)]
pub(super) struct Problem<'a> {
    pub(super) record: &'a Record,
    pub(super) place: Place,
    /// Stops in the order of time; at least one.
    pub(super) spans: Vec<Span>,
    pub(super) noise: &'a ImuNoise,
    /// Standard deviation of the gyros' scale factors: it acts in the turns between stops.
    pub(super) gyro_scale_sigma: f64,
    /// Heading at the first stop's begin and its standard deviation, if it is known beforehand.
    pub(super) heading: Option<(f64, f64)>,
    /// Whether a regression keeps to that heading; else it is one more measurement.
    pub(super) keeps_heading: bool,
    /// Standard deviations of the biases beforehand (rad/s, m/s²), where a regression must lean on them.
    pub(super) knowledge: Option<[f64; 2]>,
    /// All that a filter knew at the begin of the first stop, in place of the heading and of what is known of the biases.
    pub(super) prior: Option<Prior>,
    /// Coarse start.
    pub(super) start: Start,
}

/// An estimate of attitude and biases at an instant and its covariance (φ in n, gyro bias, accelerometer bias).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Prior {
    pub(super) mean: Start,
    pub(super) covariance: SMatrix<f64, GLOBAL, GLOBAL>,
}

impl Prior {
    /// What has to be added to `start` to come to the mean.
    pub(super) fn seen_from(&self, start: &Start) -> SVector<f64, GLOBAL> {
        let turn = log(&(self.mean.q_nb * start.q_nb.inverse()));
        let gyro = self.mean.gyro_bias - start.gyro_bias;
        let accel = self.mean.accel_bias - start.accel_bias;
        SVector::from_iterator([turn, gyro, accel].iter().flatten().copied())
    }
}

impl Problem<'_> {
    /// From the first stop's begin to the last one's end.
    pub(super) fn whole(&self) -> Span {
        Span {
            begin: self.spans[0].begin,
            end: self.spans[self.spans.len() - 1].end,
        }
    }

    /// Standard deviation of a stop's mean vertical force against normal gravity, m/s².
    pub(super) fn vertical_sigma(&self, length: f64) -> f64 {
        GRAVITY_SIGMA.hypot(self.noise.accel_white / length.sqrt())
    }

    /// What has to be added to `start` to come to what is expected beforehand; without a prior, biases of zero.
    pub(super) fn expected(&self, start: &Start) -> SVector<f64, GLOBAL> {
        match &self.prior {
            Some(prior) => prior.seen_from(start),
            None => {
                let parts = [Vector3::zeros(), -start.gyro_bias, -start.accel_bias];
                SVector::from_iterator(parts.iter().flatten().copied())
            }
        }
    }

    /// What scale errors of the three gyros make of the attitude between the stop before `stop` and that stop: rotation, n, rad per
    /// unit of scale. A turn there and back makes nothing, two turns the same way twice as much.
    pub(super) fn turn_by_scale(&self, stop: usize, run: &FreeRun) -> Matrix3<f64> {
        let between = self.spans[stop - 1].end..self.spans[stop].begin;
        between
            .map(|k| {
                let turn = log(&self.record.nodes[k].rotation);
                run.axes_n[run.at(k)] * Matrix3::from_diagonal(&turn)
            })
            .sum()
    }
}
