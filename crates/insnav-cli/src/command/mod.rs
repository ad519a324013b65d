//! One file per verb.

mod ahrs;
mod align;
mod compare;
mod completions;
mod convert;
mod demo;
mod info;
mod log_flags;
mod noise;
mod reproduce;
mod run;
mod run_inputs;
mod settings_flags;
mod simulate;

pub(crate) use ahrs::{Ahrs, Oriented};
pub(crate) use align::Align;
pub(crate) use compare::Compare;
pub(crate) use completions::{Completions, Man};
pub(crate) use convert::Convert;
pub(crate) use demo::{Demo, DemoReport};
pub(crate) use info::{Info, LogReport, RunPreview, SeenBy, TopicReport};
pub(crate) use noise::Noise;
pub(crate) use reproduce::{Reproduce, belokurov2018, kozadaev2017, lobusov2014};
pub(crate) use run::{Outcome, Run};
pub(crate) use simulate::{Simulate, Simulated};
