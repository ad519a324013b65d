//! `insnav.stationary`: does the body stand?
//!
//! `statistics` are the four detectors of [Skog10] over sliding windows, `detector` the composite as a class and over arrays.

mod detector;
mod statistics;

pub(crate) use detector::{StopDetector, detect_stops};
pub(crate) use statistics::{detector_statistic, quantile_of_squares};
