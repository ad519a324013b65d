//! Does the body stand, and what is made of it?

pub mod are;
mod composite;
mod declared;
mod evidence;
pub mod glrt;
mod gnss_speed;
mod heading_ledger;
mod inertial;
mod learnt;
mod low_pass;
pub mod mag;
pub mod mv;
#[cfg(feature = "std")]
mod over_record;
pub mod quantile;
mod quantised;
mod rest_noise;
mod rocking_level;
#[cfg(feature = "std")]
mod sliding;
mod speed;
mod stop_detector;
mod stop_record;
mod tone;
mod window;

pub use declared::Notice;
pub use evidence::{Evidence, Witness};
pub use gnss_speed::{GnssSpeed, Heard, STANDING_SPEED};
pub use heading_ledger::HeadingLedger;
#[cfg(feature = "std")]
pub use over_record::{DetectedStop, DetectedStops, detect_stops};
pub use quantised::{GyroSteps, Rounding};
pub use rest_noise::RestNoise;
#[cfg(feature = "std")]
pub use sliding::sliding_moments;
pub use stop_detector::{Belief, GAP, LOOK_AHEAD, StopDetector};
pub use stop_record::{StopEnd, StopRecord};
pub use window::Moments;
