//! `insnav.Navigator`: the loop itself, sample by sample or in batches.
//!
//! `navigator` is the class, `steps` its methods for one sample, `sample` reads the arguments of one step without allocating, `pending` keeps what has come out, `event`
//! puts events into words.

mod event;
// The class has the name of its folder, as in the core.
#[allow(clippy::module_inception)]
mod navigator;
mod pending;
mod sample;
mod steps;

pub(crate) use navigator::Navigator;
pub(crate) use sample::{stated, three};
