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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{Euler, log};
    use crate::earth::Geodetic;
    use crate::mechanization::Increment;
    use crate::time::Time;

    /// F and the inputs against differences of the free run itself: a state and biases moved by a little, and what has become of
    /// that after a tenth of a second.
    #[test]
    fn errors_go_as_the_derivatives_of_the_free_run() {
        // Still, the Earth's rate (7e-6 here) and the way's (1.6e-8) show. The frame's own turn meanwhile leaves up to ω dt (7.3e-6) of
        // what tilt (g dt) and biases (dt) do, and half of the way's turn through it, g dt²/2R = 8e-9. Turning, mean axes and force
        // stand for those of each instant: half of 8e-3 rad, of effects of 0.1 (axes dt) and 1 (g dt).
        errors_go_as_stated(0.0, 4e-9);
        errors_go_as_stated(1.0, 4e-4);
    }

    fn errors_go_as_stated(turning: f64, allowed: f64) {
        let place = Place::new(&Geodetic::from_degrees(55.0, 37.0, 200.0));
        let record = Record::new((1..=20).map(|i| Increment {
            time: Time::from_seconds(0.005 * f64::from(i)),
            dt: 0.005,
            rotation_b: Vector3::new(2e-4, -1e-4, 3e-4) * turning,
            velocity_b: Vector3::new(2e-3, -1e-3, -9.8 * 0.005),
        }));
        let span = Span { begin: 0, end: 1 };
        let start = Start {
            q_nb: Euler::from_degrees(3.0, -4.0, 70.0).to_quaternion(),
            gyro_bias: Vector3::new(1e-5, 2e-5, -1e-5) * turning,
            accel_bias: Vector3::new(1e-3, -1e-3, 2e-3) * turning,
            // Small, as at rest: what velocity does to its own Coriolis term by the way's rate is left out of F.
            velocity_n: Vector3::new(3e-3, -2e-3, 0.0),
        };
        let run = |start: &Start| FreeRun::new(&record, span, &place, start);
        let nominal = run(&start);
        let step = Step::new(
            &place,
            record.nodes[0].dt,
            &nominal.force_n[0],
            &nominal.axes_n[0],
            &start.velocity_n,
        );
        let size = 1e-5;
        for column in 0..STATES + INPUTS {
            let ends = [size, -size].map(|x| {
                let mut moved = start;
                match column {
                    0..3 => {
                        let mut turn = Vector3::zeros();
                        turn[column] = x;
                        moved.q_nb = exp(&turn) * start.q_nb;
                    }
                    3..5 => moved.velocity_n[column - 3] += x,
                    5..8 => moved.gyro_bias[column - 5] += x,
                    _ => moved.accel_bias[column - 8] += x,
                }
                let run = run(&moved);
                let turned = log(&(run.q_nb[1] * nominal.q_nb[1].inverse()));
                let v = run.velocity_n[1];
                [turned.x, turned.y, turned.z, v.x, v.y]
            });
            for (row, (up, down)) in ends[0].into_iter().zip(ends[1]).enumerate() {
                let slope = (up - down) / (2.0 * size);
                let stated = if column < STATES {
                    step.states[(row, column)]
                } else {
                    step.inputs[(row, column - STATES)]
                };
                let allowed = match (column, row) {
                    (0..3, 3..5) => allowed.max(8e-6),
                    (5.., _) => allowed.max(8e-7),
                    _ => allowed,
                };
                assert!(
                    (slope - stated).abs() < allowed,
                    "{row} {column}: {slope} {stated}"
                );
            }
        }
        // Negative control: tilt that did not reach the velocity would be off by g dt.
        assert!(step.states[(3, 1)].abs() > 0.9 && step.inputs[(0, 0)].abs() > 0.01);
    }
}
