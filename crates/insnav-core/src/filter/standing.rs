//! How the errors change while the body stands.

use super::dynamics::fill_biases;
use super::eskf::Eskf;
use super::layout::{ATTITUDE, GYRO_BIAS, GYRO_SCALE, VELOCITY};
use super::optional::fill_processes;
use crate::attitude::exp;
use crate::config::StandingForce;
use crate::earth::earth_rate_n;
use crate::mechanization::Increment;
use crate::time::Time;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// How a body that stands moves all the same: random walks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Settling {
    /// Of the attitude, each axis, rad/√s.
    pub attitude: f64,
    /// Of the position, each axis, m/√s.
    pub position: f64,
}

impl Eskf {
    /// Move over one raw increment of a body that stands.
    ///
    /// The strapdown goes on as ever. What the errors see of the specific force is −g, what a body at rest feels: the noise of
    /// the measured one would make the heading observable, which it is not. (At 0.08 m/s² of noise a heading known to 12° would
    /// be told as known to 3° after five minutes.)
    pub fn propagate_standing(&mut self, raw: &Increment, force: StandingForce) {
        self.settle();
        #[cfg(feature = "std")]
        if let Some(shares) = &mut self.shares {
            shares.stand(raw.time);
        }
        match force {
            StandingForce::Gravity => self.advance(raw, |interval| {
                interval.specific_force_n = Vector3::new(0.0, 0.0, -interval.earth.gravity());
            }),
            StandingForce::Measured => self.advance(raw, |_| {}),
        }
        self.settle();
    }

    /// Stay where the body is until `time`: position and attitude constant but for a small random walk, velocity zero. The
    /// errors are carried on by `dt`, which may lie behind.
    pub fn stay(&mut self, time: Time, dt: f64, settling: &Settling) {
        self.settle();
        self.nominal.nav.time = time;
        self.nominal.nav.velocity_n = Vector3::zeros();
        self.nominal.acceleration_n = Vector3::zeros();
        let earth_rate_n = earth_rate_n(self.nominal.nav.position.latitude);
        self.nominal.rate_b = self
            .nominal
            .nav
            .q_nb
            .inverse_transform_vector(&earth_rate_n);
        if dt <= 0.0 {
            return;
        }
        let phi = &mut self.phi;
        phi.position.clear();
        phi.velocity.clear();
        phi.attitude.clear();
        fill_biases(phi, &self.noise, dt);
        for a in 0..3 {
            phi.noise[a] = settling.position * settling.position * dt;
            phi.noise[3 + a] = 0.0;
            phi.noise[6 + a] = settling.attitude * settling.attitude * dt;
        }
        fill_processes(phi, self.covariance.layout(), dt, &self.processes);
        #[cfg(feature = "std")]
        if let Some(shares) = &mut self.shares {
            shares.stay(&self.phi, &self.covariance, time);
        }
        self.covariance.propagate(&self.phi);
        // The position's noise has no place in the dynamics under way.
        self.phi.noise[..3].fill(0.0);
        self.decay();
    }

    /// Forget what the velocity has to do with anything else, and say how well it is known, m/s.
    pub fn forget_velocity(&mut self, sigma: f64) {
        self.settle();
        let prior = Matrix3::from_diagonal_element(sigma * sigma);
        #[cfg(feature = "std")]
        if let Some(shares) = &mut self.shares {
            shares.forget(VELOCITY, &prior);
        }
        self.covariance.set_prior(VELOCITY, &prior);
    }

    /// Turn the body by a rotation seen by the gyros over `dt` seconds, b axes, with the errors that their noise, bias and scale
    /// factors bring.
    pub fn turn(&mut self, rotation_b: &Vector3<f64>, dt: f64) {
        self.settle();
        let earth_rate_n = earth_rate_n(self.nominal.nav.position.latitude);
        let to_n = self.nominal.nav.q_nb.to_rotation_matrix().into_inner();
        let q = exp(&(earth_rate_n * -dt)) * self.nominal.nav.q_nb * exp(rotation_b);
        self.nominal.nav.q_nb = q;
        self.nominal.nav.q_nb.renormalize_fast();
        let phi = &mut self.phi;
        phi.position.clear();
        phi.velocity.clear();
        phi.attitude.clear();
        // As on the way: both act through what the gyros showed, scaled back.
        let inverse = self.nominal.imu_errors.gyro_scale.map(|s| 1.0 / (1.0 + s));
        let to_n = to_n * Matrix3::from_diagonal(&inverse);
        let layout = self.covariance.layout();
        phi.attitude.put(layout, GYRO_BIAS, &(to_n * -dt));
        let by_scale = to_n * Matrix3::from_diagonal(&-rotation_b);
        phi.attitude.put(layout, GYRO_SCALE, &by_scale);
        phi.noise.fill(0.0);
        phi.decay.fill(1.0);
        let at = self.covariance.layout().range(ATTITUDE);
        for i in at.into_iter().flatten() {
            phi.noise[i] = self.noise.gyro_white * self.noise.gyro_white * dt;
        }
        #[cfg(feature = "std")]
        if let Some(shares) = &mut self.shares {
            shares.stay(&self.phi, &self.covariance, self.nominal.nav.time);
        }
        self.covariance.propagate(&self.phi);
    }
}
