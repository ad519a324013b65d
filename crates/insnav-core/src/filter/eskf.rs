//! The error-state Kalman filter: nominal state, covariance, and the closed loop between them.

use super::columns::{Columns, States, part};
use super::covariance::Covariance;
use super::dynamics::fill_base;
use super::gate::Gate;
use super::layout::{ACCEL_BIAS, ATTITUDE, CAPACITY, GYRO_BIAS, Layout, POSITION, VELOCITY};
use super::transition::Transition;
use super::update::{Update, Verdict};
use crate::attitude::{exp, log};
use crate::error::{Error, Result};
use crate::imu::{ImuErrors, ImuNoise};
use crate::mechanization::{Increment, NavState};
use crate::time::Time;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use serde::{Deserialize, Serialize};

/// What a measurement model may look at.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Nominal {
    /// Position, velocity, attitude, time.
    pub nav: NavState,
    /// Angular rate of the body against inertial space with its bias taken out, resolved in b, rad/s.
    pub rate_b: Vector3<f64>,
    /// Sensor errors as estimated.
    pub imu_errors: ImuErrors,
}

impl Nominal {
    /// ⊞: the truth, if the estimate is `self` and the error is `dx`. This defines every sign in the filter.
    #[must_use]
    pub fn retract(&self, layout: &Layout, dx: &States) -> Self {
        let of = |block| part(layout, dx, block).unwrap_or_else(Vector3::zeros);
        let mut q_nb = exp(&of(ATTITUDE)) * self.nav.q_nb;
        q_nb.renormalize_fast();
        let gyro_bias = of(GYRO_BIAS);
        Nominal {
            nav: NavState {
                time: self.nav.time,
                position: self.nav.position.offset(&of(POSITION)),
                velocity_n: self.nav.velocity_n + of(VELOCITY),
                q_nb,
            },
            // What the gyro measured stays; only the bias taken from it changes.
            rate_b: self.rate_b - gyro_bias,
            imu_errors: ImuErrors {
                gyro_bias: self.imu_errors.gyro_bias + gyro_bias,
                accel_bias: self.imu_errors.accel_bias + of(ACCEL_BIAS),
            },
        }
    }

    /// ⊟: the error of `self` if `truth` is the truth, the inverse of [`Nominal::retract`] for the base states; zero for all
    /// others.
    pub fn local(&self, layout: &Layout, truth: &Nominal) -> States {
        let mut dx = [0.0; CAPACITY];
        let errors = [
            (POSITION, self.nav.position.offset_to(&truth.nav.position)),
            (VELOCITY, truth.nav.velocity_n - self.nav.velocity_n),
            (ATTITUDE, log(&(truth.nav.q_nb * self.nav.q_nb.inverse()))),
            (
                GYRO_BIAS,
                truth.imu_errors.gyro_bias - self.imu_errors.gyro_bias,
            ),
            (
                ACCEL_BIAS,
                truth.imu_errors.accel_bias - self.imu_errors.accel_bias,
            ),
        ];
        for (block, error) in errors {
            if let Some(range) = layout.range(block) {
                dx[range].copy_from_slice(error.as_slice());
            }
        }
        dx
    }
}

/// A measurement model at one estimate: residual, its derivative by the error states, and its noise.
#[derive(Clone, Copy, Debug)]
pub struct Linearized<const M: usize> {
    /// Measured minus predicted.
    pub residual: SVector<f64, M>,
    /// residual ≈ H dx + v.
    pub h: Columns<M>,
    /// Covariance of v.
    pub r: SMatrix<f64, M, M>,
}

/// A measurement model with `M` components: pure, no memory.
pub trait Measurement<const M: usize> {
    /// Name in reports and configuration.
    fn name(&self) -> &'static str;
    /// Residual, H and R at an estimate.
    fn linearize(&self, at: &Nominal, layout: &Layout) -> Linearized<M>;
}

/// Standard deviations of a start, one number for each axis of a block.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct InitialSigma {
    /// NED, m.
    pub position: Vector3<f64>,
    /// NED, m/s.
    pub velocity: Vector3<f64>,
    /// Small rotation about north, east, down, rad.
    pub attitude: Vector3<f64>,
    /// Body, rad/s.
    pub gyro_bias: Vector3<f64>,
    /// Body, m/s².
    pub accel_bias: Vector3<f64>,
}

/// Error-state Kalman filter of a strapdown INS: 15 base states and the optional blocks of its layout.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Eskf {
    nominal: Nominal,
    covariance: Covariance,
    noise: ImuNoise,
    #[serde(skip)]
    phi: Transition,
}

impl Eskf {
    /// Start from a state with independent errors.
    pub fn new(
        nav: NavState,
        imu_errors: ImuErrors,
        sigma: &InitialSigma,
        noise: ImuNoise,
    ) -> Self {
        let mut covariance = Covariance::default();
        let square = |s: &Vector3<f64>| Matrix3::from_diagonal(&s.component_mul(s));
        covariance.set_prior(POSITION, &square(&sigma.position));
        covariance.set_prior(VELOCITY, &square(&sigma.velocity));
        covariance.set_prior(ATTITUDE, &square(&sigma.attitude));
        covariance.set_prior(GYRO_BIAS, &square(&sigma.gyro_bias));
        covariance.set_prior(ACCEL_BIAS, &square(&sigma.accel_bias));
        let nominal = Nominal {
            nav,
            rate_b: Vector3::zeros(),
            imu_errors,
        };
        Eskf {
            nominal,
            covariance,
            noise,
            phi: Transition::default(),
        }
    }

    /// The estimate.
    pub fn nominal(&self) -> &Nominal {
        &self.nominal
    }

    /// Its covariance.
    pub fn covariance(&self) -> &Covariance {
        &self.covariance
    }

    /// The covariance, to open and close optional blocks.
    pub fn covariance_mut(&mut self) -> &mut Covariance {
        &mut self.covariance
    }

    /// Noise of the inertial unit.
    pub fn noise(&self) -> &ImuNoise {
        &self.noise
    }

    /// Move over one raw increment (sensor errors still inside).
    pub fn propagate(&mut self, raw: &Increment) {
        if raw.dt <= 0.0 {
            return;
        }
        let errors = &mut self.nominal.imu_errors;
        let increment = raw.corrected(&errors.gyro_bias, &errors.accel_bias);
        self.nominal.rate_b = increment.rotation_b / raw.dt;
        let interval = self.nominal.nav.advance(&increment);
        fill_base(
            &mut self.phi,
            self.covariance.layout(),
            &interval,
            &self.noise,
        );
        self.covariance.propagate(&self.phi);
        // The biases decay as their errors do.
        let layout = self.covariance.layout();
        let decays = [
            (&mut errors.gyro_bias, GYRO_BIAS),
            (&mut errors.accel_bias, ACCEL_BIAS),
        ];
        for (bias, block) in decays {
            if let Some(decay) = part(layout, &self.phi.decay, block) {
                bias.component_mul_assign(&decay);
            }
        }
    }

    /// Widen the uncertainty for a stretch of `dt` seconds in which nobody saw what the body did: rate and specific force
    /// wrong by the given sigmas (rad/s, m/s²) all along.
    pub fn bridge(&mut self, dt: f64, rate_sigma: f64, force_sigma: f64) {
        let eye = |s: f64| Matrix3::from_diagonal_element(s * s);
        self.covariance
            .add(POSITION, &eye(0.5 * force_sigma * dt * dt));
        self.covariance.add(VELOCITY, &eye(force_sigma * dt));
        self.covariance.add(ATTITUDE, &eye(rate_sigma * dt));
    }

    /// Weigh a measurement and, if the gate lets it, use it.
    ///
    /// # Errors
    /// `NotPositiveDefinite` when the innovation covariance is none, as with a NaN in the measurement or a negative variance.
    pub fn update<const M: usize>(
        &mut self,
        measurement: &impl Measurement<M>,
        time: Time,
        gate: &mut Gate,
    ) -> Result<Update> {
        const { assert!(M >= 1 && M <= 3) };
        let Linearized { residual, h, mut r } =
            measurement.linearize(&self.nominal, self.covariance.layout());
        let refuse = |pivot| Error::NotPositiveDefinite {
            measurement: measurement.name(),
            time,
            pivot,
        };
        if !residual.iter().all(|x| x.is_finite()) {
            return Err(Error::NotFinite {
                what: measurement.name(),
                time,
            });
        }
        let mut innovation = self
            .covariance
            .innovation(&h, &r, &residual)
            .map_err(refuse)?;
        let verdict = gate.judge(innovation.nis, M);
        let update = Update {
            time,
            measurement: measurement.name(),
            dof: M,
            residual: core::array::from_fn(|i| if i < M { residual[i] } else { 0.0 }),
            sigma: core::array::from_fn(|i| {
                if i < M {
                    innovation.s[(i, i)].sqrt()
                } else {
                    0.0
                }
            }),
            nis: innovation.nis,
            verdict,
        };
        if verdict == Verdict::Inflated {
            // S grows by the factor that brings the NIS to the gate; what grows is R, so R' = R + (k − 1) S.
            r += innovation.s * (gate.inflation(innovation.nis, M) - 1.0);
            innovation = self
                .covariance
                .innovation(&h, &r, &residual)
                .map_err(refuse)?;
        }
        if verdict != Verdict::Rejected {
            let dx = self.covariance.correct(&innovation, &h, &r);
            self.nominal = self.nominal.retract(self.covariance.layout(), &dx);
        }
        Ok(update)
    }
}
