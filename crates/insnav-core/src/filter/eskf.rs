//! The error-state Kalman filter: nominal state, covariance, and the closed loop between them.

use super::columns::{Columns, part};
use super::covariance::Covariance;
use super::dynamics::fill_base;
use super::gate::Gate;
use super::held::mirror_held;
use super::layout::{
    ACCEL_BIAS, ATTITUDE, BASE, Block, BlockInfo, GYRO_BIAS, Layout, POSITION, VELOCITY,
};
use super::nominal::{Calibration, Nominal};
use super::optional::{Process, Processes, fill_optional};
#[cfg(feature = "std")]
use super::shares::{Correction, Shares};
use super::transition::Transition;
use super::update::{Update, Verdict};
use crate::error::{Error, Result};
use crate::imu::{ImuErrors, ImuNoise};
use crate::mechanization::{Increment, Interval, NavState};
#[cfg(feature = "std")]
use crate::noise::InnovationSums;
use crate::time::Time;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use serde::{Deserialize, Serialize};
#[cfg(feature = "std")]
use std::boxed::Box;

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
    /// Factor (1 or more) on R in gate and gain, for errors shared with the measurements just before. The NIS is told with R as
    /// it is: shared errors do not make a single residual larger.
    fn dependence(&self) -> f64 {
        1.0
    }
    /// Whether the residual depends on the whole attitude. One that compares with a held attitude does not: what both have in
    /// common it does not see.
    fn sees_whole_attitude(&self) -> bool {
        true
    }
    /// E\[x vᵀ\] by its non-zero columns, where the noise v has gone into the states as well; `None`: it has not.
    fn noise_in_states(&self, _layout: &Layout) -> Option<Columns<M>> {
        None
    }
    /// The block that alone is corrected, where the measurement must not speak of others; `None`: all states.
    fn only(&self) -> Option<Block<3>> {
        None
    }
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
    pub(super) nominal: Nominal,
    pub(super) covariance: Covariance,
    pub(super) noise: ImuNoise,
    pub(super) processes: Processes,
    #[serde(skip)]
    pub(super) phi: Transition,
    /// What each noise adds to the covariance, while somebody asks.
    #[cfg(feature = "std")]
    #[serde(skip)]
    pub(super) shares: Option<Box<Shares>>,
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
            acceleration_n: Vector3::zeros(),
            imu_errors,
            calibration: Calibration::default(),
            held_q_nb: nav.q_nb,
        };
        Eskf {
            nominal,
            covariance,
            noise,
            processes: Processes::default(),
            phi: Transition::default(),
            #[cfg(feature = "std")]
            shares: None,
        }
    }

    /// Give attitude, gyro bias and accelerometer bias one joint covariance, in this order, in place of their own; an
    /// alignment's errors are not independent: its heading is wrong by what the gyros drift along east.
    pub fn set_joint_prior(&mut self, joint: &SMatrix<f64, 9, 9>) {
        let part = |i: usize, j: usize| joint.fixed_view::<3, 3>(i, j).into_owned();
        let covariance = &mut self.covariance;
        covariance.set_prior(ATTITUDE, &part(0, 0));
        covariance.set_prior(GYRO_BIAS, &part(3, 3));
        covariance.set_prior(ACCEL_BIAS, &part(6, 6));
        covariance.set_cross(ATTITUDE, GYRO_BIAS, &part(0, 3));
        covariance.set_cross(ATTITUDE, ACCEL_BIAS, &part(0, 6));
        covariance.set_cross(GYRO_BIAS, ACCEL_BIAS, &part(3, 6));
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
        #[cfg(feature = "std")]
        if let Some(shares) = &mut self.shares {
            shares.lose();
        }
        &mut self.covariance
    }

    /// Add an independent uncertainty to one open block.
    pub fn widen<const N: usize>(&mut self, block: Block<N>, extra: &SMatrix<f64, N, N>) {
        #[cfg(feature = "std")]
        if let Some(shares) = &mut self.shares {
            shares.widen(block, extra);
        }
        self.covariance.add(block, extra);
    }

    /// Sum up from here on what innovations say of the noise, on top of what was summed up before.
    #[cfg(feature = "std")]
    pub fn watch_noise(&mut self, sums: InnovationSums) {
        self.shares = Some(Shares::of(&self.covariance, self.nominal.nav.time, sums));
    }

    /// What each noise adds to the covariance, while it is watched.
    #[cfg(feature = "std")]
    pub fn shares(&self) -> Option<&Shares> {
        self.shares.as_deref()
    }

    /// Sum up no longer, and tell what was.
    #[cfg(feature = "std")]
    pub fn take_noise(&mut self) -> Option<InnovationSums> {
        self.shares.take().map(|shares| shares.into_sums())
    }

    /// Noise of the inertial unit.
    pub fn noise(&self) -> &ImuNoise {
        &self.noise
    }

    /// Estimate an optional block from now on, as an independent Gauss–Markov process; one that is open gets the prior anew.
    ///
    /// The estimate starts at what the calibration has, which is zero unless somebody set it. An infinite `tau` is a constant.
    ///
    /// # Errors
    /// `Capacity` when there is no room.
    pub fn open<const N: usize>(&mut self, block: Block<N>, process: Process) -> Result<()> {
        let prior = SMatrix::from_diagonal(&SVector::from_fn(|i, _| {
            process.sigma[i] * process.sigma[i]
        }));
        self.covariance.open(block, &prior)?;
        self.processes.set(block, process);
        Ok(())
    }

    /// Estimate an optional block no longer. What was found of it stays in use, but for the momentary error of the GNSS
    /// positions, of which nothing is known from here on.
    pub fn close<const N: usize>(&mut self, block: Block<N>) {
        self.covariance.close(block);
        if !self.covariance.layout().has(super::layout::GNSS_COLOUR) {
            self.nominal.calibration.gnss_colour_n = Vector3::zeros();
        }
    }

    /// What is known beforehand of lever arm, mounting and the like.
    pub fn set_calibration(&mut self, calibration: Calibration) {
        self.nominal.calibration = calibration;
    }

    /// How the optional states change by themselves.
    pub fn processes(&self) -> &Processes {
        &self.processes
    }

    /// Scale factors of gyros and accelerometers that are known beforehand.
    pub(crate) fn set_scale(&mut self, gyro: Vector3<f64>, accel: Vector3<f64>) {
        let errors = &mut self.nominal.imu_errors;
        // A known start may bring its own.
        if !errors.has_scale() {
            (errors.gyro_scale, errors.accel_scale) = (gyro, accel);
        }
    }

    /// The optional blocks that are open: name and unit, estimates and standard deviations, as many as the block has states.
    pub fn optional_states(&self) -> impl Iterator<Item = (BlockInfo, [f64; 3], [f64; 3])> + '_ {
        let layout = self.covariance.layout();
        layout.optional().map(|(id, info, range)| {
            let sigma = core::array::from_fn(|a| {
                let i = range.start + a;
                if i < range.end {
                    self.covariance.variance(i).max(0.0).sqrt()
                } else {
                    0.0
                }
            });
            (info, self.nominal.optional_value(id), sigma)
        })
    }

    /// Move over one raw increment (sensor errors still inside).
    pub fn propagate(&mut self, raw: &Increment) {
        self.advance(raw, |_| {});
    }

    /// Move over one raw increment; `seen` may change what the error dynamics see of it.
    #[inline]
    pub(super) fn advance(&mut self, raw: &Increment, seen: impl Fn(&mut Interval)) {
        if raw.dt <= 0.0 {
            return;
        }
        let increment = raw.corrected(&self.nominal.imu_errors);
        self.nominal.rate_b = increment.rotation_b / raw.dt;
        let before = self.nominal.nav.velocity_n;
        let mut interval = self.nominal.nav.advance(&increment);
        self.nominal.acceleration_n = (self.nominal.nav.velocity_n - before) / raw.dt;
        seen(&mut interval);
        let layout = self.covariance.layout();
        fill_base(&mut self.phi, layout, &interval, &self.noise);
        let errors = &self.nominal.imu_errors;
        if layout.len() > BASE || errors.has_scale() {
            let (phi, processes) = (&mut self.phi, &self.processes);
            fill_optional(phi, layout, &interval, &increment, errors, processes);
        }
        #[cfg(feature = "std")]
        if let Some(shares) = &mut self.shares {
            shares.propagate(&self.phi, &self.covariance, self.nominal.nav.time);
        }
        self.covariance.propagate(&self.phi);
        self.decay();
    }

    /// The estimates decay as their errors do.
    pub(super) fn decay(&mut self) {
        let layout = self.covariance.layout();
        let errors = &mut self.nominal.imu_errors;
        let decays = [
            (&mut errors.gyro_bias, GYRO_BIAS),
            (&mut errors.accel_bias, ACCEL_BIAS),
        ];
        for (bias, block) in decays {
            if let Some(decay) = part(layout, &self.phi.decay, block) {
                bias.component_mul_assign(&decay);
            }
        }
        if layout.len() > BASE {
            self.nominal.decay_optional(layout, &self.phi.decay);
        }
    }

    /// Widen the uncertainty for a stretch of `dt` seconds in which nobody saw what the body did: rate and specific force
    /// wrong by the given sigmas (rad/s, m/s²) all along.
    pub fn bridge(&mut self, dt: f64, rate_sigma: f64, force_sigma: f64) {
        let eye = |s: f64| Matrix3::from_diagonal_element(s * s);
        self.widen(POSITION, &eye(0.5 * force_sigma * dt * dt));
        self.widen(VELOCITY, &eye(force_sigma * dt));
        self.widen(ATTITUDE, &eye(rate_sigma * dt));
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
        let layout = self.covariance.layout();
        let Linearized {
            residual,
            mut h,
            mut r,
        } = measurement.linearize(&self.nominal, layout);
        if layout.len() > BASE && measurement.sees_whole_attitude() {
            mirror_held(&mut h, layout);
        }
        let cross = measurement.noise_in_states(layout);
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
        let mut innovation = match &cross {
            None => self.covariance.innovation(&h, &r, &residual),
            Some(cross) => self
                .covariance
                .innovation_correlated(&h, &r, cross, &residual),
        }
        .map_err(refuse)?;
        let (alone, dependence) = (innovation.nis, measurement.dependence());
        #[cfg(feature = "std")]
        let (r_alone, s_alone) = (r, innovation.s);
        let mut judged = (innovation.nis, innovation.s);
        let sigma = core::array::from_fn(|i| {
            if i < M {
                innovation.s[(i, i)].sqrt()
            } else {
                0.0
            }
        });
        if dependence > 1.0 {
            r *= dependence;
            innovation = self
                .covariance
                .innovation(&h, &r, &residual)
                .map_err(refuse)?;
        }
        // What moves the position alone has a noise of its own, learnt from single residuals.
        if measurement.only().is_none() {
            judged = (innovation.nis, innovation.s);
        }
        let (nis, s) = judged;
        let verdict = gate.judge(nis, M);
        let update = Update {
            time,
            measurement: measurement.name(),
            dof: M,
            residual: core::array::from_fn(|i| if i < M { residual[i] } else { 0.0 }),
            sigma,
            nis: alone,
            verdict,
        };
        if verdict == Verdict::Rejected {
            #[cfg(feature = "std")]
            if let Some(shares) = &mut self.shares {
                shares.refused(measurement.name());
            }
            return Ok(update);
        }
        if verdict == Verdict::Inflated {
            // S grows by the factor that brings the NIS to the gate; what grows is R, so R' = R + (k − 1) S.
            r += s * (gate.inflation(nis, M) - 1.0);
            innovation = self
                .covariance
                .innovation(&h, &r, &residual)
                .map_err(refuse)?;
        }
        #[cfg(feature = "std")]
        if let Some(shares) = &mut self.shares {
            let correction = Correction {
                name: measurement.name(),
                time,
                residual,
                h: &h,
                r: r_alone,
                s: s_alone,
                gain: self.covariance.gain(&innovation, measurement.only()),
                accepted: verdict == Verdict::Accepted,
            };
            shares.correct(&correction, &self.covariance);
            // A noise that is in the states has parts of its own.
            if cross.is_some() {
                shares.lose();
            }
        }
        let dx = match measurement.only() {
            None => self.covariance.correct(&innovation, &h, &r),
            Some(block) => self.covariance.correct_only(&innovation, &h, &r, block),
        };
        self.nominal = self.nominal.retract(self.covariance.layout(), &dx);
        Ok(update)
    }
}
