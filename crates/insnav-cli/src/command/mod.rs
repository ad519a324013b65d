//! One file per verb.

mod compare;
mod log_flags;
mod run;
mod settings_flags;

pub(crate) use compare::Compare;
pub(crate) use run::{Outcome, Run};
