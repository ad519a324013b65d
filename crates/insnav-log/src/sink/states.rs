//! The solution kept in memory.

use super::SinkOptions;
use super::decimation::Decimation;
use super::values::state_message;
use crate::frames::moved_to;
use crate::ros2::{Header, State};
use crate::run::SolutionSink;
use insnav_core::solution::{Epoch, Sink};
use insnav_core::time::Time;
use serde::{Deserialize, Serialize};

/// Keeps, to the last digit, the states that a [`McapSink`](crate::McapSink) with the same options writes to
/// `/insnav/state`: in a vector, or in any collection that takes them.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct StateSink<K = Vec<State<'static>>> {
    kept: K,
    lever_arm_b_m: [f64; 3],
    decimation: Decimation,
}

impl StateSink {
    /// Rate and point of the solution are taken from the options.
    pub fn new(options: &SinkOptions) -> Self {
        StateSink::keeping(Vec::new(), options)
    }

    /// What was kept, in the order of time; the headers have no frame.
    pub fn into_states(self) -> Vec<State<'static>> {
        self.kept
    }
}

impl<K: Extend<State<'static>>> StateSink<K> {
    /// As [`StateSink::new`], into a collection of one's own.
    pub fn keeping(kept: K, options: &SinkOptions) -> Self {
        StateSink {
            kept,
            lever_arm_b_m: options.lever_arm_b_m,
            decimation: Decimation::new(options.rate_hz),
        }
    }

    /// The collection, with the states in the order of time; the headers have no frame.
    pub fn into_kept(self) -> K {
        self.kept
    }

    /// What is kept so far.
    pub fn kept(&self) -> &K {
        &self.kept
    }

    /// What is kept so far, to be taken: what comes next is thinned out as if nobody had.
    pub fn kept_mut(&mut self) -> &mut K {
        &mut self.kept
    }
}

impl<K: Extend<State<'static>>> Sink for StateSink<K> {
    fn wants_epoch(&mut self, time: Time) -> bool {
        self.decimation.wants(time)
    }

    fn epoch(&mut self, epoch: &Epoch) {
        let header = Header {
            stamp: epoch.nav.time,
            frame_id: "",
        };
        let state = if self.lever_arm_b_m == [0.0; 3] {
            state_message(epoch, header)
        } else {
            state_message(&moved_to(epoch, &self.lever_arm_b_m.into()), header)
        };
        self.kept.extend([state]);
    }
}

impl<K: Extend<State<'static>>> SolutionSink for StateSink<K> {}
