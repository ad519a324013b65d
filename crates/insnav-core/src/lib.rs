//! The navigation core of insnav: inertial samples and GNSS fixes in, position, velocity and attitude with their covariance out.
//!
//! Start at [`navigator::Navigator`]: give it [`sample::Sample`]s one by one, take [`solution::Epoch`]s at a [`solution::Sink`]. The
//! parts below it are usable alone: geodesy ([`earth`]), rotations ([`attitude`]), strapdown integration ([`mechanization`]), the
//! error-state filter and its covariance kernel ([`filter`]).
//!
//! What it does not do: read or write files, print, ask the time, start threads, or use GNSS raw data (it is loosely coupled: positions
//! and velocities as a receiver gives them).
//!
//! Frames are north-east-down and forward-right-down, units SI and radians, `true = estimate ⊞ dx`. Without the default feature `std`
//! the crate is `no_std` (choose `libm`), allocates nothing, and begins at a known state ([`navigator::Navigator::aligned`]).
#![cfg_attr(not(feature = "std"), no_std)]

pub mod ahrs;
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
pub mod noise;
#[cfg(feature = "std")]
pub mod noise_floor;
pub mod sample;
#[cfg(feature = "std")]
pub mod sim;
pub mod solution;
pub mod stationary;
pub mod time;
#[cfg(feature = "std")]
pub mod wheeled;
