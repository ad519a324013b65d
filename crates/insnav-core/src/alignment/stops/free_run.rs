//! A strapdown that runs freely through the stops, and how its errors grow.

use super::place::Place;
use super::record::{Node, Record, Span};
use crate::attitude::{exp, skew};
use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};
use std::vec::Vec;

/// Tilt, heading and horizontal velocity errors.
pub(super) const STATES: usize = 5;
/// Errors that drive them: gyro and accelerometer bias.
pub(super) const INPUTS: usize = 6;

/// Where the strapdown starts, how fast, and with which biases.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Start {
    pub(super) q_nb: UnitQuaternion<f64>,
    pub(super) gyro_bias: Vector3<f64>,
    pub(super) accel_bias: Vector3<f64>,
    pub(super) velocity_n: Vector3<f64>,
}

/// Attitude and velocity at the begins of nodes, the height held.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FreeRun {
    /// Number of the record's node where the run begins.
    pub(super) first: usize,
    pub(super) q_nb: Vec<UnitQuaternion<f64>>,
    pub(super) velocity_n: Vec<Vector3<f64>>,
    /// Mean of C over each node.
    pub(super) axes_n: Vec<Matrix3<f64>>,
    /// Mean specific force over each node, n, m/s².
    pub(super) force_n: Vec<Vector3<f64>>,
}

impl FreeRun {
    /// From the begin of a span to its end. The body is taken to stay where it is but for what the run itself says; its
    /// vertical velocity is zero (\[Lobusov14\] works with horizontal channels only).
    pub(super) fn new(record: &Record, span: Span, place: &Place, start: &Start) -> Self {
        let count = span.end - span.begin;
        let mut run = FreeRun {
            first: span.begin,
            q_nb: Vec::with_capacity(count + 1),
            velocity_n: Vec::with_capacity(count + 1),
            axes_n: Vec::with_capacity(count),
            force_n: Vec::with_capacity(count),
        };
        let (mut q, mut v) = (start.q_nb, start.velocity_n);
        run.q_nb.push(q);
        run.velocity_n.push(v);
        for node in &record.nodes[span.begin..span.end] {
            let (force_n, axes_n) = step(&mut q, &mut v, node, place, start);
            run.q_nb.push(q);
            run.velocity_n.push(v);
            run.axes_n.push(axes_n);
            run.force_n.push(force_n);
        }
        run
    }

    /// Index into the run's own columns.
    pub(super) fn at(&self, node: usize) -> usize {
        node - self.first
    }
}

/// One node on; mean specific force and mean axes over it.
fn step(
    q: &mut UnitQuaternion<f64>,
    v: &mut Vector3<f64>,
    node: &Node,
    place: &Place,
    start: &Start,
) -> (Vector3<f64>, Matrix3<f64>) {
    let (rotation, gain_b) = node.corrected(&start.gyro_bias, &start.accel_bias);
    let dt = node.dt;
    let gain = *q * gain_b;
    let acceleration = |v: &Vector3<f64>| {
        -(place.earth_n * 2.0 + place.transport_rate_n(v)).cross(v)
            + Vector3::new(0.0, 0.0, place.gravity)
    };
    let middle = *v + (gain + acceleration(v) * dt) * 0.5;
    let turn = (place.earth_n + place.transport_rate_n(&middle)) * dt;
    let gain = gain - turn.cross(&gain) * 0.5;
    let axes = q.to_rotation_matrix().into_inner() * (node.axes / dt);
    *v += gain + acceleration(&middle) * dt;
    v.z = 0.0;
    *q = UnitQuaternion::new_normalize((exp(&-turn) * *q * rotation).into_inner());
    (gain / dt, axes)
}

/// How errors go over one node: (φ, v) on itself, and biases into it. Errors are what is true minus what is computed,
/// `C = Exp(φ) Ĉ`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Step {
    pub(super) states: SMatrix<f64, STATES, STATES>,
    pub(super) inputs: SMatrix<f64, STATES, INPUTS>,
}

impl Step {
    /// With mean specific force and axes over `dt`.
    ///
    /// φ̇ = −(ω_ie + ω_en)×φ − δω_en − C δb_g, v̇ = f×-part of φ − 2ω_ie×v − C δb_a ([Groves13] section 14.2.4 in the φ-angle form), to
    /// third order in dt: ω dt is 1e-5.
    pub(super) fn new(
        place: &Place,
        dt: f64,
        force_n: &Vector3<f64>,
        axes_n: &Matrix3<f64>,
        velocity_n: &Vector3<f64>,
    ) -> Self {
        let mut f = SMatrix::<f64, STATES, STATES>::zeros();
        let rate = place.earth_n + place.transport_rate_n(velocity_n);
        let transport = place.transport_by_velocity();
        let coriolis = skew(&(place.earth_n * 2.0 + place.transport_rate_n(velocity_n)));
        f.fixed_view_mut::<3, 3>(0, 0).copy_from(&-skew(&rate));
        f.fixed_view_mut::<3, 2>(0, 3)
            .copy_from(&-transport.fixed_view::<3, 2>(0, 0));
        // φ × f = −[f×] φ.
        f.fixed_view_mut::<2, 3>(3, 0)
            .copy_from(&-skew(force_n).fixed_view::<2, 3>(0, 0));
        f.fixed_view_mut::<2, 2>(3, 3)
            .copy_from(&-coriolis.fixed_view::<2, 2>(0, 0));
        let mut b = SMatrix::<f64, STATES, INPUTS>::zeros();
        b.fixed_view_mut::<3, 3>(0, 0).copy_from(&-axes_n);
        b.fixed_view_mut::<2, 3>(3, 3)
            .copy_from(&-axes_n.fixed_view::<2, 3>(0, 0));
        let identity = SMatrix::<f64, STATES, STATES>::identity();
        let fd = f * dt;
        Step {
            states: identity + fd * (identity + fd * (identity + fd / 3.0) / 2.0),
            inputs: (identity + fd * (identity + fd / 3.0) / 2.0) * b * dt,
        }
    }
}
