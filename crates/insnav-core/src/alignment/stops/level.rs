//! Roll and pitch from gravity, and what is known when biases are left as they are.

use super::joint::GLOBAL;
use super::place::Place;
use super::record::{Record, Span};
use crate::alignment::levelling::from_force;
use crate::attitude::{exp, log};
use crate::imu::ImuNoise;
use core::f64::consts::PI;
use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};

/// Level attitude (heading zero, or as told) and mean rate of a stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Levelled {
    pub(super) q_nb: UnitQuaternion<f64>,
    /// Mean rate less what is known of the Earth's.
    pub(super) gyro_bias: Vector3<f64>,
    pub(super) covariance: SMatrix<f64, GLOBAL, GLOBAL>,
}

/// Means of a stretch: rate and specific force, body axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Means {
    pub(super) rate_b: Vector3<f64>,
    pub(super) force_b: Vector3<f64>,
    /// s.
    pub(super) length: f64,
}

impl Means {
    pub(super) fn of(record: &Record, span: Span) -> Self {
        let nodes = &record.nodes[span.begin..span.end];
        let length: f64 = nodes.iter().map(|node| node.dt).sum();
        let turn: Vector3<f64> = nodes.iter().map(|node| log(&node.rotation)).sum();
        let gain: Vector3<f64> = nodes.iter().map(|node| node.gain).sum();
        Means {
            rate_b: turn / length,
            force_b: gain / length,
            length,
        }
    }
}

/// Rocking leaves so much between the means of two halves of a stop, rad/s and m/s² (15 mrad in a stop of five minutes).
const ROCKS: [f64; 2] = [1e-4, 0.02];

/// Largest difference of the two halves' means in its sigmas, by white noise, wander and rocking.
pub(super) fn halves(record: &Record, span: Span, noise: &ImuNoise) -> f64 {
    let middle = (span.begin + span.end) / 2;
    let [first, second] = [(span.begin, middle), (middle, span.end)]
        .map(|(begin, end)| Means::of(record, Span { begin, end }));
    let sigma = |white: f64, bias: f64, tau: f64, rocks: f64| {
        let length = first.length.min(second.length);
        let own = 2.0 * white * white / length + 2.0 * bias * bias / tau * length * 2.0 / 3.0;
        own.sqrt().hypot(rocks / 3.0)
    };
    let rate = (first.rate_b - second.rate_b).amax()
        / sigma(
            noise.gyro_white,
            noise.gyro_bias_sigma,
            noise.gyro_bias_tau,
            ROCKS[0],
        );
    let force = (first.force_b - second.force_b).amax()
        / sigma(
            noise.accel_white,
            noise.accel_bias_sigma,
            noise.accel_bias_tau,
            ROCKS[1],
        );
    rate.max(force)
}

/// From the mean force in body axes: the mean attitude of the stop. Gyros that cannot find north would only turn it away. With a
/// heading that is known (and its sigma, rad) the attitude has that, and the gyro bias is free of the Earth's whole rate.
pub(super) fn level(
    record: &Record,
    span: Span,
    place: &Place,
    noise: &ImuNoise,
    heading: Option<(f64, f64)>,
) -> Levelled {
    let Means {
        rate_b,
        force_b,
        length,
    } = Means::of(record, span);
    let (told, sigma) = heading.unwrap_or((0.0, 0.0));
    let q_nb = exp(&Vector3::new(0.0, 0.0, told)) * from_force(&force_b);
    let axes = q_nb.inverse().to_rotation_matrix().into_inner();
    let horizontal = place.horizontal_rate();
    let mut covariance = covariance(&q_nb, place, noise, length, None, [0.0; 2]);
    let drift = 2.0 * noise.gyro_bias_sigma.powi(2) / noise.gyro_bias_tau * length / 3.0;
    let mut gyro = Matrix3::identity() * (noise.gyro_white.powi(2) / length + drift);
    covariance.fixed_view_mut::<3, 3>(0, 3).fill(0.0);
    covariance.fixed_view_mut::<3, 3>(3, 0).fill(0.0);
    let earth_n = if heading.is_some() {
        // A heading error turns the Earth's horizontal rate into east: b = ω − Cᵀ(1 − φ×)Ω.
        let east_b = axes.column(1) * -horizontal;
        covariance[(2, 2)] = sigma * sigma;
        let cross = east_b * (sigma * sigma);
        covariance
            .fixed_view_mut::<1, 3>(2, 3)
            .copy_from(&cross.transpose());
        covariance.fixed_view_mut::<3, 1>(3, 2).copy_from(&cross);
        gyro += east_b * east_b.transpose() * (sigma * sigma);
        place.earth_n
    } else {
        // Its direction is not known: either horizontal axis has half of its square.
        let half = 0.5 * horizontal * horizontal;
        gyro += axes * Matrix3::from_diagonal(&Vector3::new(half, half, 0.0)) * axes.transpose();
        Vector3::new(0.0, 0.0, place.earth_n.z)
    };
    covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&gyro);
    Levelled {
        q_nb,
        gyro_bias: rate_b - axes * earth_n,
        covariance,
    }
}

/// Covariance of an attitude that was found with biases left in: tilt from the accelerometers' bias, heading from the gyros'
/// along east and from the tilt; with `rate_variance` `None` the heading is unknown. The gyros have carried tilt and heading from where
/// they were found for so many seconds, with their bias.
pub(super) fn covariance(
    q_nb: &UnitQuaternion<f64>,
    place: &Place,
    noise: &ImuNoise,
    length: f64,
    rate_variance: Option<f64>,
    [tilted, turned]: [f64; 2],
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
    // Computed axes turn by C b_g too fast; about east, the heading that follows from that drift takes it back.
    let mut carried = map.fixed_view_mut::<3, 3>(0, 0);
    carried -= Matrix3::from_diagonal(&Vector3::new(tilted, 0.0, turned)) * axes;
    let mut biases = SMatrix::<f64, 6, 6>::zeros();
    for i in 0..3 {
        biases[(i, i)] = noise.gyro_bias_sigma.powi(2);
        biases[(3 + i, 3 + i)] = noise.accel_bias_sigma.powi(2);
    }
    map * biases * map.transpose() + own
}
