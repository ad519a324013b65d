//! Errors of a solution against a reference: how large they are, and whether the stated uncertainty describes them.
//!
//! Everything is compared at the instants of the reference: the solution is interpolated there, never extrapolated and
//! never across a hole. Where a reference states its own sigmas they are added to the solution's covariance before
//! anything is normalised, so that a good solution is not blamed for the reference's noise.

mod comparison;
mod course;
mod errors;
mod estimate;
mod mounting;
mod orientation;
mod reference;
mod series;
mod standing;
mod track;

pub use comparison::{CompareOptions, Comparison, Withheld, compare};
pub use course::{Course, heading_minus_course};
pub use errors::{Coverage, ErrorStatistics, Nees, PointError};
pub use estimate::Estimate;
pub use mounting::mean_rotation;
pub use orientation::{
    OrientationErrors, OrientationMean, OrientationPair, orientation_errors, orientation_mean,
    to_enu_flu,
};
pub use reference::{AttitudeReference, ReferencePoint};
pub use series::{ErrorInstant, error_series};
pub use standing::{DetectedStop, Stop, StopFinder, false_standing_s, stop_delays};
pub use track::{SolutionPoint, Track};
