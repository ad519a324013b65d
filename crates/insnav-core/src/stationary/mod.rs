//! Does the body stand, and what is made of it?

mod evidence;
mod gnss_speed;
mod stop_detector;
mod stop_record;

pub use evidence::{Evidence, Witness};
pub use gnss_speed::{GnssSpeed, Heard, STANDING_SPEED};
pub use stop_detector::{Belief, StopDetector};
pub use stop_record::{StopEnd, StopRecord};
