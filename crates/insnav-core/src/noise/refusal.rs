//! Why an identification of noise is refused.

use std::boxed::Box;
use std::string::String;
use std::vec::Vec;

/// Why noise cannot be identified. Every variant names what it is about and what to change.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// Matrices or data that do not fit together.
    #[error("{what} is {found}, expected {expected}")]
    Shape {
        /// Which argument.
        what: &'static str,
        /// Its size.
        found: String,
        /// The size that fits.
        expected: String,
    },
    /// A matrix or a measurement with NaN or infinity in it.
    #[error("{what} has a value that is not finite")]
    NotFinite {
        /// Which argument.
        what: &'static str,
    },
    /// A setting outside its range.
    #[error("{what} = {value}: must be {expected}")]
    Setting {
        /// Which setting.
        what: &'static str,
        /// What was given.
        value: f64,
        /// What is allowed.
        expected: &'static str,
    },
    /// F (I − L H) has an eigenvalue on or outside the unit circle: its innovations have no stationary covariance.
    #[error(
        "the closed loop F (I - L H) is not stable (spectral radius {spectral_radius:.6}): give a stabilising gain"
    )]
    Unstable {
        /// Largest magnitude of its eigenvalues.
        spectral_radius: f64,
    },
    /// No gain makes the filter's error stationary, or the covariances given are not positive.
    #[error("no stationary filter exists for this model and this noise: {reason}")]
    NoStationaryFilter {
        /// What is in the way.
        reason: &'static str,
    },
    /// The covariances cannot tell all unknowns apart.
    #[error(
        "only {rank} of {unknowns} unknowns can be told from these lags; not {}: give these as known, or take a basis with fewer", undetermined.join(", ")
    )]
    RankDeficient {
        /// How many independent combinations are determined.
        rank: usize,
        /// How many were asked for.
        unknowns: usize,
        /// Those that are not determined.
        undetermined: Vec<String>,
    },
    /// Fewer than the least number of independent products at some lag.
    #[error(
        "lag {lag} has {count} products, of which {independent:.1} are independent; at least {least} are needed: use a longer record or fewer lags"
    )]
    TooShort {
        /// The lag.
        lag: usize,
        /// Products there are.
        count: usize,
        /// Products divided by the correlation time of their factors.
        independent: f64,
        /// The least that is accepted.
        least: f64,
    },
    /// A channel that has next to no values.
    #[error(
        "channel {channel} takes only {distinct} values: it is switched off, or too coarse for its noise to be seen"
    )]
    Flat {
        /// Which component of the measurement.
        channel: usize,
        /// How many values it takes.
        distinct: usize,
    },
    /// A channel that hardly ever changes.
    #[error(
        "{percent:.0} % of its samples repeat the one before: its steps are coarser than its noise, or it comes at a lower rate"
    )]
    Repeats {
        /// How often, %.
        percent: f64,
    },
    /// A channel that stays at the end of its range.
    #[error(
        "channel {channel} is at {value} in {percent:.1} % of its samples, the end of its range: leave these stretches out"
    )]
    Saturated {
        /// Which component of the measurement.
        channel: usize,
        /// The value.
        value: f64,
        /// How often, %.
        percent: f64,
    },
    /// One axis of an inertial record cannot be used.
    #[error("{axis}: {why}")]
    Axis {
        /// Which one.
        axis: &'static str,
        /// Why.
        why: Box<Refusal>,
    },
    /// Samples that are not at equal steps, by more than jitter.
    #[error(
        "the steps between samples are not equal: {percent:.1} % of them are more than a quarter off {step_s} s, first at {at_s:.3} s ({found_s:.4} s): the stamps are not those of the sensor, take those of the other clock"
    )]
    UnevenSteps {
        /// Where it begins, s.
        at_s: f64,
        /// The step there, s.
        found_s: f64,
        /// The usual step, s.
        step_s: f64,
        /// Share of such steps, %.
        percent: f64,
    },
    /// A weight or a model covariance that cannot be inverted.
    #[error("{what} is not positive definite: {remedy}")]
    NotPositiveDefinite {
        /// Which matrix.
        what: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// An iteration that did not come to its end.
    #[error("{what} did not converge in {iterations} steps")]
    NotConverged {
        /// Which one.
        what: &'static str,
        /// After how many.
        iterations: usize,
    },
}
