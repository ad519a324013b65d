//! The estimate that the filter's errors belong to, and the two operations that define their signs.

use super::columns::{Columns, States, part};
use super::layout::{
    ACCEL_BIAS, ACCEL_SCALE, ATTITUDE, AXLE, BASE, Block, CAPACITY, CLOCK_OFFSET, GNSS_COLOUR,
    GYRO_BIAS, GYRO_SCALE, HELD_ATTITUDE, HELD_HEADING, LEVER_ARM, Layout, MOUNTING,
    ODOMETER_SCALE, POSITION, VELOCITY,
};
use crate::attitude::{exp_level, log_level};
use crate::imu::ImuErrors;
use crate::mechanization::NavState;
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};
use serde::{Deserialize, Serialize};

/// What the aiding models need beyond the motion: corrections of what the settings say. All zero unless estimated or set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// Time-correlated error of the GNSS position, NED, m: measured = true + this + white noise.
    pub gnss_colour_n: Vector3<f64>,
    /// To add to the GNSS lever arm of the settings, body axes, m.
    pub lever_arm_b: Vector3<f64>,
    /// Pitch and yaw of the IMU's axes against the vehicle's, rad: `u_vehicle = Rz(yaw) Ry(pitch) u_b`.
    pub mounting: Vector2<f64>,
    /// To add to the forward place of the unsteered axle of the settings, body axes, m.
    pub axle_forward: f64,
    /// Scale factor error of the odometer: measured = (1 + this) true.
    pub odometer_scale: f64,
    /// To add to the offset of the settings between the IMU's clock and that of the GNSS positions, s: a fix stamped t shows
    /// the body where the filter had it at t − this.
    pub clock_offset: f64,
}

/// What a measurement model may look at.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Nominal {
    /// Position, velocity, attitude, time.
    pub nav: NavState,
    /// Angular rate of the body against inertial space with its errors taken out, resolved in b, rad/s.
    pub rate_b: Vector3<f64>,
    /// Change of `nav.velocity_n` over the last interval, m/s². Models use it at small weights only: it has no error states.
    pub acceleration_n: Vector3<f64>,
    /// Sensor errors as estimated.
    pub imu_errors: ImuErrors,
    /// Everything else that is estimated or known.
    pub calibration: Calibration,
    /// The attitude that is held while standing; of no meaning else.
    pub held_q_nb: UnitQuaternion<f64>,
}

impl Nominal {
    /// ⊞: the truth, if the estimate is `self` and the error is `dx`. This defines every sign in the filter. An attitude error tilts,
    /// then turns about Down ([`exp_level`]).
    #[must_use]
    pub fn retract(&self, layout: &Layout, dx: &States) -> Self {
        let of = |block| part(layout, dx, block).unwrap_or_else(Vector3::zeros);
        // While an attitude is held, its constant error has states of its own beside those of what has happened since.
        let held = held(layout, dx);
        let mut q_nb = exp_level(&(of(ATTITUDE) + held)) * self.nav.q_nb;
        q_nb.renormalize_fast();
        let gyro_bias = of(GYRO_BIAS);
        let mut truth = Nominal {
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
                ..self.imu_errors
            },
            ..*self
        };
        if layout.len() > BASE || self.imu_errors.has_scale() {
            truth.retract_optional(self, layout, dx);
            truth.held_q_nb = exp_level(&held) * self.held_q_nb;
        }
        truth
    }

    #[inline(never)]
    fn retract_optional(&mut self, from: &Nominal, layout: &Layout, dx: &States) {
        fn add<const N: usize>(
            x: &mut SVector<f64, N>,
            layout: &Layout,
            dx: &States,
            block: Block<N>,
        ) {
            if let Some(dx) = part(layout, dx, block) {
                *x += dx;
            }
        }
        let errors = &mut self.imu_errors;
        add(&mut errors.gyro_scale, layout, dx, GYRO_SCALE);
        add(&mut errors.accel_scale, layout, dx, ACCEL_SCALE);
        let scale = |e: &ImuErrors| e.gyro_scale.add_scalar(1.0);
        let measured =
            from.rate_b.component_mul(&scale(&from.imu_errors)) + from.imu_errors.gyro_bias;
        self.rate_b = (measured - errors.gyro_bias).component_div(&scale(errors));
        let calibration = &mut self.calibration;
        add(&mut calibration.gnss_colour_n, layout, dx, GNSS_COLOUR);
        add(&mut calibration.lever_arm_b, layout, dx, LEVER_ARM);
        add(&mut calibration.mounting, layout, dx, MOUNTING);
        for (x, block) in [
            (&mut calibration.odometer_scale, ODOMETER_SCALE),
            (&mut calibration.clock_offset, CLOCK_OFFSET),
            (&mut calibration.axle_forward, AXLE),
        ] {
            *x += part(layout, dx, block).map_or(0.0, |dx| dx[0]);
        }
    }

    /// Put the columns of what depends on the angular rate by `by_rate`: through the gyro's bias and scale factors.
    pub fn put_rate<const M: usize>(
        &self,
        h: &mut Columns<M>,
        layout: &Layout,
        by_rate: &SMatrix<f64, M, 3>,
    ) {
        let errors = &self.imu_errors;
        let mut by_bias = -by_rate;
        if errors.has_scale() {
            by_bias *= Matrix3::from_diagonal(&errors.gyro_scale.map(|s| 1.0 / (1.0 + s)));
        }
        h.put(layout, GYRO_BIAS, &by_bias);
        if layout.has(GYRO_SCALE) {
            h.put(
                layout,
                GYRO_SCALE,
                &(by_bias * Matrix3::from_diagonal(&self.rate_b)),
            );
        }
    }

    /// ⊟: the error of `self` if `truth` is the truth, the inverse of [`Nominal::retract`]; closed blocks stay zero.
    pub fn local(&self, layout: &Layout, truth: &Nominal) -> States {
        let mut dx = [0.0; CAPACITY];
        let held = log_level(&(truth.held_q_nb * self.held_q_nb.inverse()));
        if let Some(range) = layout.range(HELD_HEADING) {
            dx[range.start] = held.z;
        }
        if let Some(range) = layout.range(HELD_ATTITUDE) {
            dx[range].copy_from_slice(held.as_slice());
        }
        let held = self::held(layout, &dx);
        let errors = [
            (POSITION, self.nav.position.offset_to(&truth.nav.position)),
            (VELOCITY, truth.nav.velocity_n - self.nav.velocity_n),
            (
                ATTITUDE,
                log_level(&(truth.nav.q_nb * self.nav.q_nb.inverse())) - held,
            ),
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
        for (id, _, range) in layout.optional() {
            let (mine, theirs) = (self.optional_value(id), truth.optional_value(id));
            for (a, i) in range.enumerate() {
                dx[i] += theirs[a] - mine[a];
            }
        }
        dx
    }

    /// The estimates of an optional block by its number in [`super::BLOCKS`]; zero for what is held.
    pub(super) fn optional_value(&self, id: usize) -> [f64; 3] {
        let (e, c) = (&self.imu_errors, &self.calibration);
        match id {
            _ if id == GYRO_SCALE.id() => e.gyro_scale.into(),
            _ if id == ACCEL_SCALE.id() => e.accel_scale.into(),
            _ if id == GNSS_COLOUR.id() => c.gnss_colour_n.into(),
            _ if id == LEVER_ARM.id() => c.lever_arm_b.into(),
            _ if id == MOUNTING.id() => [c.mounting.x, c.mounting.y, 0.0],
            _ if id == ODOMETER_SCALE.id() => [c.odometer_scale, 0.0, 0.0],
            _ if id == CLOCK_OFFSET.id() => [c.clock_offset, 0.0, 0.0],
            _ if id == AXLE.id() => [c.axle_forward, 0.0, 0.0],
            _ => [0.0; 3],
        }
    }

    /// Multiply every optional estimate by its factor.
    pub(super) fn decay_optional(&mut self, layout: &Layout, decay: &States) {
        // Constants, as most are.
        if decay[BASE..layout.len()].iter().all(|d| *d == 1.0) {
            return;
        }
        let mut shrink = [0.0; CAPACITY];
        for (id, range) in layout.optional_ranges() {
            let value = self.optional_value(id);
            for (a, i) in range.enumerate() {
                shrink[i] = value[a] * (decay[i] - 1.0);
            }
        }
        let now = *self;
        self.retract_optional(&now, layout, &shrink);
    }
}

/// The constant part of the attitude error, as a rotation in n; zero while nothing is held.
fn held(layout: &Layout, dx: &States) -> Vector3<f64> {
    if layout.len() == BASE {
        return Vector3::zeros();
    }
    let heading = part(layout, dx, HELD_HEADING).map_or(0.0, |x| x[0]);
    part(layout, dx, HELD_ATTITUDE).unwrap_or_default() + Vector3::z() * heading
}
