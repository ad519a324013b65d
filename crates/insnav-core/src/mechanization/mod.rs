//! Strapdown mechanization: inertial samples to increments, increments to position, velocity and attitude.

mod increment;
mod nav_state;

pub use increment::{Increment, IncrementBuilder};
pub use nav_state::{Interval, NavState};
