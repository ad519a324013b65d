//! Refusals of the core as `insnav.InsnavError`.

use crate::failure::{Failure, class_of_noise, fail};
use insnav_core::noise::Refusal;
use pyo3::prelude::*;

/// The messages of refusals name the remedy where there is one.
pub(super) fn refused(refusal: Refusal) -> Failure {
    let failure =
        Failure::new(code(&refusal), refusal.to_string(), "").of(class_of_noise(&refusal));
    match refusal {
        Refusal::Shape {
            what,
            found,
            expected,
        } => failure.about(what, found, expected),
        Refusal::NotFinite { what } => failure.about(what, "a value that is not finite", "finite"),
        Refusal::Setting {
            what,
            value,
            expected,
        } => failure.about(what, value.to_string(), expected),
        Refusal::UnevenSteps { at_s, .. } => failure.at_s(at_s),
        Refusal::Axis { axis, .. } => failure.measured(axis),
        _ => failure,
    }
}

/// From inside a loop that runs with the interpreter released.
pub(super) fn refusal(e: Refusal) -> PyErr {
    Python::attach(|py| fail(py)(refused(e)))
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
