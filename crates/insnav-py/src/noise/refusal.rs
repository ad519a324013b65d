//! Refusals of the core as `insnav.InsnavError`.

use crate::failure::Failure;
use insnav_core::noise::Refusal;

/// The messages of refusals name the remedy where there is one.
pub(super) fn refused(refusal: Refusal) -> Failure {
    Failure::new(code(&refusal), refusal.to_string(), "")
}

/// A short name, the same as the command's where it has one.
fn code(refusal: &Refusal) -> &'static str {
    match refusal {
        Refusal::Shape { .. } => "wrong_shape",
        Refusal::NotFinite { .. } => "not_finite",
        Refusal::Setting { .. } => "bad_option",
        Refusal::Unstable { .. } | Refusal::NoStationaryFilter { .. } => "unstable_filter",
        Refusal::RankDeficient { .. } => "rank_deficient",
        Refusal::TooShort { .. } => "too_short",
        Refusal::Flat { .. } | Refusal::Repeats { .. } => "flat_channel",
        Refusal::Saturated { .. } => "saturated_channel",
        Refusal::Axis { why, .. } => code(why),
        Refusal::UnevenSteps { .. } => "uneven_steps",
        _ => "noise_not_identifiable",
    }
}
