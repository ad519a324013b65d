//! `insnav.sim`: scenarios, simulated drives, random sources.

mod papers;
mod scenario;
mod sources;
mod truth;

pub(crate) use papers::{belokurov2018, kozadaev2017, lobusov2014};
pub(crate) use scenario::Scenario;
pub(crate) use sources::{gauss_markov, white_noise};
