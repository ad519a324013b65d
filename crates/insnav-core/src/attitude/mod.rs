//! Attitude: rotation vectors, quaternions and Euler angles.
//!
//! `q_nb` turns body components into navigation components, `v_n = q_nb * v_b`; letters cancel.

mod euler;
mod so3;

pub use euler::{Euler, wrap_angle};
pub use so3::{exp, exp_level, left_jacobian, left_jacobian_times, log, log_level, skew};
