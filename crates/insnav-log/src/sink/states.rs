//! The solution kept in memory.

use super::SinkOptions;
use super::decimation::Decimation;
use super::values::state_message;
use crate::frames::moved_to;
use crate::ros2::{Header, State};
use crate::run::SolutionSink;
use insnav_core::solution::{Epoch, Sink};
use insnav_core::time::Time;

/// Keeps, to the last digit, the states that a [`McapSink`](crate::McapSink) with the same options writes to
/// `/insnav/state`.
#[derive(Clone, Debug)]
pub struct StateSink {
    states: Vec<State<'static>>,
    lever_arm_b_m: [f64; 3],
    decimation: Decimation,
}

impl StateSink {
    /// Rate and point of the solution are taken from the options.
    pub fn new(options: &SinkOptions) -> Self {
        StateSink {
            states: Vec::new(),
            lever_arm_b_m: options.lever_arm_b_m,
            decimation: Decimation::new(options.rate_hz),
        }
    }

    /// What was kept, in the order of time; the headers have no frame.
    pub fn into_states(self) -> Vec<State<'static>> {
        self.states
    }
}

impl Sink for StateSink {
    fn wants_epoch(&mut self, time: Time) -> bool {
        self.decimation.wants(time)
    }

    fn epoch(&mut self, epoch: &Epoch) {
        let header = Header {
            stamp: epoch.nav.time,
            frame_id: "",
        };
        self.states.push(if self.lever_arm_b_m == [0.0; 3] {
            state_message(epoch, header)
        } else {
            state_message(&moved_to(epoch, &self.lever_arm_b_m.into()), header)
        });
    }
}

impl SolutionSink for StateSink {}
