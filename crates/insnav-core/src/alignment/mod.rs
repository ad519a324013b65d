//! Alignment: attitude before there is one.

#[cfg(feature = "std")]
mod antenna;
#[cfg(feature = "std")]
mod course;
#[cfg(feature = "std")]
mod first_fix;
#[cfg(feature = "std")]
mod levelling;
#[cfg(feature = "std")]
mod magnetic;
#[cfg(feature = "std")]
mod moving_base;
#[cfg(feature = "std")]
mod rest;
#[cfg(feature = "std")]
mod single_source;
#[cfg(feature = "std")]
mod startup;
#[cfg(feature = "std")]
mod stops;
#[cfg(feature = "std")]
mod tied;
#[cfg(feature = "std")]
mod track;

#[cfg(feature = "std")]
pub use magnetic::EARTH_FIELD;
#[cfg(feature = "std")]
pub use moving_base::MovingBase;
#[cfg(feature = "std")]
pub use single_source::{
    MagneticStart, MovingBaseOptions, level_from_force, magnetic_start, moving_base_start,
};
#[cfg(feature = "std")]
pub use startup::Startup;
#[cfg(feature = "std")]
pub use stops::{
    AlignmentMethod, AlignmentOptions, AlignmentResult, BeforeStop, FusedStop, Record, Refusal,
    StopReport, StopWindow, Taper, align, fuse_stop, rate_limit,
};

use crate::filter::InitialSigma;
use crate::imu::ImuErrors;
use crate::mechanization::NavState;
use crate::time::Time;
use nalgebra::SMatrix;
use serde::{Deserialize, Serialize};

/// Where the heading of a start came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum HeadingSource {
    /// Course of GNSS velocities.
    CourseVelocity,
    /// Course of GNSS positions.
    CoursePosition,
    /// Given by the user.
    Given,
    /// The gyros, which felt the Earth turn while the body stood.
    Gyrocompass,
    /// Heading of two antennas.
    Antenna,
    /// GNSS velocities and specific force, whichever way the vehicle looks.
    MovingBase,
    /// A magnetometer.
    Magnetic,
    /// None: heading is unknown, its sigma that of a uniform distribution.
    Unknown,
    /// None, and none is needed: headings count from that at the start, whose sigma is zero by definition.
    Relative,
}

/// A start: state at the first inertial sample, its sigmas, and where they came from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Alignment {
    /// State at the first inertial sample.
    pub nav: NavState,
    /// Sensor errors known from standing at the start; zero otherwise.
    pub imu_errors: ImuErrors,
    /// Standard deviations of all that.
    pub sigma: InitialSigma,
    /// Covariance of attitude (small rotation in n), gyro bias and accelerometer bias, in this order: what levels a start is wrong by
    /// what the accelerometers are.
    pub covariance: SMatrix<f64, 9, 9>,
    /// Seconds of standing data that levelled the start; 0 when it was levelled in motion.
    pub standing_s: f64,
    /// Where the heading came from.
    pub heading_source: HeadingSource,
    /// When the heading became known (the run itself begins at the first sample).
    pub heading_at: Time,
    /// Before this instant nothing says whether the mean rates are biases or a slow turn: they changed where the inertial data
    /// alone had to show rest. `None` where they were steady.
    pub rates_doubtful_until: Option<Time>,
    /// True when the vehicle was found to drive backwards where its course was taken.
    pub reversing: bool,
}
