//! Does the body stand?

mod gnss_speed;

pub use gnss_speed::{GnssSpeed, Heard, STANDING_SPEED};
