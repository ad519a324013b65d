//! What is kept of a solution, one record an epoch: a sixth of the whole, which holds the covariance of all pairs of states.

use insnav_core::attitude::Euler;
use insnav_core::imu::STANDARD_GRAVITY;
use insnav_core::solution::{Epoch, Motion, Sink};
use insnav_core::time::Time;
use nalgebra::{Matrix3, Vector3};

/// One epoch in the units of its columns.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    pub(crate) time: Time,
    pub(crate) latitude_deg: f64,
    pub(crate) longitude_deg: f64,
    pub(crate) height_m: f64,
    pub(crate) velocity_n_m_per_s: [f64; 3],
    pub(crate) quaternion_nb_wxyz: [f64; 4],
    pub(crate) roll_deg: f64,
    pub(crate) pitch_deg: f64,
    pub(crate) heading_deg: f64,
    pub(crate) gyro_bias_deg_per_hour: [f64; 3],
    pub(crate) accel_bias_mg: [f64; 3],
    pub(crate) position_covariance_n: Matrix3<f64>,
    pub(crate) velocity_covariance_n: Matrix3<f64>,
    pub(crate) attitude_covariance_n: Matrix3<f64>,
    pub(crate) sigma_gyro_bias_deg_per_hour: [f64; 3],
    pub(crate) sigma_accel_bias_mg: [f64; 3],
    pub(crate) standing: bool,
}

impl Row {
    fn of(epoch: &Epoch) -> Self {
        let euler: Euler = epoch.euler();
        let q = &epoch.nav.q_nb;
        let variances = epoch.covariance.diagonal();
        let sigma = |first: usize| variances.fixed_rows::<3>(first).map(root);
        Row {
            time: epoch.nav.time,
            latitude_deg: epoch.nav.position.latitude_deg(),
            longitude_deg: epoch.nav.position.longitude_deg(),
            height_m: epoch.nav.position.height,
            velocity_n_m_per_s: epoch.nav.velocity_n.into(),
            quaternion_nb_wxyz: [q.w, q.i, q.j, q.k],
            roll_deg: euler.roll.to_degrees(),
            pitch_deg: euler.pitch.to_degrees(),
            heading_deg: euler.heading_deg(),
            gyro_bias_deg_per_hour: deg_per_hour(&epoch.imu_errors.gyro_bias),
            accel_bias_mg: milli_g(&epoch.imu_errors.accel_bias),
            position_covariance_n: epoch.position_covariance_n(),
            velocity_covariance_n: epoch.velocity_covariance_n(),
            attitude_covariance_n: epoch.attitude_covariance_n(),
            sigma_gyro_bias_deg_per_hour: deg_per_hour(&sigma(9)),
            sigma_accel_bias_mg: milli_g(&sigma(12)),
            standing: matches!(epoch.motion, Motion::Stationary { .. }),
        }
    }
}

/// Rounding may leave a variance that is all but zero just below it.
pub(crate) fn root(variance: f64) -> f64 {
    variance.max(0.0).sqrt()
}

fn deg_per_hour(rate: &Vector3<f64>) -> [f64; 3] {
    rate.map(|x| x.to_degrees() * 3600.0).into()
}

fn milli_g(force: &Vector3<f64>) -> [f64; 3] {
    force.map(|x| x / STANDARD_GRAVITY * 1e3).into()
}

/// A sink that keeps epochs at a rate.
#[derive(Debug, Default)]
pub(crate) struct Epochs {
    pub(crate) rows: Vec<Row>,
    period: f64,
    next: Option<Time>,
}

impl Epochs {
    /// `rate_hz` 0: every inertial sample.
    pub(crate) fn at_rate(rate_hz: f64) -> Self {
        Epochs {
            period: if rate_hz > 0.0 { 1.0 / rate_hz } else { 0.0 },
            ..Epochs::default()
        }
    }
}

impl Sink for Epochs {
    fn wants_epoch(&mut self, time: Time) -> bool {
        let due = self.next.is_none_or(|next| time >= next);
        if due {
            self.next = Some(time.plus(self.period));
        }
        due
    }

    fn epoch(&mut self, epoch: &Epoch) {
        self.rows.push(Row::of(epoch));
    }
}
