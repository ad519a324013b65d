//! The error-state filter: named states, covariance kernel, dynamics, closed loop, gate.

mod columns;
mod covariance;
mod dynamics;
mod eskf;
#[cfg(feature = "std")]
mod fused;
mod gate;
mod held;
mod layout;
mod nominal;
mod optional;
#[cfg(feature = "std")]
mod shares;
mod standing;
mod transition;
mod update;

pub use columns::{Columns, States, part};
pub use covariance::{Covariance, Innovation};
pub use dynamics::{GaussMarkov, fill_base};
pub use eskf::{COVARIANCE_STEP, Eskf, InitialSigma, Linearized, Measurement};
pub use gate::Gate;
pub use layout::{
    ACCEL_BIAS, ACCEL_SCALE, ATTITUDE, AXLE, BASE, BLOCKS, Block, BlockInfo, CAPACITY,
    CLOCK_OFFSET, GNSS_COLOUR, GYRO_BIAS, GYRO_SCALE, HELD_ATTITUDE, HELD_HEADING, LEVER_ARM,
    Layout, MOUNTING, ODOMETER_SCALE, POSITION, VELOCITY,
};
pub use nominal::{Calibration, Nominal};
pub use optional::{Process, Processes, fill_optional};
#[cfg(feature = "std")]
pub use shares::Shares;
pub use standing::Settling;
pub use transition::Transition;
pub use update::{Update, Verdict};
