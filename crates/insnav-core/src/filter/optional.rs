//! How the optional states change by themselves, and what they do to the motion.

use super::dynamics::GaussMarkov;
use super::held::mirror_held;
use super::layout::{ACCEL_BIAS, ACCEL_SCALE, BLOCKS, Block, GYRO_BIAS, GYRO_SCALE, Layout};
use super::transition::Transition;
use crate::imu::ImuErrors;
use crate::mechanization::{Increment, Interval};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// First-order Gauss–Markov processes of the states of a block: `sigma` at the start and for ever after, correlation time
/// `tau` in seconds. An infinite `tau` is a constant of which `sigma` is known at the start.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Process {
    /// Standard deviation of each state, in the unit of the block; those beyond its size are not used.
    pub sigma: Vector3<f64>,
    /// Correlation time, s.
    pub tau: f64,
}

impl Process {
    /// A constant that is known to `sigma`.
    pub fn constant(sigma: f64) -> Self {
        Process {
            sigma: Vector3::repeat(sigma),
            tau: f64::INFINITY,
        }
    }
}

/// One process for each block; those of the base blocks are not used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Processes([Process; BLOCKS.len()]);

impl Default for Processes {
    fn default() -> Self {
        Processes([Process::constant(0.0); BLOCKS.len()])
    }
}

impl Processes {
    /// Give a block its process.
    pub fn set<const N: usize>(&mut self, block: Block<N>, process: Process) {
        self.0[block.id()] = process;
    }
}

/// Add to Φ and Q of an interval what belongs to the optional blocks that are open. Comes after `fill_base`.
///
/// A scale factor error s turns a rate ω into (1 + s) ω, so that its error turns the attitude by −C diag(ω) ds/(1 + s), and
/// likewise the velocity.
pub fn fill_optional(
    phi: &mut Transition,
    layout: &Layout,
    interval: &Interval,
    increment: &Increment,
    errors: &ImuErrors,
    processes: &Processes,
) {
    let inverse = |scale: &Vector3<f64>| scale.map(|s| 1.0 / (1.0 + s));
    let (gyro, accel) = (inverse(&errors.gyro_scale), inverse(&errors.accel_scale));
    let minus_axes_by = |x: &Vector3<f64>| -interval.axes_n * Matrix3::from_diagonal(x);
    if layout.has(GYRO_SCALE) {
        let rotation = increment.rotation_b.component_mul(&gyro);
        phi.attitude
            .put(layout, GYRO_SCALE, &minus_axes_by(&rotation));
    }
    if layout.has(ACCEL_SCALE) {
        let velocity = increment.velocity_b.component_mul(&accel);
        phi.velocity
            .put(layout, ACCEL_SCALE, &minus_axes_by(&velocity));
    }
    if errors.has_scale() {
        // The bias is part of what is divided by the scale: what `fill_base` put, made whole.
        let beyond_one = |x: &Vector3<f64>| x.add_scalar(-1.0) * interval.dt;
        phi.attitude
            .put(layout, GYRO_BIAS, &minus_axes_by(&beyond_one(&gyro)));
        phi.velocity
            .put(layout, ACCEL_BIAS, &minus_axes_by(&beyond_one(&accel)));
    }
    mirror_held(&mut phi.velocity, layout);
    mirror_held(&mut phi.attitude, layout);
    fill_processes(phi, layout, interval.dt, processes);
}

/// Decay and noise of the optional blocks that are open over `dt` seconds.
pub(super) fn fill_processes(
    phi: &mut Transition,
    layout: &Layout,
    dt: f64,
    processes: &Processes,
) {
    for (id, range) in layout.optional_ranges() {
        let process = &processes.0[id];
        let unit = GaussMarkov::over(dt, 1.0, process.tau);
        for (i, sigma) in range.zip(process.sigma.iter()) {
            (phi.decay[i], phi.noise[i]) = (unit.decay, sigma * sigma * unit.variance);
        }
    }
}
