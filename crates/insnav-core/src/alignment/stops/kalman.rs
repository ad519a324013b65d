//! Batch Kalman filter over the stops: the best there is on a quiet base.
//!
//! Error states (φ, v, b_g, b_a) of a free run that a joint fit has already centred, and the heading error's growth since each
//! stop's begin; measured are zero velocity, unchanged heading, and the vertical force.

use super::free_run::{FreeRun, INPUTS, STATES, Start};
use super::joint::{GLOBAL, steps};
use super::problem::Problem;
use super::standing::{Standing, Taper};
use crate::attitude::{Euler, exp, wrap_angle};
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

const N: usize = STATES + INPUTS + 1;
/// How much the heading error has grown since the stop's begin: a state of its own, as the difference of two headings that are
/// not known would drown in rounding.
const GROWN: usize = N - 1;
const ACCEL: usize = STATES + 3;
/// Attitude and biases among all states.
const KEPT: [usize; GLOBAL] = [0, 1, 2, 5, 6, 7, 8, 9, 10];

type Covariance = SMatrix<f64, N, N>;
type State = SVector<f64, N>;

/// Nodes between measurements: half a second.
const EVERY: usize = 5;
/// What remains in velocity and heading of a quiet base, m/s and rad, each half second: rounding of the unit's outputs and
/// settling.
const QUIET: [f64; 2] = [3e-5, 3e-7];
/// Flat priors: tilt and heading, rad, and velocity at a stop's begin, m/s.
const FLAT_TILT: f64 = 0.05;
const FLAT_HEADING: f64 = 3.0;
const FLAT_VELOCITY: f64 = 1.0;

/// What the filter gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Filtered {
    /// At the end of the last stop.
    pub(super) q_nb: UnitQuaternion<f64>,
    pub(super) gyro_bias: Vector3<f64>,
    pub(super) accel_bias: Vector3<f64>,
    /// Of attitude (φ, n), gyro bias and accelerometer bias.
    pub(super) covariance: SMatrix<f64, GLOBAL, GLOBAL>,
    /// What it says of the begin, where a filter knew something beforehand.
    pub(super) begin: Option<Begin>,
    /// Sum of normalised innovations squared, and their number.
    pub(super) nis: f64,
    pub(super) dof: usize,
}

struct Filter {
    x: State,
    p: Covariance,
    /// Covariance with the gyros' scale errors, which are considered and not estimated.
    with_scale: SMatrix<f64, N, 3>,
    begin: Option<Begin>,
    nis: f64,
    dof: usize,
}

/// Attitude and biases at the begin of the first stop: constants that everything later tells something of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Begin {
    /// What has to be added to what was expected beforehand.
    pub(super) correction: SVector<f64, GLOBAL>,
    pub(super) covariance: SMatrix<f64, GLOBAL, GLOBAL>,
    /// With attitude and biases at the end of the last stop.
    pub(super) with_end: SMatrix<f64, GLOBAL, GLOBAL>,
    cross: SMatrix<f64, GLOBAL, N>,
}

impl Begin {
    fn new(covariance: &SMatrix<f64, GLOBAL, GLOBAL>) -> Self {
        let mut cross = SMatrix::<f64, GLOBAL, N>::zeros();
        for (j, column) in KEPT.into_iter().enumerate() {
            cross.set_column(column, &covariance.column(j));
        }
        Begin {
            correction: SVector::zeros(),
            covariance: *covariance,
            with_end: SMatrix::zeros(),
            cross,
        }
    }
}

impl Filter {
    fn measure(&mut self, h: &State, value: f64, sigma: f64) {
        let ph = self.p * h;
        let s = h.dot(&ph) + sigma * sigma;
        let innovation = value - h.dot(&self.x);
        self.nis += innovation * innovation / s;
        self.dof += 1;
        let k = ph / s;
        if let Some(begin) = &mut self.begin {
            let seen = begin.cross * h;
            begin.correction += seen * (innovation / s);
            begin.covariance -= seen * seen.transpose() / s;
            begin.cross -= seen * k.transpose();
        }
        self.x += k * innovation;
        // Joseph's form.
        let a = Covariance::identity() - k * h.transpose();
        self.p = a * self.p * a.transpose() + k * k.transpose() * (sigma * sigma);
        self.with_scale = a * self.with_scale;
    }

    /// A turn that scale errors of this sigma have made wrong: constants, the same in every turn.
    fn turned(&mut self, by_scale: &Matrix3<f64>, sigma: f64) {
        let mut effect = SMatrix::<f64, N, 3>::zeros();
        effect.fixed_view_mut::<3, 3>(0, 0).copy_from(&-by_scale);
        let shared = effect * self.with_scale.transpose();
        self.p += shared + shared.transpose() + effect * effect.transpose() * (sigma * sigma);
        self.with_scale += effect * (sigma * sigma);
    }

    /// A stop begins: its velocity is unknown, and its heading error has not grown.
    fn arrive(&mut self) {
        for i in 3..STATES {
            self.x[i] = 0.0;
            self.p.row_mut(i).fill(0.0);
            self.p.column_mut(i).fill(0.0);
            self.p[(i, i)] = FLAT_VELOCITY * FLAT_VELOCITY;
            self.with_scale.row_mut(i).fill(0.0);
        }
        self.x[GROWN] = 0.0;
        self.with_scale.row_mut(GROWN).fill(0.0);
        self.p.row_mut(GROWN).fill(0.0);
        self.p.column_mut(GROWN).fill(0.0);
        if let Some(begin) = &mut self.begin {
            begin.cross.fixed_columns_mut::<2>(3).fill(0.0);
            begin.cross.column_mut(GROWN).fill(0.0);
        }
    }
}

fn unit(i: usize) -> State {
    let mut h = State::zeros();
    h[i] = 1.0;
    h
}

/// Filter the stops about a start that is already close.
pub(super) fn filter(problem: &Problem<'_>, start: &Start) -> Filtered {
    let noise = problem.noise;
    let run = FreeRun::new(problem.record, problem.whole(), &problem.place, start);
    let stops: std::vec::Vec<Standing> = problem
        .spans
        .iter()
        .map(|s| Standing::new(problem.record, &run, *s, Taper::None))
        .collect();
    let steps = steps(problem, &run, &stops);
    let heading = problem.heading.map_or(FLAT_HEADING, |(_, sigma)| sigma);
    let mut diagonal = State::zeros();
    let mut filter = Filter {
        x: State::zeros(),
        p: Covariance::zeros(),
        with_scale: SMatrix::zeros(),
        begin: problem.prior.map(|prior| Begin::new(&prior.covariance)),
        nis: 0.0,
        dof: 0,
    };
    for i in 0..3 {
        diagonal[i] = if i < 2 { FLAT_TILT } else { heading };
        diagonal[STATES + i] = noise.gyro_bias_sigma;
        diagonal[ACCEL + i] = noise.accel_bias_sigma;
        // Biases are zero beforehand: the start already has some.
        filter.x[STATES + i] = -start.gyro_bias[i];
        filter.x[ACCEL + i] = -start.accel_bias[i];
    }
    if let Some((told, _)) = problem.heading {
        filter.x[2] = wrap_angle(told - Euler::from_quaternion(&start.q_nb).heading);
    }
    filter.p = Covariance::from_diagonal(&diagonal.map(|s| s * s));
    if let Some(prior) = &problem.prior {
        let expected = prior.seen_from(start);
        for (i, row) in KEPT.into_iter().enumerate() {
            filter.x[row] = expected[i];
            for (j, column) in KEPT.into_iter().enumerate() {
                filter.p[(row, column)] = prior.covariance[(i, j)];
            }
        }
    }

    let mut transition = Covariance::identity();
    let drift = |sigma: f64, tau: f64| 2.0 * sigma * sigma / tau;
    let drift_gyro = drift(noise.gyro_bias_sigma, noise.gyro_bias_tau);
    let drift_accel = drift(noise.accel_bias_sigma, noise.accel_bias_tau);
    let mut stop = 0;
    for k in 0..=steps.len() {
        let node = run.first + k;
        if let Some(standing) = stops.get(stop).filter(|s| node >= s.span.begin) {
            let since = node - standing.span.begin;
            if since == 0 {
                if stop > 0 {
                    let by_scale = problem.turn_by_scale(stop, &run);
                    filter.turned(&by_scale, problem.gyro_scale_sigma);
                }
                filter.arrive();
            }
            let arrived = node == standing.span.end;
            if since.is_multiple_of(EVERY) || arrived {
                let v = run.velocity_n[k];
                filter.measure(&unit(3), -v.x, QUIET[0]);
                filter.measure(&unit(4), -v.y, QUIET[0]);
                if since > 0 {
                    let turned = standing.rocking[since].z - standing.rocking[0].z;
                    filter.measure(&unit(GROWN), -turned, QUIET[1]);
                }
            }
            if arrived {
                let mut h = State::zeros();
                h.fixed_rows_mut::<3>(ACCEL)
                    .copy_from(&standing.axes_n.row(2).transpose());
                let value = standing.force_down + problem.place.gravity;
                filter.measure(&h, value, problem.vertical_sigma(standing.length()));
                stop += 1;
            }
        }
        let Some(step) = steps.get(k) else { break };
        let dt = problem.record.nodes[node].dt;
        transition
            .fixed_view_mut::<STATES, STATES>(0, 0)
            .copy_from(&step.states);
        transition
            .fixed_view_mut::<STATES, INPUTS>(0, STATES)
            .copy_from(&step.inputs);
        let growth = transition.row(2) - unit(2).transpose();
        transition.set_row(GROWN, &growth);
        transition[(GROWN, GROWN)] = 1.0;
        // Biases go back to zero as they wander, and the start has a part of them.
        let left = [noise.gyro_bias_tau, noise.accel_bias_tau].map(|tau| (-dt / tau).exp());
        for i in 0..3 {
            transition[(STATES + i, STATES + i)] = left[0];
            transition[(ACCEL + i, ACCEL + i)] = left[1];
        }
        if let Some(begin) = &mut filter.begin {
            begin.cross *= transition.transpose();
        }
        filter.with_scale = transition * filter.with_scale;
        filter.x = transition * filter.x;
        for i in 0..3 {
            filter.x[STATES + i] += (left[0] - 1.0) * start.gyro_bias[i];
            filter.x[ACCEL + i] += (left[1] - 1.0) * start.accel_bias[i];
        }
        filter.p = transition * filter.p * transition.transpose();
        for i in 0..3 {
            filter.p[(i, i)] += noise.gyro_white.powi(2) * dt;
            filter.p[(STATES + i, STATES + i)] += drift_gyro * dt;
            filter.p[(ACCEL + i, ACCEL + i)] += drift_accel * dt;
        }
        let white = noise.gyro_white.powi(2) * dt;
        filter.p[(GROWN, GROWN)] += white;
        filter.p[(GROWN, 2)] += white;
        filter.p[(2, GROWN)] += white;
        for i in 3..STATES {
            filter.p[(i, i)] += noise.accel_white.powi(2) * dt;
        }
    }

    if let Some(begin) = &mut filter.begin {
        begin.with_end = SMatrix::from_fn(|i, j| begin.cross[(i, KEPT[j])]);
    }
    let part = |i: usize| filter.x.fixed_rows::<3>(i).into_owned();
    let end = run.q_nb[run.q_nb.len() - 1];
    Filtered {
        q_nb: UnitQuaternion::new_normalize((exp(&part(0)) * end).into_inner()),
        gyro_bias: start.gyro_bias + part(STATES),
        accel_bias: start.accel_bias + part(ACCEL),
        covariance: SMatrix::from_fn(|i, j| filter.p[(KEPT[i], KEPT[j])]),
        begin: filter.begin,
        nis: filter.nis,
        dof: filter.dof,
    }
}
