//! Noise of a running navigation filter, from its own innovations: autocovariance least squares with models and gains that
//! change at every step.
//!
//! The unknowns are the white noise of gyros and accelerometers and factors on the sigmas of GNSS positions and velocities. The
//! filter's [`Shares`](crate::filter::Shares) carry what each of them adds to the covariance of the error along the real
//! transitions and gains, and from it what each adds to the covariance of any two innovations (\[Lima11\]). Here these are compared
//! with the products of the innovations themselves ([`InnovationSums`]), and [`NoiseAdaptation`] says what is used next: a run with the
//! prior, another with what it showed, a third and fourth if that still moves, and in the end what is accepted.
//!
//! Innovations are divided by the root of the S that the filter believes in. At the true noise they are white and of variance one,
//! whatever changes meanwhile, so that the best weight of a product is known beforehand (½ for squares, 1 for all others), every
//! product is compared with its own prediction, and a run leaves four normal equations instead of matrices for all lags.

mod rounds;
mod sums;

pub use rounds::{AdaptedNumber, NoiseAdaptation, NoiseValues, Outcome, Step};
pub use sums::{InnovationSums, LagSum, NoiseSolution};
pub(crate) use sums::{Pair, Product};

/// What is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum NoiseUnknown {
    /// White noise of the gyros.
    Gyro,
    /// White noise of the accelerometers.
    Accel,
    /// Errors of GNSS positions.
    Position,
    /// Errors of GNSS velocities.
    Velocity,
}

impl NoiseUnknown {
    /// All of them, in the order in which they stand everywhere.
    pub const ALL: [NoiseUnknown; 4] = [
        NoiseUnknown::Gyro,
        NoiseUnknown::Accel,
        NoiseUnknown::Position,
        NoiseUnknown::Velocity,
    ];
    /// How many there are.
    pub const COUNT: usize = Self::ALL.len();
}
