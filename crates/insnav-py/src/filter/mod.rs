//! `insnav.filter`: the error-state filter with everything inside it.
//!
//! `eskf` is the class; `blocks` finds states by name, `measured` reads what measurements have in common, `linear` is a measurement
//! that the user makes, `told` hands out results.

mod blocks;
mod eskf;
mod gate;
mod linear;
mod measured;
mod noise;
mod told;

pub(crate) use blocks::known_blocks;
pub(crate) use eskf::Eskf;
pub(crate) use gate::Gate;
pub(crate) use noise::{imu_noise, noise_from_data_sheet, noise_of_grade};
