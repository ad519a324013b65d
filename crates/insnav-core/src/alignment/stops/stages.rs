//! Where a fit starts: coarse for short stops, by way of their nearest stretches for long ones.
//!
//! A free run with a drift of 3 °/h over stops of half an hour tilts by degrees and leaves the region in which errors go linearly.
//! The stretches of five minutes on both sides of a turn show the drift well enough to take it out before the whole is run.

use super::coarse;
use super::free_run::Start;
use super::joint::{Joint, SETTLED};
use super::record::Span;
use super::standing::Taper;
use super::task::Task;
use crate::attitude::{Euler, exp, wrap_angle};
use nalgebra::Vector3;
use std::vec::Vec;

/// Stops up to this length are run at once, s: 3 °/h tilt by a quarter of a degree in it.
const NEAR: f64 = 300.0;
/// A coarse heading that a drift taken out moves by less was good enough, rad.
const SAME_HEADING: f64 = 0.1;
/// Rounds of coarse alignment and fit: drifts like the Earth's own rate turn the first heading anywhere.
const ROUNDS: usize = 3;

impl Task<'_> {
    /// Coarse start at the first stop's begin, turned to a heading that is kept.
    pub(super) fn start(&self, keeps_heading: bool) -> Start {
        self.start_with(keeps_heading, [Vector3::zeros(); 2])
    }

    /// Likewise with gyro and accelerometer biases that are known already.
    fn start_with(&self, keeps_heading: bool, biases: [Vector3<f64>; 2]) -> Start {
        let mut start =
            coarse::inertial_frame_with(self.record, self.spans[0], &self.place, biases);
        if let Some((heading, _)) = self.options.heading.filter(|_| keeps_heading) {
            let turn = wrap_angle(heading - Euler::from_quaternion(&start.q_nb).heading);
            start.q_nb = exp(&Vector3::new(0.0, 0.0, turn)) * start.q_nb;
        }
        start
    }

    /// A start from which the fit of all stops is nearly linear.
    pub(super) fn near_start(&self, keeps_heading: bool) -> Start {
        if self.spans.iter().all(|s| self.length(*s) <= NEAR) {
            return self.start(keeps_heading);
        }
        let mut biases = [Vector3::zeros(); 2];
        for count in 2.min(self.spans.len())..=self.spans.len() {
            let near = Task {
                spans: self.nearest(count),
                ..*self
            };
            for _ in 0..ROUNDS {
                let start = near.start_with(keeps_heading, biases);
                let problem = near.problem(start, keeps_heading);
                let fit = Joint::fit(&problem, Taper::HannSquared, false);
                let Some(fit) = fit.filter(|f| f.step_sigmas <= SETTLED) else {
                    break;
                };
                biases = [fit.start.gyro_bias, fit.start.accel_bias];
                let again = near.start_with(keeps_heading, biases);
                let heading = |s: &Start| Euler::from_quaternion(&s.q_nb).heading;
                if wrap_angle(heading(&again) - heading(&start)).abs() < SAME_HEADING {
                    break;
                }
            }
        }
        self.start_with(keeps_heading, biases)
    }

    /// The first `count` stops; the first one's end and the last one's begin alone.
    fn nearest(&self, count: usize) -> Vec<Span> {
        let mut spans = self.spans[..count].to_vec();
        let seconds = |from: usize, to: usize| self.record.seconds(from, to);
        let first = &mut spans[0];
        while seconds(first.begin, first.end) > NEAR {
            first.begin += 1;
        }
        let last = &mut spans[count - 1];
        while seconds(last.begin, last.end) > NEAR {
            last.end -= 1;
        }
        spans
    }
}
