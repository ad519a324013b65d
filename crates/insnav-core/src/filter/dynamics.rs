//! Error dynamics of the strapdown: phi-angle model, resolved in the navigation frame.
//!
//! ```text
//! dp'  = dv − (curvature)(v) dp
//! dv'  = −f_n × φ − C db_a − (2 ω_ie + ω_en) × dv + v × (2 dω_ie + dω_en) + dg
//! φ'   = −ω_in × φ − dω_in − C db_g
//! db'  = −db/τ + noise
//! ```
//! with `true = estimate ⊞ dx` (\[Shin05\] eq. 2.19 to 2.28 with the signs turned). dω and dg are the changes of the rates and
//! of gravity with position and velocity errors, all of them.

use super::layout::{ACCEL_BIAS, ATTITUDE, GYRO_BIAS, Layout, POSITION, VELOCITY};
use super::transition::Transition;
use crate::attitude::skew;
use crate::earth::{EARTH_RATE, ECCENTRICITY_SQUARED};
use crate::imu::ImuNoise;
use crate::mechanization::Interval;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix3, Vector3};

/// Derivatives of the navigation frame's rates and of gravity by the errors of position and velocity.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jacobians {
    /// d(dp')/d(dp), beside the identity on dv.
    pub(super) position_by_position: Matrix3<f64>,
    /// d(dv')/d(dp).
    pub(super) velocity_by_position: Matrix3<f64>,
    /// d(dv')/d(dv).
    pub(super) velocity_by_velocity: Matrix3<f64>,
    /// d(φ')/d(dp) = −d(ω_in)/d(dp).
    pub(super) attitude_by_position: Matrix3<f64>,
    /// d(φ')/d(dv) = −d(ω_in)/d(dv).
    pub(super) attitude_by_velocity: Matrix3<f64>,
    /// −ω_in, for the attitude rows.
    pub(super) frame_rate_n: Vector3<f64>,
}

impl Jacobians {
    pub(super) fn at(interval: &Interval) -> Self {
        let earth = &interval.earth;
        let v = &interval.velocity_n;
        let (s, c) = (earth.sin_latitude, earth.cos_latitude);
        let (rm, rn) = (1.0 / earth.meridian, 1.0 / earth.transverse);
        let tan = s / c;
        // dM/dL and dN/dL over their own radii: the ellipsoid's curvature changes with latitude.
        let by_latitude = ECCENTRICITY_SQUARED * s * c / (1.0 - ECCENTRICITY_SQUARED * s * s);
        let meridian_slope = 3.0 * by_latitude * (1.0 - earth.height * rm);
        let transverse_slope = by_latitude * (1.0 - earth.height * rn);

        let w_ie = earth.earth_rate_n();
        let w_en = earth.transport_rate_n(v);

        // Columns: dp_N acts through latitude (dL = dp_N / (M + h)), dp_D through height (dh = −dp_D).
        let mut dw_ie_dp = Matrix3::zeros();
        dw_ie_dp[(0, 0)] = -EARTH_RATE * s * rm;
        dw_ie_dp[(2, 0)] = -EARTH_RATE * c * rm;
        let mut dw_en_dp = Matrix3::zeros();
        dw_en_dp[(0, 0)] = -w_en.x * transverse_slope * rm;
        dw_en_dp[(1, 0)] = -w_en.y * meridian_slope * rm;
        dw_en_dp[(2, 0)] = (-w_en.z * transverse_slope - v.y * rn / (c * c)) * rm;
        dw_en_dp[(0, 2)] = w_en.x * rn;
        dw_en_dp[(1, 2)] = w_en.y * rm;
        dw_en_dp[(2, 2)] = w_en.z * rn;
        let mut dw_en_dv = Matrix3::zeros();
        dw_en_dv[(0, 1)] = rn;
        dw_en_dv[(1, 0)] = -rm;
        dw_en_dv[(2, 1)] = -tan * rn;

        let mut dg_dp = Matrix3::zeros();
        let (by_latitude, by_height) = earth.gravity_gradient();
        dg_dp[(2, 0)] = by_latitude * rm;
        dg_dp[(2, 2)] = -by_height;

        let position_by_position = Matrix3::new(
            -v.z * rm,
            0.0,
            v.x * rm,
            v.y * tan * rn,
            -(v.z + v.x * tan) * rn,
            v.y * rn,
            0.0,
            0.0,
            0.0,
        );
        let v_cross = skew(v);
        Jacobians {
            position_by_position,
            velocity_by_position: v_cross * (dw_ie_dp * 2.0 + dw_en_dp) + dg_dp,
            velocity_by_velocity: v_cross * dw_en_dv - skew(&(w_ie * 2.0 + w_en)),
            attitude_by_position: -(dw_ie_dp + dw_en_dp),
            attitude_by_velocity: -dw_en_dv,
            frame_rate_n: w_ie + w_en,
        }
    }
}

/// Fill Φ and Q of the base states for one interval.
///
/// First order in dt within each block. Q is diagonal: white noise on velocity and attitude, the exact Gauss–Markov step on
/// the biases. Against Van Loan's exact sigmas (\[VanLoan78\]) after one second of 100 Hz steps: from P = 0, position is short
/// by 0.8 %, velocity by 0.05 %, attitude by 0.002 %; from the uncertainty of any real start, all are within 0.01 %
/// (tests/process_noise.rs).
pub fn fill_base(phi: &mut Transition, layout: &Layout, interval: &Interval, noise: &ImuNoise) {
    let dt = interval.dt;
    let j = Jacobians::at(interval);
    phi.position.clear();
    phi.position
        .put(layout, POSITION, &(j.position_by_position * dt));
    phi.position
        .put(layout, VELOCITY, &Matrix3::from_diagonal_element(dt));
    let minus_axes_dt = interval.axes_n * -dt;
    phi.velocity.clear();
    // Nothing changes with longitude: the columns of the East error are zero.
    for axis in [0, 2] {
        let column = j.velocity_by_position.column(axis) * dt;
        phi.velocity.put_axis(layout, POSITION, axis, column.into());
    }
    phi.velocity
        .put(layout, VELOCITY, &(j.velocity_by_velocity * dt));
    phi.velocity
        .put(layout, ATTITUDE, &skew(&(interval.specific_force_n * -dt)));
    phi.velocity.put(layout, ACCEL_BIAS, &minus_axes_dt);
    phi.attitude.clear();
    for axis in [0, 2] {
        let column = j.attitude_by_position.column(axis) * dt;
        phi.attitude.put_axis(layout, POSITION, axis, column.into());
    }
    phi.attitude
        .put(layout, VELOCITY, &(j.attitude_by_velocity * dt));
    phi.attitude
        .put(layout, ATTITUDE, &skew(&(j.frame_rate_n * -dt)));
    phi.attitude.put(layout, GYRO_BIAS, &minus_axes_dt);

    fill_biases(phi, noise, dt);
    let white_v = noise.accel_white * noise.accel_white * dt;
    let white_a = noise.gyro_white * noise.gyro_white * dt;
    for a in 0..3 {
        phi.noise[3 + a] = white_v;
        phi.noise[6 + a] = white_a;
    }
}

/// Decay and noise of the biases over `dt` seconds.
pub(super) fn fill_biases(phi: &mut Transition, noise: &ImuNoise, dt: f64) {
    let gyro = GaussMarkov::over(dt, noise.gyro_bias_sigma, noise.gyro_bias_tau);
    let accel = GaussMarkov::over(dt, noise.accel_bias_sigma, noise.accel_bias_tau);
    for a in 0..3 {
        (phi.decay[9 + a], phi.noise[9 + a]) = (gyro.decay, gyro.variance);
        (phi.decay[12 + a], phi.noise[12 + a]) = (accel.decay, accel.variance);
    }
}

/// One step of a first-order Gauss–Markov process: factor and variance of the noise, exact for any dt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaussMarkov {
    /// e^(−dt/τ).
    pub decay: f64,
    /// σ² (1 − e^(−2dt/τ)).
    pub variance: f64,
}

impl GaussMarkov {
    /// Over `dt` seconds, for steady-state sigma and correlation time; an infinite τ is a constant.
    pub fn over(dt: f64, sigma: f64, tau: f64) -> Self {
        let x = dt / tau;
        // Below 1e-3 the third-order series is exact to 1e-13 and saves two exponentials a step.
        let one_minus = |x: f64| {
            if x < 1e-3 {
                x * (1.0 - 0.5 * x * (1.0 - x / 3.0))
            } else {
                1.0 - (-x).exp()
            }
        };
        GaussMarkov {
            decay: 1.0 - one_minus(x),
            variance: sigma * sigma * one_minus(2.0 * x),
        }
    }
}
