//! `insnav.noise`: identification of noise, for any linear filter.
//!
//! `arguments` reads what the functions have in common, `als` and `allan` are the functions, `record` looks at a record of an
//! inertial unit, `lag_sums` and `published` take innovations one at a time, `channel` is a design in closed form, `found` hands out
//! what was found and `refusal` why not.

mod allan;
mod als;
mod arguments;
mod channel;
mod found;
mod lag_sums;
mod published;
mod record;
mod refusal;

pub(crate) use allan::{fit_allan, overlapping_allan};
pub(crate) use als::{
    Design, als_design, als_estimate, als_estimate_ltv, als_solve, lag_covariance, mdm_estimate,
};
pub(crate) use channel::ChannelDesign;
pub(crate) use lag_sums::LagAccumulator;
pub(crate) use published::{ForgettingProcessNoise, MohamedSchwarz};
pub(crate) use record::{identify_noise, rest_stability};
