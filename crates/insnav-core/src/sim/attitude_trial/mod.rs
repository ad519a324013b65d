//! The experiment of \[Belokurov18\]: one record, one filter, many ways to set its Q and R.

mod adaptation;
mod trial;
mod variant;
mod windows;

pub use trial::{AttitudeErrors, AttitudePoint, AttitudeTrial};
pub use variant::AttitudeVariant;
