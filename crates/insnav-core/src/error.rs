//! The one error type of the core: every variant says when, what, and the number that shows the cause.

use crate::time::Time;

/// Why a call to the core failed. A rejected measurement is a verdict, not an error.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An inertial stamp not after its predecessor.
    #[error(
        "IMU stamp {time} is not after {previous}: drop duplicates and sort before, or lengthen the delay"
    )]
    ImuBackward {
        /// Stamp of the sample before.
        previous: Time,
        /// The offending stamp.
        time: Time,
    },
    /// A sample with NaN or infinity in it.
    #[error("{what} at {time} is not finite")]
    NotFinite {
        /// Which quantity.
        what: &'static str,
        /// When.
        time: Time,
    },
    /// A covariance that is not positive definite.
    #[error(
        "{measurement} at {time}: innovation covariance is not positive definite (pivot {pivot:e})"
    )]
    NotPositiveDefinite {
        /// Name of the measurement.
        measurement: &'static str,
        /// When.
        time: Time,
        /// The pivot of the Cholesky factorisation that was not positive.
        pivot: f64,
    },
    /// A setting outside its range.
    #[error("{key} = {value}: must be {expected}")]
    Config {
        /// The key as in the configuration file.
        key: &'static str,
        /// What was given.
        value: f64,
        /// What is allowed.
        expected: &'static str,
    },
    /// An optional state was opened beyond the capacity of the filter.
    #[error("no room for state block {name}: {active} states are open, capacity is {capacity}")]
    Capacity {
        /// Name of the block.
        name: &'static str,
        /// States open now.
        active: usize,
        /// The most that fit.
        capacity: usize,
    },
    /// The log ended before the navigator could start.
    #[error("the log ended before the start: {missing}")]
    NotStarted {
        /// What was missing.
        missing: &'static str,
    },
    /// Too little information to estimate a quantity.
    #[error("cannot estimate {what}: {reason}")]
    NotObservable {
        /// The quantity.
        what: &'static str,
        /// Why not.
        reason: &'static str,
    },
    /// An alignment from stops is refused.
    #[cfg(feature = "std")]
    #[error(transparent)]
    Alignment(#[from] crate::alignment::Refusal),
}

/// Result with the core's [`Error`].
pub type Result<T> = core::result::Result<T, Error>;
