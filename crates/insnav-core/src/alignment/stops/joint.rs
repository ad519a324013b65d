//! ZUPT-1J: all stops in one tapered regression of the velocity and yaw of a free run.
//!
//! \[Lobusov14\] eq. (1)–(8) solve one stop after the other with decoupled polynomials. Here the errors of the free run carry
//! everything: attitude at the begin, biases, and a velocity and yaw offset per stop are fitted to the computed velocity
//! (which should be zero) and the computed yaw (which should be constant) of all stops at once. A taper keeps rocking out of
//! the fit, which no sequential filter with white noise can do.

use super::free_run::{FreeRun, INPUTS, STATES, Start, Step};
use super::problem::Problem;
use super::standing::{Standing, Taper};
use super::sway::{Spectrum, sway};
use crate::attitude::{Euler, exp, wrap_angle};
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};
use std::vec::Vec;

/// What is fitted to all stops: attitude at the begin, gyro bias, accelerometer bias.
pub(super) const GLOBAL: usize = 9;
/// What is fitted to each: velocity at its begin, yaw offset.
const LOCAL: usize = 3;
const ALL: usize = GLOBAL + LOCAL;

/// Weights of the rows, m/s and rad: their ratio matters only through the small coupling of the two kinds.
const ROW_SIGMA: [f64; 2] = [1e-3, 1e-6];
/// Weak priors that keep what cannot be seen at zero, rad/s and m/s²; ten sigmas of the unit's where that is more.
const WEAK_GYRO: f64 = 1e-5;
const WEAK_ACCEL: f64 = 1e-2;
/// A known azimuth is not fitted, rad.
const FIXED: f64 = 1e-10;
/// Passes: each linearises anew. Three are always made, more until a step is small, and no more than eight: a start outside the
/// linear region does not come back by more of them.
const PASSES: usize = 3;
pub(super) const MOST_PASSES: usize = 8;
/// A fit has settled when its last step is so small a part of the sigmas; what is then left is its square.
pub(super) const SETTLED: f64 = 0.05;
/// Steps below these are rounding (rad, rad/s, m/s²).
const ROUNDING: [f64; 3] = [1e-9, 1e-12, 1e-9];

type Global = SVector<f64, GLOBAL>;
type Gain = SMatrix<f64, GLOBAL, LOCAL>;

/// What a fit is to tell, `R` numbers: how they follow from what is fitted, and which of the true attitude and biases at the end
/// and at the begin they are to be.
struct Outputs<const R: usize> {
    by_fit: SMatrix<f64, R, GLOBAL>,
    end: SMatrix<f64, R, GLOBAL>,
    begin: SMatrix<f64, R, GLOBAL>,
}

/// What a joint fit gives.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Joint {
    /// Attitude and biases at the begin of the first stop.
    pub(super) start: Start,
    /// The free run with them.
    pub(super) run: FreeRun,
    pub(super) stops: Vec<Standing>,
    /// Of attitude (φ, n), gyro bias and accelerometer bias at the end of the last stop.
    pub(super) covariance: SMatrix<f64, GLOBAL, GLOBAL>,
    /// What is left of velocity (north, east) and yaw in each stop.
    pub(super) residuals: Vec<Vec<Vector3<f64>>>,
    /// Rocking of each stop, if it was to be looked at; what it does is in the covariance.
    pub(super) sway: Vec<Spectrum>,
    /// Size of the last step in sigmas of the unit's noise: no fit unless it is [`SETTLED`].
    pub(super) step_sigmas: f64,
}

/// One linearisation.
struct Pass {
    run: FreeRun,
    steps: Vec<Step>,
    stops: Vec<Standing>,
    normals: Vec<StopNormal>,
    weights: Weights,
    /// Sensitivity of (φ, v) at the end to what is fitted globally.
    at_end: SMatrix<f64, STATES, GLOBAL>,
    /// Inverse of the global normal matrix.
    inverse: SMatrix<f64, GLOBAL, GLOBAL>,
    solution: Global,
}

/// The rows of one stop, and its normal equations with its own unknowns eliminated.
struct StopNormal {
    /// Rows (v north, v east, yaw) of each node, on global and local unknowns.
    rows: Vec<SMatrix<f64, 3, ALL>>,
    values: Vec<Vector3<f64>>,
    local_inverse: SMatrix<f64, LOCAL, LOCAL>,
    cross: Gain,
    local_right: SVector<f64, LOCAL>,
    reduced: SMatrix<f64, GLOBAL, GLOBAL>,
    reduced_right: Global,
}

impl Joint {
    /// With `rocking`, what the residuals' spectrum does to the fit is added to the covariance of the unit's noise.
    pub(super) fn fit(problem: &Problem<'_>, taper: Taper, rocking: bool) -> Option<Self> {
        let (start, pass, covariance, step_sigmas) = Pass::last(problem, taper)?;
        let told = pass.at_end();
        let fit = pass.told(problem, &start, &told, covariance, rocking).0;
        Some(Joint { step_sigmas, ..fit })
    }

    /// The same with the covariance of attitude and biases at the begin of the first stop and at the end of the last together.
    pub(super) fn fit_between(
        problem: &Problem<'_>,
        taper: Taper,
        rocking: bool,
    ) -> Option<(Self, SMatrix<f64, { 2 * GLOBAL }, { 2 * GLOBAL }>)> {
        let (start, pass, _, step_sigmas) = Pass::last(problem, taper)?;
        let told = pass.at_both();
        let covariance = pass.covariance(problem, &told);
        let (fit, covariance) = pass.told(problem, &start, &told, covariance, rocking);
        Some((Joint { step_sigmas, ..fit }, covariance))
    }
}

impl Pass {
    /// The last linearisation, where it was made, the covariance at its end, and the size of its step.
    fn last(
        problem: &Problem<'_>,
        taper: Taper,
    ) -> Option<(Start, Self, SMatrix<f64, GLOBAL, GLOBAL>, f64)> {
        let mut start = problem.start;
        let mut passes = 1;
        loop {
            let pass = Pass::new(problem, &start, taper)?;
            if passes >= PASSES {
                let told = pass.at_end();
                let covariance = pass.covariance(problem, &told);
                let step = pass.step_sigmas(&told, &covariance);
                if step <= SETTLED || passes == MOST_PASSES {
                    return Some((start, pass, covariance, step));
                }
            }
            start = pass.moved(&start);
            passes += 1;
        }
    }

    /// The fit, and the covariance of what is to be told, to which rocking is added.
    fn told<const R: usize>(
        self,
        problem: &Problem<'_>,
        start: &Start,
        told: &Outputs<R>,
        mut covariance: SMatrix<f64, R, R>,
        rocking: bool,
    ) -> (Joint, SMatrix<f64, R, R>) {
        let residuals = self.residuals();
        let mut spectra = Vec::new();
        if rocking {
            for (i, (stop, left)) in self.stops.iter().zip(&residuals).enumerate() {
                let gains: Vec<_> = (0..left.len())
                    .map(|k| told.by_fit * self.gain(i, k))
                    .collect();
                let found = sway(&stop.t, left, &gains);
                covariance += found.covariance;
                spectra.push(found.spectrum);
            }
        }
        let start = self.moved(start);
        let span = problem.whole();
        let fit = Joint {
            run: FreeRun::new(problem.record, span, &problem.place, &start),
            start,
            stops: self.stops,
            covariance: SMatrix::from_fn(|i, j| covariance[(R - GLOBAL + i, R - GLOBAL + j)]),
            residuals,
            sway: spectra,
            step_sigmas: f64::NAN,
        };
        (fit, covariance)
    }

    fn new(problem: &Problem<'_>, start: &Start, taper: Taper) -> Option<Self> {
        let span = problem.whole();
        let run = FreeRun::new(problem.record, span, &problem.place, start);
        let stops: Vec<Standing> = problem
            .spans
            .iter()
            .map(|s| Standing::new(problem.record, &run, *s, taper))
            .collect();
        let steps = steps(problem, &run, &stops);

        let mut normals = Vec::with_capacity(stops.len());
        let mut sensitivity = SMatrix::<f64, STATES, { GLOBAL + 2 }>::zeros();
        sensitivity
            .fixed_view_mut::<3, 3>(0, 0)
            .fill_with_identity();
        let mut next = 0;
        for stop in &stops {
            let (from, to) = (run.at(stop.span.begin), run.at(stop.span.end));
            while next < from {
                advance(&mut sensitivity, &steps[next]);
                next += 1;
            }
            // The velocity of a stop is its own unknown.
            sensitivity.fixed_rows_mut::<2>(3).fill(0.0);
            sensitivity.fixed_columns_mut::<2>(GLOBAL).fill(0.0);
            sensitivity
                .fixed_view_mut::<2, 2>(3, GLOBAL)
                .fill_with_identity();
            let mut rows = Vec::with_capacity(stop.weights.len());
            let mut values = Vec::with_capacity(stop.weights.len());
            let inside = steps[from..to].iter().map(Some).chain([None]);
            for (k, step) in (from..=to).zip(inside) {
                rows.push(row(&sensitivity));
                let v = run.velocity_n[k];
                values.push(Vector3::new(-v.x, -v.y, -stop.rocking[k - from].z));
                if let Some(step) = step {
                    advance(&mut sensitivity, step);
                }
            }
            next = to;
            normals.push(StopNormal::new(stop, rows, values)?);
        }
        let weights = Weights::of(problem, &stops[0])?;
        let (inverse, solution) = solve(problem, start, &stops, &normals, &weights)?;
        Some(Pass {
            weights,
            run,
            steps,
            stops,
            normals,
            at_end: sensitivity.fixed_columns::<GLOBAL>(0).into_owned(),
            inverse,
            solution,
        })
    }

    /// The start with what was fitted.
    fn moved(&self, start: &Start) -> Start {
        let x = &self.solution;
        let part = |i: usize| x.fixed_rows::<3>(i).into_owned();
        let local = self.normals[0].local(x);
        Start {
            q_nb: UnitQuaternion::new_normalize((exp(&part(0)) * start.q_nb).into_inner()),
            gyro_bias: start.gyro_bias + part(3),
            accel_bias: start.accel_bias + part(6),
            velocity_n: start.velocity_n + Vector3::new(local.x, local.y, 0.0),
        }
    }

    /// Largest component of the step over its sigma, both at the end of the last stop.
    fn step_sigmas(
        &self,
        told: &Outputs<GLOBAL>,
        covariance: &SMatrix<f64, GLOBAL, GLOBAL>,
    ) -> f64 {
        let step = told.by_fit * self.solution;
        (0..GLOBAL)
            .map(|i| step[i].abs() / (covariance[(i, i)].sqrt() + ROUNDING[i / 3] / SETTLED))
            .fold(0.0, |a, b| if b > a || b.is_nan() { b } else { a })
    }

    fn residuals(&self) -> Vec<Vec<Vector3<f64>>> {
        self.normals
            .iter()
            .map(|normal| {
                let local = normal.local(&self.solution);
                let mut x = SVector::<f64, ALL>::zeros();
                x.fixed_rows_mut::<GLOBAL>(0).copy_from(&self.solution);
                x.fixed_rows_mut::<LOCAL>(GLOBAL).copy_from(&local);
                let pairs = normal.rows.iter().zip(&normal.values);
                pairs.map(|(row, value)| value - row * x).collect()
            })
            .collect()
    }

    /// Gains of the global unknowns on the rows (v north, v east, yaw) of node `k` of stop `i`.
    fn gain(&self, i: usize, k: usize) -> Gain {
        let normal = &self.normals[i];
        let row = &normal.rows[k];
        let reduced = row.fixed_columns::<GLOBAL>(0).transpose()
            - normal.cross * normal.local_inverse * row.fixed_columns::<LOCAL>(GLOBAL).transpose();
        self.inverse * reduced * row_weights(self.stops[i].weights[k])
    }

    /// What the fit says of attitude and biases at the end of the last stop: the attitude goes on with the biases.
    fn at_end(&self) -> Outputs<GLOBAL> {
        let mut by_fit = SMatrix::<f64, GLOBAL, GLOBAL>::identity();
        by_fit
            .fixed_view_mut::<3, GLOBAL>(0, 0)
            .copy_from(&self.at_end.fixed_rows::<3>(0));
        Outputs {
            by_fit,
            end: SMatrix::identity(),
            begin: SMatrix::zeros(),
        }
    }

    /// The same at the begin of the first stop, and then at the end of the last.
    fn at_both(&self) -> Outputs<{ 2 * GLOBAL }> {
        let end = self.at_end();
        let mut both = Outputs {
            by_fit: SMatrix::zeros(),
            end: SMatrix::zeros(),
            begin: SMatrix::zeros(),
        };
        let identity = SMatrix::<f64, GLOBAL, GLOBAL>::identity();
        for (whole, first, second) in [
            (&mut both.by_fit, identity, end.by_fit),
            (&mut both.end, SMatrix::zeros(), end.end),
            (&mut both.begin, identity, SMatrix::zeros()),
        ] {
            whole
                .fixed_view_mut::<GLOBAL, GLOBAL>(0, 0)
                .copy_from(&first);
            whole
                .fixed_view_mut::<GLOBAL, GLOBAL>(GLOBAL, 0)
                .copy_from(&second);
        }
        both
    }

    /// Covariance of what is told, by the noise that the unit is said to have.
    ///
    /// The fit is linear in its rows, and these are linear in the noise of every node: the adjoint of the error dynamics, run
    /// backwards with the gains as its input, gives what each node's noise, the biases before any data and their drift do to
    /// the result. That holds for any weights.
    fn covariance<const R: usize>(
        &self,
        problem: &Problem<'_>,
        told: &Outputs<R>,
    ) -> SMatrix<f64, R, R> {
        let noise = problem.noise;
        let outputs = told.by_fit;
        let mut adjoint = SMatrix::<f64, R, STATES>::zeros();
        adjoint
            .fixed_columns_mut::<3>(0)
            .copy_from(&told.end.fixed_columns::<3>(0));
        let mut on_biases = told.end.fixed_columns::<INPUTS>(3).into_owned();
        let mut sum = SMatrix::<f64, R, R>::zeros();
        let add = |sum: &mut SMatrix<f64, R, R>, columns: &SMatrix<f64, R, 3>, variance: f64| {
            *sum += columns * columns.transpose() * variance;
        };
        let drift = |sigma: f64, tau: f64| 2.0 * sigma * sigma / tau;

        for stop in &self.stops {
            // The row of the vertical force: what it says of the accelerometer bias, and its own error.
            let error = problem.vertical_sigma(stop.length());
            let weighted = error * self.weights.scale;
            let gain = outputs * (self.inverse * vertical_row(stop)) / (weighted * weighted);
            let mut accel = on_biases.fixed_columns_mut::<3>(3);
            accel -= gain * stop.axes_n.row(2);
            sum += gain * gain.transpose() * (error * error);
        }

        let mut by_scale = SMatrix::<f64, R, 3>::zeros();
        let last = self.steps.len();
        let mut stop = self.stops.len();
        for k in (0..=last).rev() {
            let node = self.run.first + k;
            if stop > 0 && self.stops[stop - 1].span.end == node {
                stop -= 1;
            }
            let inside = self
                .stops
                .get(stop)
                .filter(|s| (s.span.begin..=s.span.end).contains(&node));
            if let Some(standing) = inside {
                let gain = outputs * self.gain(stop, node - standing.span.begin);
                let mut velocity = adjoint.fixed_columns_mut::<2>(3);
                velocity -= gain.fixed_columns::<2>(0);
                let mut yaw = adjoint.column_mut(2);
                yaw -= gain.column(2);
                if node == standing.span.begin {
                    adjoint.fixed_columns_mut::<2>(3).fill(0.0);
                    if stop > 0 {
                        let turn = problem.turn_by_scale(stop, &self.run);
                        by_scale += adjoint.fixed_columns::<3>(0) * turn;
                    }
                }
            }
            if k == 0 {
                break;
            }
            let step = &self.steps[k - 1];
            let dt = problem.record.nodes[node - 1].dt;
            let before = adjoint * step.states;
            let middle = (adjoint + before) * 0.5;
            let attitude = middle.fixed_columns::<3>(0).into_owned();
            add(&mut sum, &attitude, noise.gyro_white.powi(2) * dt);
            let velocity = middle.fixed_columns::<2>(3);
            sum += velocity * velocity.transpose() * (noise.accel_white.powi(2) * dt);
            let gyro = on_biases.fixed_columns::<3>(0).into_owned();
            let accel = on_biases.fixed_columns::<3>(3).into_owned();
            add(
                &mut sum,
                &gyro,
                drift(noise.gyro_bias_sigma, noise.gyro_bias_tau) * dt,
            );
            add(
                &mut sum,
                &accel,
                drift(noise.accel_bias_sigma, noise.accel_bias_tau) * dt,
            );
            // A bias goes back to zero as it wanders: so much of it is left of the one a node before.
            let left = [noise.gyro_bias_tau, noise.accel_bias_tau].map(|tau| (-dt / tau).exp());
            let mut gyro = on_biases.fixed_columns_mut::<3>(0);
            gyro *= left[0];
            let mut accel = on_biases.fixed_columns_mut::<3>(3);
            accel *= left[1];
            on_biases += adjoint * step.inputs;
            adjoint = before;
        }
        add(&mut sum, &by_scale, problem.gyro_scale_sigma.powi(2));
        on_biases += told.begin.fixed_columns::<INPUTS>(3);
        if let Some(prior) = &problem.prior {
            let mut sensitivity = SMatrix::<f64, R, GLOBAL>::zeros();
            sensitivity
                .fixed_columns_mut::<3>(0)
                .copy_from(&(adjoint.fixed_columns::<3>(0) + told.begin.fixed_columns::<3>(0)));
            sensitivity
                .fixed_columns_mut::<INPUTS>(3)
                .copy_from(&on_biases);
            return sum + sensitivity * prior.covariance * sensitivity.transpose();
        }
        let gyro = on_biases.fixed_columns::<3>(0).into_owned();
        let accel = on_biases.fixed_columns::<3>(3).into_owned();
        add(&mut sum, &gyro, noise.gyro_bias_sigma.powi(2));
        add(&mut sum, &accel, noise.accel_bias_sigma.powi(2));
        if let Some((_, sigma)) = problem.heading {
            let heading = adjoint.column(2);
            sum += heading * heading.transpose() * (sigma * sigma);
        }
        sum
    }
}

impl StopNormal {
    fn new(
        stop: &Standing,
        rows: Vec<SMatrix<f64, 3, ALL>>,
        values: Vec<Vector3<f64>>,
    ) -> Option<Self> {
        let mut normal = SMatrix::<f64, ALL, ALL>::zeros();
        let mut right = SVector::<f64, ALL>::zeros();
        for ((row, value), weight) in rows.iter().zip(&values).zip(&stop.weights) {
            let weighted = row.transpose() * row_weights(*weight);
            normal += weighted * row;
            right += weighted * value;
        }
        let local = normal
            .fixed_view::<LOCAL, LOCAL>(GLOBAL, GLOBAL)
            .into_owned();
        let local_inverse = local.cholesky()?.inverse();
        let cross = normal.fixed_view::<GLOBAL, LOCAL>(0, GLOBAL).into_owned();
        let local_right = right.fixed_rows::<LOCAL>(GLOBAL).into_owned();
        let eliminate = cross * local_inverse;
        Some(StopNormal {
            reduced: normal.fixed_view::<GLOBAL, GLOBAL>(0, 0) - eliminate * cross.transpose(),
            reduced_right: right.fixed_rows::<GLOBAL>(0) - eliminate * local_right,
            rows,
            values,
            local_inverse,
            cross,
            local_right,
        })
    }

    /// Local unknowns for given global ones.
    fn local(&self, global: &Global) -> SVector<f64, LOCAL> {
        self.local_inverse * (self.local_right - self.cross.transpose() * global)
    }
}

/// What stands beside the rows.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Weights {
    /// Inverse covariance of what is known of the unknowns beforehand.
    information: SMatrix<f64, GLOBAL, GLOBAL>,
    /// The rows' weights promise more than the unit's noise keeps (10⁴ times more in half an hour of a tactical unit), and
    /// everything that is weighed against them is brought to their scale: else rows of noise outweigh the vertical force, and make
    /// an accelerometer bias of 2 m/s² of it.
    scale: f64,
    /// Whether that is knowledge, or only keeps the biases from running away.
    known: bool,
}

impl Weights {
    fn of(problem: &Problem<'_>, stop: &Standing) -> Option<Self> {
        let scale = promised(problem, stop);
        let noise = problem.noise;
        let information = match (&problem.prior, problem.knowledge) {
            (Some(prior), _) => inverse(&prior.covariance)?,
            (None, knowledge) => {
                let [gyro, accel] = knowledge.unwrap_or([
                    WEAK_GYRO.max(10.0 * noise.gyro_bias_sigma),
                    WEAK_ACCEL.max(10.0 * noise.accel_bias_sigma),
                ]);
                let part = |sigma: f64| Vector3::repeat(sigma.powi(-2));
                let parts = [Vector3::zeros(), part(gyro), part(accel)];
                SMatrix::from_diagonal(&Global::from_iterator(parts.iter().flatten().copied()))
            }
        };
        Some(Weights {
            information: information / (scale * scale),
            scale,
            known: problem.prior.is_some() || problem.knowledge.is_some(),
        })
    }
}

/// Of a positive definite matrix whose unknowns differ by eight orders of magnitude: the diagonal is brought to one before it is
/// factorised.
pub(super) fn inverse<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Option<SMatrix<f64, N, N>> {
    let scale = SVector::<f64, N>::from_fn(|i, _| matrix[(i, i)].sqrt().recip());
    let scaled = SMatrix::<f64, N, N>::from_fn(|i, j| matrix[(i, j)] * scale[i] * scale[j]);
    let inverse = scaled.cholesky()?.inverse();
    Some(SMatrix::from_fn(|i, j| {
        inverse[(i, j)] * scale[i] * scale[j]
    }))
}

/// Inverse of the global normal matrix with its priors, and the solution.
fn solve(
    problem: &Problem<'_>,
    start: &Start,
    stops: &[Standing],
    normals: &[StopNormal],
    weights: &Weights,
) -> Option<(SMatrix<f64, GLOBAL, GLOBAL>, Global)> {
    let mut matrix = SMatrix::<f64, GLOBAL, GLOBAL>::zeros();
    let mut right = Global::zeros();
    for (stop, normal) in stops.iter().zip(normals) {
        matrix += normal.reduced;
        right += normal.reduced_right;
        // The mean vertical force is −g but for the accelerometer's bias along it.
        let row = vertical_row(stop);
        let weight = (problem.vertical_sigma(stop.length()) * weights.scale).powi(-2);
        matrix += row * row.transpose() * weight;
        right += row * ((stop.force_down + problem.place.gravity) * weight);
    }
    matrix += weights.information;
    if weights.known {
        // Of the unknowns themselves, not of what this pass adds to them.
        right += weights.information * problem.expected(start);
    }
    if problem.keeps_heading {
        matrix[(2, 2)] += FIXED.powi(-2);
    } else if let Some((told, sigma)) = problem.heading {
        let weight = (sigma.max(FIXED) * weights.scale).powi(-2);
        let now = Euler::from_quaternion(&start.q_nb).heading;
        matrix[(2, 2)] += weight;
        right[2] += wrap_angle(told - now) * weight;
    }
    let inverse = inverse(&matrix)?;
    Some((inverse, inverse * right))
}

/// Standard deviation of a level rate by the rows' weights, over that by the unit's noise (quadratic fits to white velocity and
/// to its random walks).
fn promised(problem: &Problem<'_>, stop: &Standing) -> f64 {
    let (length, count) = (stop.length(), stop.t.len() as f64);
    let g = problem.place.gravity;
    let rows = ROW_SIGMA[0] * (720.0 / count).sqrt() / (length * length * g);
    let noise = problem.noise;
    let kept = 10.0 / 7.0 * noise.gyro_white.powi(2) / length
        + 120.0 / 7.0 * (noise.accel_white / g).powi(2) / length.powi(3);
    rows / kept.sqrt()
}

/// How errors go over each node: in a stop with the stop's mean attitude (the attitude of each instant would let rocking into
/// the unknowns) and with gravity alone as the force; in between as the run says.
pub(super) fn steps(problem: &Problem<'_>, run: &FreeRun, stops: &[Standing]) -> Vec<Step> {
    let mut out: Vec<Step> = Vec::with_capacity(run.axes_n.len());
    let standing_force = Vector3::new(0.0, 0.0, -problem.place.gravity);
    let mut stop = 0;
    let mut last: Option<(usize, f64, Step)> = None;
    for k in 0..run.axes_n.len() {
        let node = run.first + k;
        while stop < stops.len() && node >= stops[stop].span.end {
            stop += 1;
        }
        let dt = problem.record.nodes[node].dt;
        let inside = stops.get(stop).filter(|s| node >= s.span.begin);
        let step = match inside {
            Some(standing) => match last {
                Some((i, length, step)) if i == stop && (length - dt).abs() < 1e-9 => step,
                _ => {
                    let zero = Vector3::zeros();
                    Step::new(&problem.place, dt, &standing_force, &standing.axes_n, &zero)
                }
            },
            None => Step::new(
                &problem.place,
                dt,
                &run.force_n[k],
                &run.axes_n[k],
                &run.velocity_n[k],
            ),
        };
        last = inside.map(|_| (stop, dt, step));
        out.push(step);
    }
    out
}

fn row_weights(weight: f64) -> Matrix3<f64> {
    let [v, yaw] = ROW_SIGMA.map(|s| weight / (s * s));
    Matrix3::from_diagonal(&Vector3::new(v, v, yaw))
}

fn vertical_row(stop: &Standing) -> Global {
    let mut row = Global::zeros();
    row.fixed_rows_mut::<3>(6)
        .copy_from(&stop.axes_n.row(2).transpose());
    row
}

fn row(sensitivity: &SMatrix<f64, STATES, { GLOBAL + 2 }>) -> SMatrix<f64, 3, ALL> {
    let mut row = SMatrix::<f64, 3, ALL>::zeros();
    row.fixed_view_mut::<2, { GLOBAL + 2 }>(0, 0)
        .copy_from(&sensitivity.fixed_rows::<2>(3));
    row.fixed_view_mut::<1, { GLOBAL + 2 }>(2, 0)
        .copy_from(&sensitivity.row(2));
    row[(2, ALL - 1)] = -1.0;
    row
}

fn advance(sensitivity: &mut SMatrix<f64, STATES, { GLOBAL + 2 }>, step: &Step) {
    *sensitivity = step.states * *sensitivity;
    let mut biases = sensitivity.fixed_view_mut::<STATES, INPUTS>(0, 3);
    biases += step.inputs;
}
