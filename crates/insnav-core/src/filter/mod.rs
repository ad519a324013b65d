//! The error-state filter.

mod update;

pub use update::{Update, Verdict};
