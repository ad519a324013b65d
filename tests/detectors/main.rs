//! Detectors of stops: the four of [Skog10] against their distributions and the table of a study, and what the composite makes of
//! engines, roads, creeping and turning.
//!
//! The study simulated a unit of σ_a = 0.08 m/s² and σ_g = 0.5 °/s at 100 Hz with another program, and states probabilities to
//! two digits. Here its noise is 0.008 m/s/√s and 0.05 °/√s, turned into samples of any rate. Models, all added to it:
//! - idle a + g: sines of 26.7 Hz of these amplitudes on all axes of force and rate, random phases;
//! - road of r: Gaussian noise below 10 Hz (first order) of rms r along Down and half of it along the other two. The study's
//!   roads are not described; its numbers for them are printed and not held;
//! - creep at v: a GNSS velocity of v north with white errors of 0.1 m/s per axis at 1 Hz, on a road of 0.02 m/s² rms.
//!
//! `INSNAV_LONG=1` takes 20 000 windows a case instead of 2000.

mod aliasing;
mod composite;
mod declared;
mod drive;
mod stops;
mod study;
mod unit;
