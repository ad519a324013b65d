//! The navigation core of insnav.
#![cfg_attr(not(feature = "std"), no_std)]

pub mod alignment;
pub mod attitude;
#[cfg(feature = "std")]
pub mod clock_offset;
pub mod config;
pub mod earth;
pub mod error;
pub mod filter;
pub mod imu;
pub mod measurement;
pub mod mechanization;
#[cfg(feature = "std")]
pub mod metrics;
pub mod navigator;
pub mod sample;
#[cfg(feature = "std")]
pub mod sim;
pub mod solution;
pub mod stationary;
pub mod time;
