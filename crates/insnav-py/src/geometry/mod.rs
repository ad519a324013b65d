//! `insnav.earth`, `insnav.attitude` and `insnav.mechanization`: the core's functions over rows of arrays.
//!
//! `rows` is how a function of one row becomes one of arrays of any shape; the others name the functions.

pub(crate) mod attitude;
pub(crate) mod earth;
pub(crate) mod mechanization;
pub(crate) mod nav_state;
pub(crate) mod rows;
