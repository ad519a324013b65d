//! Orientation from gyro, accelerometer and, where there is one, magnetometer.
//!
//! [`Ahrs`] takes samples one by one and needs no heap; [`smooth`] looks at a whole record from both ends. One set of
//! [`AhrsSettings`] serves for hands, robots and drones.

mod block;
mod correction;
mod filter;
mod history;
mod propagation;
mod rest;
mod saturation;
mod settings;
#[cfg(feature = "std")]
mod smoother;
mod start;
mod state;

pub use filter::{Ahrs, AhrsEpoch};
pub use saturation::gyro_range;
pub use settings::{AhrsSettings, FieldSettings, RestSettings};
#[cfg(feature = "std")]
pub use smoother::{Smoother, smooth};
