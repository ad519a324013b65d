//! Coarse alignment: attitude from one stop without any attitude before.
//!
//! Velocity gains of specific force in the frame that the gyros carry are compared with those that gravity gives in the frame
//! that the Earth leaves behind (optimisation-based alignment, \[Wu11\]); the rotation between is found by Davenport's q-method
//! (\[Shuster81\] section IV). Rocking only moves the frame to and fro.

use super::free_run::Start;
use super::place::Place;
use super::record::{Record, Span};
use crate::attitude::exp;
use crate::earth::Geodetic;
use nalgebra::{Matrix4, Quaternion, SymmetricEigen, UnitQuaternion, Vector3, Vector4};
use std::vec::Vec;

/// Attitude at the begin of a stop by the q-method, with gains over all stretches of half the stop's length: whatever
/// velocity the IMU has at the begin of the stop falls out, and rocking is averaged over the stretches.
pub(super) fn inertial_frame(record: &Record, span: Span, place: &Place) -> Start {
    inertial_frame_with(record, span, place, [Vector3::zeros(); 2])
}

/// Likewise with gyro and accelerometer biases taken out, which the start then has.
pub(super) fn inertial_frame_with(
    record: &Record,
    span: Span,
    place: &Place,
    [gyro_bias, accel_bias]: [Vector3<f64>; 2],
) -> Start {
    let nodes = &record.nodes[span.begin..span.end];
    let mut q = UnitQuaternion::identity();
    let (mut body, mut earth) = (Vector3::zeros(), Vector3::zeros());
    let mut t = 0.0;
    let mut bodies: Vec<Vector3<f64>> = std::vec![body];
    let mut earths: Vec<Vector3<f64>> = std::vec![earth];
    for node in nodes {
        let (rotation, gain) = node.corrected(&gyro_bias, &accel_bias);
        body += q * gain;
        q *= rotation;
        // The reaction to gravity in the navigation axes of the begin, at the middle of the node.
        let frame = exp(&(place.earth_n * (t + 0.5 * node.dt)));
        earth += frame * Vector3::new(0.0, 0.0, -place.gravity * node.dt);
        t += node.dt;
        bodies.push(body);
        earths.push(earth);
    }
    let half = nodes.len() / 2;
    let mut k = Matrix4::zeros();
    for i in 0..=nodes.len() - half {
        let b = bodies[i + half] - bodies[i];
        let e = earths[i + half] - earths[i];
        k += correlate(&e, &b);
    }
    Start {
        gyro_bias,
        accel_bias,
        ..start(rotation(&k))
    }
}

/// Attitude at the begin of a record in which the body stands; `None` for less than half a second.
pub(crate) fn coarse_attitude(record: &Record, position: &Geodetic) -> Option<UnitQuaternion<f64>> {
    let span = Span {
        begin: 0,
        end: record.nodes.len(),
    };
    (span.end >= 5).then(|| inertial_frame(record, span, &Place::new(position)).q_nb)
}

/// Attitude from mean rate and mean force alone: gravity gives the level, the horizontal rate gives north.
pub(super) fn two_vector(record: &Record, span: Span) -> Start {
    let nodes = &record.nodes[span.begin..span.end];
    let (mut turn, mut gain) = (Vector3::zeros(), Vector3::zeros());
    for node in nodes {
        turn += crate::attitude::log(&node.rotation);
        gain += node.gain;
    }
    let down = -gain.normalize();
    let east = down.cross(&turn).normalize();
    let north = east.cross(&down);
    let axes =
        nalgebra::Matrix3::from_rows(&[north.transpose(), east.transpose(), down.transpose()]);
    start(UnitQuaternion::from_matrix(&axes))
}

fn start(q_nb: UnitQuaternion<f64>) -> Start {
    Start {
        q_nb,
        gyro_bias: Vector3::zeros(),
        accel_bias: Vector3::zeros(),
        velocity_n: Vector3::zeros(),
    }
}

/// Davenport's matrix of one pair: qᵀ K q is largest where q turns `b` onto `e`; scalar first.
pub(in crate::alignment) fn correlate(e: &Vector3<f64>, b: &Vector3<f64>) -> Matrix4<f64> {
    let m = e * b.transpose();
    let trace = m.trace();
    let z = b.cross(e);
    let s = m + m.transpose();
    let mut k = Matrix4::zeros();
    k[(0, 0)] = trace;
    for i in 0..3 {
        k[(0, i + 1)] = z[i];
        k[(i + 1, 0)] = z[i];
        for j in 0..3 {
            k[(i + 1, j + 1)] = s[(i, j)] - if i == j { trace } else { 0.0 };
        }
    }
    k
}

/// The rotation that makes a sum of [`correlate`] largest.
pub(in crate::alignment) fn rotation(k: &Matrix4<f64>) -> UnitQuaternion<f64> {
    let eigen = SymmetricEigen::new(*k);
    let largest = eigen.eigenvalues.imax();
    let v: Vector4<f64> = eigen.eigenvectors.column(largest).into_owned();
    UnitQuaternion::new_normalize(Quaternion::new(v[0], v[1], v[2], v[3]))
}
