//! `insnav.align`: attitude before there is one.
//!
//! `by_stops` is what the command `insnav align` does; `record` aligns inertial data of any origin with all that the core lets one ask;
//! `start` is what a run begins with, and its sources one at a time; `found` hands out what was found.

mod by_stops;
mod found;
mod record;
mod start;

pub(crate) use by_stops::align_by_stops;
pub(crate) use record::{Record, align_stops};
pub(crate) use start::{level, magnetic_start, moving_base_start, run_start};
