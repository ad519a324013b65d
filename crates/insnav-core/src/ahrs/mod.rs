//! Orientation from gyro, accelerometer and, where there is one, magnetometer.
//!
//! [`Ahrs`] takes samples one by one and needs no heap; [`smooth`] looks at a whole record from both ends. One set of
//! [`AhrsSettings`] serves for hands, robots and drones.
//!
//! Beside it, for study and comparison: the scheme of \[Belokurov18\] ([`InvariantFilter`]), the monitors that tell its noise
//! ([`AttitudeMonitor`]) and gates that do not lock out ([`ArmedGate`], [`FieldGate`]).

mod armed_gate;
mod attitude_monitor;
mod block;
mod correction;
mod field_gate;
mod filter;
mod history;
mod invariant;
mod measured_attitude;
mod propagation;
mod rest;
mod saturation;
mod settings;
#[cfg(feature = "std")]
mod smoother;
mod start;
mod state;

pub use armed_gate::{ArmedGate, Passage};
pub use attitude_monitor::{AttitudeChannelNoise, AttitudeMonitor, AttitudeMonitorSettings};
pub use field_gate::FieldGate;
pub use filter::{Ahrs, AhrsEpoch};
pub use invariant::{ErrorAxes, InvariantFilter, InvariantNoise, error_transition};
pub use measured_attitude::{
    AttitudeInnovation, innovation_n, measured_attitude, roll_pitch_heading,
};
pub use saturation::gyro_range;
pub use settings::{AhrsSettings, FieldSettings, RestSettings};
#[cfg(feature = "std")]
pub use smoother::{Smoother, smooth};
pub use state::{AHRS_BLOCKS, State as AhrsState};
