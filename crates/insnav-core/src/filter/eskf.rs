//! The error-state Kalman filter: nominal state, covariance, and the closed loop between them.

use super::columns::{Columns, States, part};
use super::covariance::Covariance;
use super::dynamics::fill_base;
use super::gate::Gate;
use super::held::{mirror_held, turn_of};
use super::layout::{
    ACCEL_BIAS, ATTITUDE, BASE, Block, BlockInfo, CAPACITY, GYRO_BIAS, HELD_ATTITUDE, Layout,
    POSITION, VELOCITY,
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

/// Intervals that [`Eskf::propagate_in_steps`] takes together are this long at most, s: two at 200 Hz, eleven at 1 kHz. What is as
/// long by itself, as at 100 Hz, is taken alone, but for the rest of one that a measurement has cut. Two at 200 Hz may have a fifth of jitter.
pub const COVARIANCE_STEP: f64 = 0.012;

/// Motion over which the covariance has yet to be carried.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Ahead {
    interval: Interval,
    increment: Increment,
}

impl Ahead {
    /// Both, one after the other. Coning between the increments is of no importance to errors.
    fn and(&self, next: &Ahead) -> Self {
        let (a, b) = (&self.increment, &next.increment);
        Ahead {
            interval: self.interval.and(&next.interval),
            increment: Increment {
                time: b.time,
                dt: a.dt + b.dt,
                rotation_b: a.rotation_b + b.rotation_b,
                velocity_b: a.velocity_b + b.velocity_b,
            },
        }
    }

    /// Φ and Q.
    fn fill(
        &self,
        phi: &mut Transition,
        layout: &Layout,
        noise: &ImuNoise,
        errors: &ImuErrors,
        processes: &Processes,
    ) {
        fill_base(phi, layout, &self.interval, noise);
        if layout.len() > BASE || errors.has_scale() {
            let (interval, increment) = (&self.interval, &self.increment);
            fill_optional(phi, layout, interval, increment, errors, processes);
        }
    }
}

/// Error-state Kalman filter of a strapdown INS: 15 base states and the optional blocks of its layout.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Eskf {
    pub(super) nominal: Nominal,
    pub(super) covariance: Covariance,
    pub(super) noise: ImuNoise,
    pub(super) processes: Processes,
    ahead: Option<Ahead>,
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
            ahead: None,
            phi: Transition::default(),
            #[cfg(feature = "std")]
            shares: None,
        }
    }

    /// Give attitude, gyro bias and accelerometer bias one joint covariance, in this order, in place of their own; an
    /// alignment's errors are not independent: its level is wrong by what the accelerometers' biases are, its heading by what the gyros
    /// drift along east.
    pub fn set_joint_prior(&mut self, joint: &SMatrix<f64, 9, 9>) {
        self.settle();
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

    /// Its covariance; between the steps of [`Eskf::propagate_in_steps`], that of the last of them.
    pub fn covariance(&self) -> &Covariance {
        &self.covariance
    }

    /// The covariance, to open and close optional blocks.
    pub fn covariance_mut(&mut self) -> &mut Covariance {
        self.settle();
        #[cfg(feature = "std")]
        if let Some(shares) = &mut self.shares {
            shares.lose();
        }
        &mut self.covariance
    }

    /// Add an independent uncertainty to one open block.
    pub fn widen<const N: usize>(&mut self, block: Block<N>, extra: &SMatrix<f64, N, N>) {
        self.settle();
        #[cfg(feature = "std")]
        if let Some(shares) = &mut self.shares {
            shares.widen(block, extra);
        }
        self.covariance.add(block, extra);
    }

    /// Sum up from here on what innovations say of the noise, on top of what was summed up before.
    #[cfg(feature = "std")]
    pub fn watch_noise(&mut self, sums: InnovationSums) {
        self.settle();
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
        self.settle();
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
        self.settle();
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
        self.settle();
        self.covariance.close(block);
        if !self.covariance.layout().has(super::layout::GNSS_COLOUR) {
            self.nominal.calibration.gnss_colour_n = Vector3::zeros();
        }
    }

    /// Take the truth to be `dx` away: the estimate moves (⊞), the covariance stays. For corrections found elsewhere, and for numerical
    /// derivatives.
    pub fn retract(&mut self, dx: &States) {
        self.settle();
        self.nominal = self.nominal.retract(self.covariance.layout(), dx);
    }

    /// What is known beforehand of lever arm, mounting and the like.
    pub fn set_calibration(&mut self, calibration: Calibration) {
        self.settle();
        self.nominal.calibration = calibration;
    }

    /// How the optional states change by themselves.
    pub fn processes(&self) -> &Processes {
        &self.processes
    }

    /// Scale factors of gyros and accelerometers that are known beforehand.
    pub(crate) fn set_scale(&mut self, gyro: Vector3<f64>, accel: Vector3<f64>) {
        self.settle();
        let errors = &mut self.nominal.imu_errors;
        // A known start may bring its own.
        if !errors.has_scale() {
            (errors.gyro_scale, errors.accel_scale) = (gyro, accel);
        }
    }

    /// The optional blocks that are open: name and unit, estimates and standard deviations, as many as the block has states.
    pub fn optional_states(&self) -> impl Iterator<Item = (BlockInfo, [f64; 3], [f64; 3])> + '_ {
        let layout = self.covariance.layout();
        let variance =
            self.with_covariance(|p| core::array::from_fn::<_, CAPACITY, _>(|i| p.variance(i)));
        layout.optional().map(move |(id, info, range)| {
            let sigma = core::array::from_fn(|a| {
                let i = range.start + a;
                if i < range.end {
                    variance[i].max(0.0).sqrt()
                } else {
                    0.0
                }
            });
            (info, self.nominal.optional_value(id), sigma)
        })
    }

    /// Move over one raw increment (sensor errors still inside).
    pub fn propagate(&mut self, raw: &Increment) {
        self.settle();
        self.advance(raw, |_| {});
        self.settle();
    }

    /// As [`Eskf::propagate`], but the covariance follows in steps of [`COVARIANCE_STEP`] at most, however fast the unit is: the
    /// estimate moves over every increment, the dynamics of the errors are those of the mean motion over the step.
    ///
    /// Everything that changes the filter brings the covariance up to it first, and so does whatever tells of its sigmas but
    /// [`Eskf::covariance`], for which there is [`Eskf::settle`]. Where steps end depends on the increments and on what is
    /// measured, never on who asks.
    pub fn propagate_in_steps(&mut self, raw: &Increment) {
        let is_full = |ahead: &Ahead| ahead.interval.dt + raw.dt > COVARIANCE_STEP;
        if self.ahead.as_ref().is_some_and(is_full) {
            self.settle();
        }
        self.advance(raw, |_| {});
        if self.ahead.as_ref().is_some_and(is_full) {
            self.settle();
        }
    }

    /// Carry the covariance to where the estimate is.
    pub fn settle(&mut self) {
        let Some(ahead) = self.ahead.take() else {
            return;
        };
        ahead.fill(
            &mut self.phi,
            self.covariance.layout(),
            &self.noise,
            &self.nominal.imu_errors,
            &self.processes,
        );
        #[cfg(feature = "std")]
        if let Some(shares) = &mut self.shares {
            shares.propagate(&self.phi, &self.covariance, self.nominal.nav.time);
        }
        self.covariance.propagate(&self.phi);
        self.decay();
    }

    /// Whether the covariance is where the estimate is.
    pub fn is_settled(&self) -> bool {
        self.ahead.is_none()
    }

    /// Look at the covariance where the estimate is, the filter left as it is.
    #[inline]
    pub(super) fn with_covariance<T>(&self, look: impl FnOnce(&Covariance) -> T) -> T {
        let Some(ahead) = &self.ahead else {
            return look(&self.covariance);
        };
        let mut phi = Transition::default();
        ahead.fill(
            &mut phi,
            self.covariance.layout(),
            &self.noise,
            &self.nominal.imu_errors,
            &self.processes,
        );
        let mut covariance = self.covariance.clone();
        covariance.propagate(&phi);
        look(&covariance)
    }

    /// Move over one raw increment, and leave the covariance behind; `seen` may change what the error dynamics see of it.
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
        let ahead = Ahead {
            interval,
            increment,
        };
        self.ahead = Some(match &self.ahead {
            None => ahead,
            Some(before) => before.and(&ahead),
        });
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
    /// wrong by the given sigmas (rad/s, m/s²) all along. A stretch with a measurement inside is two: what comes after the
    /// measurement is widened after it.
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
        self.settle();
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
        self.turn_level(turn_of(self.covariance.layout(), &dx));
        Ok(update)
    }

    /// The estimate was turned about Down: what was north of the level error is now north of it turned.
    ///
    /// With C = R_D(ψ) Exp(φ) Ĉ the errors left after a correction ψ^, φ^ are ψ − ψ^ and R_D(ψ^) (φ − φ^), but for products of
    /// tilts. What ties the level to the biases, in body axes, is tied through Ĉ: if Ĉ turns and the level errors do not, the tie
    /// is another, and gravity that has been used already seems to tell something new, the level without its bias. A heading that is
    /// known is corrected by too little for that to matter; one of which nothing is known is not.
    fn turn_level(&mut self, angle: f64) {
        if angle == 0.0 {
            return;
        }
        self.covariance.turn(ATTITUDE, angle);
        self.covariance.turn(HELD_ATTITUDE, angle);
        #[cfg(feature = "std")]
        if let Some(shares) = &mut self.shares {
            shares.turn_level(angle);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::layout::LEVER_ARM;
    use super::*;
    use crate::attitude::Euler;
    use crate::earth::Geodetic;
    use crate::imu::ImuGrade;

    fn filter() -> Eskf {
        let nav = NavState {
            time: Time(0),
            position: Geodetic::from_degrees(50.0, 14.0, 300.0),
            velocity_n: Vector3::new(3.0, -4.0, 0.5),
            q_nb: Euler::from_degrees(1.0, 2.0, 30.0).to_quaternion(),
        };
        let sigma = InitialSigma {
            position: Vector3::repeat(1.0),
            velocity: Vector3::repeat(0.1),
            attitude: Vector3::repeat(0.01),
            gyro_bias: Vector3::repeat(1e-4),
            accel_bias: Vector3::repeat(0.02),
        };
        Eskf::new(
            nav,
            ImuErrors::default(),
            &sigma,
            ImuGrade::Industrial.noise(),
        )
    }

    #[test]
    fn a_retracted_estimate_is_off_by_what_it_was_moved() {
        let mut moved = filter();
        moved.open(LEVER_ARM, Process::constant(0.1)).unwrap();
        let before = moved.clone();
        let mut dx = [0.0; super::super::layout::CAPACITY];
        for (i, x) in dx.iter_mut().enumerate().take(BASE + 3) {
            *x = 0.01 * (i as f64 - 7.5);
        }
        moved.retract(&dx);
        let layout = before.covariance.layout();
        let back = before.nominal.local(layout, &moved.nominal);
        for (back, dx) in back.iter().zip(dx) {
            // A longitude in radians resolves 1e-9 m.
            assert!((back - dx).abs() < 1e-8, "{back} {dx}");
        }
        assert_eq!(moved.covariance, before.covariance);
    }

    #[test]
    fn a_dense_covariance_is_set_as_it_is_read() {
        let mut filter = filter();
        filter.open(LEVER_ARM, Process::constant(0.1)).unwrap();
        let p = SMatrix::<f64, 18, 18>::from_fn(|i, j| {
            // Powers of two, so that sums with 1/8 are exact.
            0.5f64.powi(i.abs_diff(j) as i32)
        });
        // Of what is not symmetric the mean is taken.
        filter
            .covariance_mut()
            .set_dense(|i, j| p[(i, j)] + if i < j { 0.125 } else { -0.125 } * f64::from(i != j));
        assert_eq!(filter.covariance.dense::<18>(), p);
        assert_eq!(filter.covariance.dense::<19>()[(18, 18)], 0.0);
    }
}
