//! Inertial navigation aided by GNSS, with honest uncertainty: one crate to `cargo add`.
//!
//! This is a façade: everything numerical lives in [`insnav_core`], everything that reads or writes a log in [`log`]
//! (feature `log`, on by default). Conventions (frames, signs, units) are stated once, in CONVENTIONS.md.

#![cfg_attr(not(feature = "std"), no_std)]

pub use insnav_core::*;

#[cfg(feature = "log")]
pub use insnav_log as log;

/// The examples of the README, compiled.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
