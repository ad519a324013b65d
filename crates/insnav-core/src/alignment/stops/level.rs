//! Roll and pitch from gravity, and what is known when biases are left as they are.

use super::joint::GLOBAL;
use super::place::Place;
use super::record::{Record, Span};
use crate::alignment::levelling::from_force;
use crate::attitude::log;
use crate::imu::ImuNoise;
use core::f64::consts::PI;
use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};

/// Level attitude (heading zero) and mean rate of a stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Levelled {
    pub(super) q_nb: UnitQuaternion<f64>,
    /// Mean rate less the Earth's vertical rate.
    pub(super) gyro_bias: Vector3<f64>,
    pub(super) covariance: SMatrix<f64, GLOBAL, GLOBAL>,
}

/// From the mean force in body axes: the mean attitude of the stop. Gyros that cannot find north would only turn it away.
pub(super) fn level(record: &Record, span: Span, place: &Place, noise: &ImuNoise) -> Levelled {
    let nodes = &record.nodes[span.begin..span.end];
    let length: f64 = nodes.iter().map(|node| node.dt).sum();
    let rate = nodes
        .iter()
        .map(|node| log(&node.rotation))
        .sum::<Vector3<f64>>()
        / length;
    let force: Vector3<f64> = nodes.iter().map(|node| node.gain).sum();
    let q_nb = from_force(&force);
    let earth_b = q_nb.inverse() * Vector3::new(0.0, 0.0, place.earth_n.z);
    let mut covariance = covariance(&q_nb, place, noise, length, None);
    // The bias is the mean rate: white noise, the unknown direction of the Earth's horizontal rate, and drift in the stop.
    let axes = q_nb.inverse().to_rotation_matrix().into_inner();
    let horizontal = 0.5 * place.horizontal_rate().powi(2);
    let drift = 2.0 * noise.gyro_bias_sigma.powi(2) / noise.gyro_bias_tau * length / 3.0;
    let gyro = axes
        * Matrix3::from_diagonal(&Vector3::new(horizontal, horizontal, 0.0))
        * axes.transpose()
        + Matrix3::identity() * (noise.gyro_white.powi(2) / length + drift);
    covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&gyro);
    covariance.fixed_view_mut::<3, 3>(0, 3).fill(0.0);
    covariance.fixed_view_mut::<3, 3>(3, 0).fill(0.0);
    Levelled {
        q_nb,
        gyro_bias: rate - earth_b,
        covariance,
    }
}

/// Covariance of an attitude that was found with biases left in: tilt from the accelerometers' bias, heading from the gyros'
/// along east and from the tilt; with `rate_variance` `None` the heading is unknown.
pub(super) fn covariance(
    q_nb: &UnitQuaternion<f64>,
    place: &Place,
    noise: &ImuNoise,
    length: f64,
    rate_variance: Option<f64>,
) -> SMatrix<f64, GLOBAL, GLOBAL> {
    let axes = q_nb.to_rotation_matrix().into_inner();
    let g = place.gravity;
    // φ_north = (C b_a)_east/g, φ_east = −(C b_a)_north/g, and heading: φ_down = (C b_g)_east/(Ω cos L) − tan L φ_north.
    let mut map = SMatrix::<f64, GLOBAL, 6>::zeros();
    map.fixed_view_mut::<6, 6>(3, 0).fill_with_identity();
    map.fixed_view_mut::<1, 3>(0, 3)
        .copy_from(&(axes.row(1) / g));
    map.fixed_view_mut::<1, 3>(1, 3)
        .copy_from(&(axes.row(0) / -g));
    let white = noise.accel_white.powi(2) / (length * g * g);
    let mut own = SMatrix::<f64, GLOBAL, GLOBAL>::zeros();
    own[(0, 0)] = white;
    own[(1, 1)] = white;
    match rate_variance {
        Some(variance) => {
            let horizontal = place.horizontal_rate();
            map.fixed_view_mut::<1, 3>(2, 0)
                .copy_from(&(axes.row(1) / horizontal));
            map.fixed_view_mut::<1, 3>(2, 3)
                .copy_from(&(axes.row(1) * (-place.tan_latitude / g)));
            own[(2, 2)] = variance / horizontal.powi(2);
        }
        None => own[(2, 2)] = PI * PI / 3.0,
    }
    let mut biases = SMatrix::<f64, 6, 6>::zeros();
    for i in 0..3 {
        biases[(i, i)] = noise.gyro_bias_sigma.powi(2);
        biases[(3 + i, 3 + i)] = noise.accel_bias_sigma.powi(2);
    }
    map * biases * map.transpose() + own
}
