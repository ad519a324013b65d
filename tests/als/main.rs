//! Autocovariance least squares: design, exactness, efficiency, honesty of its standard errors, and refusals.
//!
//! Statistical bounds hold for the numbers of seeds beside them; `INSNAV_LONG=1` runs as many as they were set for.

mod attitude_channel;
mod design;
mod foreign;
mod refusals;
mod time_varying;
mod unit;
