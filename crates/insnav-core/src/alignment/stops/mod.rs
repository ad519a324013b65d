//! Alignment from stops: attitude, azimuth and sensor drifts from standing in one place, in one or more positions.
//!
//! A [`Record`] holds inertial data, [`StopWindow`]s say when the body stood, and [`align`] gives an [`AlignmentResult`] or a
//! [`Refusal`]. After \[Lobusov14\], whose explicit equations are kept as a method for comparison.

mod align;
mod coarse;
mod earth_rate;
mod fitted;
mod free_run;
mod fuse;
mod geometry;
mod gyrocompass;
mod joint;
mod kalman;
mod level;
mod options;
mod paper;
mod place;
mod problem;
mod rates;
mod record;
mod refusal;
mod result;
mod stages;
mod standing;
mod sway;
mod task;
mod unfitted;

pub use align::align;
pub(crate) use coarse::coarse_attitude;
pub(super) use coarse::{correlate, rotation};
pub use fuse::{BeforeStop, FusedStop, fuse_stop};
pub use options::{AlignmentOptions, StopWindow};
pub use rates::rate_limit;
pub use record::Record;
pub use refusal::Refusal;
pub use result::{AlignmentMethod, AlignmentResult, StopReport};
pub use standing::Taper;
