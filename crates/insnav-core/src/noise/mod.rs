//! Identification of noise: what Q and R a record shows, each with its standard error and a test of the model.
//!
//! A filter with a constant gain leaves innovations whose covariances at all lags are linear in Q and R. Autocovariance least
//! squares (\[Odelson06\], with the weight of \[Rajamani09\]) solves for them; it is a tool for any linear filter, not only for
//! those of this crate. [`als_estimate`] does all of it on a record; its parts are [`lag_covariance`] or the streaming
//! [`LagAccumulator`], [`als_design`] and [`als_solve`]. For models and gains that change there is [`als_estimate_ltv`], without any
//! filter [`mdm_estimate`]. Of a sensor at rest [`overlapping_allan`] and [`fit_allan`] tell the noise by averaging time.
//!
//! Everything with sizes at run time needs `std` (matrices on the heap): all but [`LagAccumulator`], [`ChannelDesign`],
//! [`FixedDesign`], [`MohamedSchwarz`] and [`ForgettingProcessNoise`], which allocate nothing.
//!
//! Covariances are per step of the model, in squared SI units; to a density divide by the step (white noise) or see the model.
//! What it does not do: coloured measurement noise (the fit test tells; the estimate is then not to be used), outliers.

#[cfg(feature = "std")]
mod adaptation;
#[cfg(feature = "std")]
mod allan;
#[cfg(feature = "std")]
mod als;
#[cfg(feature = "std")]
mod attitude_model;
#[cfg(feature = "std")]
mod bartlett;
#[cfg(feature = "std")]
mod basis;
mod channel;
#[cfg(feature = "std")]
mod comparison;
#[cfg(feature = "std")]
mod cone;
#[cfg(feature = "std")]
mod design;
#[cfg(feature = "std")]
mod estimate;
mod fixed_design;
#[cfg(feature = "std")]
mod innovations;
mod lag_accumulator;
#[cfg(feature = "std")]
mod lag_covariance;
#[cfg(feature = "std")]
mod lag_sums;
#[cfg(feature = "std")]
mod ltv;
#[cfg(feature = "std")]
mod mdm;
#[cfg(feature = "std")]
mod model;
mod mohamed_schwarz;
mod monitor;
#[cfg(feature = "std")]
mod record;
#[cfg(feature = "std")]
mod refusal;
#[cfg(feature = "std")]
mod solve;
#[cfg(feature = "std")]
mod stability;
#[cfg(feature = "std")]
mod stored;

#[cfg(feature = "std")]
pub use adaptation::{
    AdaptedNumber, InnovationSums, LagSum, NoiseAdaptation, NoiseSolution, NoiseUnknown,
    NoiseValues, Outcome as AdaptationOutcome, Step as AdaptationStep,
};
#[cfg(feature = "std")]
pub(crate) use adaptation::{Pair, Product};
#[cfg(feature = "std")]
pub use allan::{AllanFit, AllanPoint, AllanTerm, averaging_samples, fit_allan, overlapping_allan};
#[cfg(feature = "std")]
pub use als::{EstimateOptions, Identified, als_estimate};
#[cfg(feature = "std")]
pub use attitude_model::bias_noise_per_step;
#[cfg(feature = "std")]
pub use basis::{Basis, Block, Shape, Unknown};
#[cfg(feature = "std")]
pub use channel::ChannelColumns;
pub use channel::ChannelDesign;
#[cfg(feature = "std")]
pub use comparison::{ForgettingNoise, InnovationWindow};
#[cfg(feature = "std")]
pub use design::{Design, RankReport, als_design};
#[cfg(feature = "std")]
pub use estimate::{Estimate, LARGEST_CHI2_PER_DOF, Verdict};
pub use fixed_design::{FixedDesign, FixedUnknown};
#[cfg(feature = "std")]
pub use innovations::measurements_of_innovations;
pub use lag_accumulator::LagAccumulator;
#[cfg(feature = "std")]
pub use lag_covariance::{LagCovariance, lag_covariance};
#[cfg(feature = "std")]
pub use lag_sums::LagSums;
#[cfg(feature = "std")]
pub use ltv::{Step, als_estimate_ltv};
#[cfg(feature = "std")]
pub use mdm::{MdmOptions, attitude_differences, mdm_estimate};
#[cfg(feature = "std")]
pub use model::{LinearModel, StationaryFilter};
pub use mohamed_schwarz::{ForgettingProcessNoise, MohamedSchwarz};
pub use monitor::{BlockVerdict, ChannelMonitor, ChannelNoise};
#[cfg(feature = "std")]
pub use record::{
    AxisStability, BiasNoise, HeadingNoise, IdentifyOptions, Known, NoiseReading, RecordNoise,
    RestStability, TiltNoise, WindowNoise, identify_noise, rest_stability,
};
#[cfg(feature = "std")]
pub use refusal::Refusal;
#[cfg(feature = "std")]
pub use solve::{Constraint, SolveOptions, Weight, als_solve};
