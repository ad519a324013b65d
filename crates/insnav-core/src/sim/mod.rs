//! Simulation with exact truth: where a body went, what its sensors would have said, and how wrong they were.
//!
//! A [`Scenario`] is plain data (drive, inertial unit, receiver); [`Scenario::simulate`] turns it and a seed into a
//! [`Simulation`]: samples in the order of their arrival, and the truth at any instant.
//!
//! ```
//! use insnav_core::sim::Scenario;
//! let simulation = Scenario::standing(10.0, 45.0).simulate(1)?;
//! let last = simulation.samples.last().expect("ten seconds of data");
//! let truth = simulation.truth_at(last.time());
//! assert!((truth.nav.q_nb.euler_angles().2.to_degrees() - 45.0).abs() < 1e-9);
//! # Ok::<(), insnav_core::error::Error>(())
//! ```

mod adis16405;
mod attitude_trial;
mod carried;
mod drift_trial;
mod drive;
mod gnss;
mod imu;
mod navigation_drive;
mod navigation_trial;
mod noise;
mod quadrature;
mod range;
mod rocking;
mod scenario;
mod simulation;
mod stop_trial;
mod trajectory;

pub use adis16405::{ADIS16405_STEP_S, AttitudeCase, AttitudeRecord, AttitudeSample};
pub use attitude_trial::{AttitudeErrors, AttitudePoint, AttitudeTrial, AttitudeVariant};
pub use drift_trial::{DriftCase, DriftErrors, DriftPoint, DriftTrial, DriftVariant, SwayPoint};
pub use drive::{Body, BodyRocking, Drive, Leg, Wave};
pub use gnss::{GnssModel, Span};
pub use imu::{ImuErrorModel, ImuModel, ImuOutput};
pub use navigation_drive::NavigationDrive;
pub use navigation_trial::{ErrorAt, NavigationOutcome, StopUse};
pub use noise::{GaussMarkov, Source, Stream};
pub use rocking::{BodyTurn, Rocking, RockingErrors, RockingTone, to_increments};
pub use scenario::Scenario;
pub use simulation::{Simulation, Truth};
pub use stop_trial::{
    HeadingPoint, Leap, MeanSquares, StaticRecord, StopEndErrors, StopErrors, StopFlags,
    StopSetting, StopTrial, StopVariant, Turning,
};
pub use trajectory::{Kinematics, Trajectory};
