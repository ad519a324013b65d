//! What every batch method is given: the record, the stops, the place and the unit.

use super::free_run::{FreeRun, Start};
use super::place::Place;
use super::record::{Record, Span};
use crate::attitude::log;
use crate::imu::ImuNoise;
use nalgebra::Vector3;
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
    /// Whether a regression keeps to that heading.
    pub(super) keeps_heading: bool,
    /// Standard deviations of the biases beforehand (rad/s, m/s²), where a regression must lean on them.
    pub(super) knowledge: Option<[f64; 2]>,
    /// Coarse start.
    pub(super) start: Start,
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

    /// Standard deviation of the heading that a regression keeps to.
    pub(super) fn kept_heading_sigma(&self) -> Option<f64> {
        self.heading
            .filter(|_| self.keeps_heading)
            .map(|(_, sigma)| sigma)
    }

    /// Rotation vector between the stop before `stop` and that stop, n, rad.
    pub(super) fn turn_before(&self, stop: usize, run: &FreeRun) -> Vector3<f64> {
        let before = run.q_nb[run.at(self.spans[stop - 1].end)];
        let after = run.q_nb[run.at(self.spans[stop].begin)];
        log(&(after * before.inverse()))
    }
}
