//! A few seconds of one log: how well inertial samples and positions fit each other at an assumed clock offset.

use super::gnss_track::Path;
use super::preintegration::{Preintegrated, Sensitivity, Steps};
use crate::attitude::{exp, skew};
use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, UnitQuaternion, Vector3};

/// What a gyro's bias may be, rad/s (0.3 °/s), and an accelerometer's, m/s² (20 mg): uncalibrated MEMS after power-on.
/// Better units are served as well: within seconds the data tell their bias hardly better than this.
const GYRO_BIAS_SIGMA: f64 = 5e-3;
const ACCEL_BIAS_SIGMA: f64 = 0.2;
/// Sigma of the heights as a multiple of the horizontal sigma: usual for satellites, all of which are above.
const HEIGHT_RATIO: f64 = 3.0;
/// Position sigma to scale the priors with, m. The fit itself finds the noise.
const UNIT_SIGMA: f64 = 0.3;
/// Position noise below this is not believed when stretches are weighted, m.
const LEAST_SIGMA: f64 = 0.01;

/// Fixes that take part in a window, the others being left out evenly: errors of fast receivers are correlated anyway.
const MOST_FIXES: usize = 40;

/// Attitude and biases: position and velocity are eliminated by taking straight lines out of everything.
type Nuisance = SVector<f64, 9>;

/// Inertial samples and position fixes over some seconds.
pub(super) struct Window {
    inertial: Preintegrated,
    /// Stamps of the fixes, s, and positions with the fall ½ g t² and the straight line taken out, m.
    t: Vec<f64>,
    fixes: Vec<Vector3<f64>>,
    line: Line,
}

/// How far the fit has come; handed from one assumed offset to the next.
#[derive(Clone, Copy)]
pub(super) struct Solution {
    attitude: UnitQuaternion<f64>,
    gyro_bias: Vector3<f64>,
    accel_bias: Vector3<f64>,
    /// Sum of squares in units of [`UNIT_SIGMA`], priors included.
    pub(super) cost: f64,
}

/// First and second derivative (Gauss–Newton) of half the cost by the offset, attitude and biases being refitted.
#[derive(Clone, Copy)]
pub(super) struct Slope {
    pub(super) gradient: f64,
    pub(super) information: f64,
}

impl Window {
    /// Fixes from `from` to `to`, and inertial samples with a margin on either side; `None` with fewer than `fewest` fixes
    /// or with a gap in the inertial samples.
    pub(super) fn new(
        steps: &Steps,
        path: &Path,
        (from, to): (f64, f64),
        margin: f64,
        fewest: usize,
        lever_arm_b: &Vector3<f64>,
    ) -> Option<Self> {
        let first = path.t.partition_point(|&t| t < from);
        let last = path.t.partition_point(|&t| t < to);
        // 5 mm of 10 m/s²'s fall: what a missing sample may cost.
        if last - first < fewest || steps.longest(from - margin, to + margin) > 0.065 {
            return None;
        }
        let middle = 0.5 * (from + to);
        let stride = (last - first).div_ceil(MOST_FIXES);
        let chosen = (first..last).step_by(stride);
        let t: Vec<f64> = chosen.clone().map(|i| path.t[i]).collect();
        let line = Line::new(t.iter().map(|t| t - middle).collect());
        let mut fixes: Vec<_> = chosen
            .zip(&line.t)
            .map(|(i, t)| path.p[i] - path.p[first] - Vector3::z() * (0.5 * path.gravity * t * t))
            .collect();
        line.take_out(&mut fixes);
        Some(Window {
            inertial: Preintegrated::new(steps, from - margin, to + margin, lever_arm_b),
            t,
            fixes,
            line,
        })
    }

    /// Number of fixes.
    pub(super) fn len(&self) -> usize {
        self.t.len()
    }

    /// Weight of this stretch's cost, from how well it fits at its best: every stretch has a noise level of its own.
    pub(super) fn weight(&self, solution: &Solution) -> f64 {
        let n = self.freedom();
        n / (solution.cost + n * (LEAST_SIGMA / UNIT_SIGMA).powi(2))
    }

    /// −2 log likelihood, the noise level being estimated.
    pub(super) fn misfit(&self, solution: &Solution) -> f64 {
        let n = self.freedom();
        n * (solution.cost / n + (LEAST_SIGMA / UNIT_SIGMA).powi(2)).ln()
    }

    /// Horizontal components less the unknowns that these have to tell (attitude, gyro bias, two lines).
    fn freedom(&self) -> f64 {
        (2 * self.len()) as f64 - 10.0
    }

    /// Fit attitude and biases for inertial stamps that are `offset` seconds behind.
    pub(super) fn fit(&self, offset: f64, start: Option<&Solution>) -> Solution {
        let at = AtOffset::new(self, offset);
        let mut solution = match start {
            Some(s) => *s,
            None => at.start(),
        };
        let (mut system, cost) = at.linearize(&solution);
        solution.cost = cost;
        // [Levenberg44] with Marquardt's scaling.
        let mut damping = 1e-6;
        for _ in 0..12 {
            let mut normal = system.normal;
            for i in 0..9 {
                normal[(i, i)] *= 1.0 + damping;
            }
            let Some(cholesky) = normal.cholesky() else {
                break;
            };
            let x: Nuisance = cholesky.solve(&system.right);
            let mut next = solution;
            next.attitude = exp(&x.fixed_rows::<3>(0).into_owned()) * solution.attitude;
            next.gyro_bias += x.fixed_rows::<3>(3);
            next.accel_bias += x.fixed_rows::<3>(6);
            let (next_system, cost) = at.linearize(&next);
            next.cost = cost;
            if cost.is_nan() || cost > solution.cost {
                damping *= 100.0;
                if damping > 1e6 {
                    break;
                }
                continue;
            }
            let gain = solution.cost - cost;
            solution = next;
            system = next_system;
            damping = (damping * 0.1).max(1e-9);
            if gain < 1e-5 * solution.cost {
                break;
            }
        }
        solution
    }

    /// Derivatives by the offset at a fit.
    pub(super) fn slope(&self, offset: f64, solution: &Solution) -> Slope {
        let at = AtOffset::new(self, offset);
        let system = at.linearize(solution).0;
        // The displacement's own rate, biases taken out.
        let rate = |(v, by): (&Vector3<f64>, &Sensitivity)| {
            let v = v
                + by.gyro_bias_rate * solution.gyro_bias
                + by.accel_bias_rate * solution.accel_bias;
            solution.attitude * v
        };
        let pairs = at.rate.iter().zip(&at.sensitivity);
        let mut shift: Vec<_> = pairs.map(rate).collect();
        self.line.take_out(&mut shift);
        let mut information = 0.0;
        let mut gradient = 0.0;
        let mut mixed = Nuisance::zeros();
        let weight = weights();
        for ((d, r), h) in shift.iter().zip(&system.residual).zip(&system.design) {
            let wd = weight.component_mul(d);
            information += wd.dot(d);
            gradient += wd.dot(r);
            mixed += h.tr_mul(&wd);
        }
        // r(offset + δ) = r + d δ − H x: the information left once x is refitted.
        if let Some(cholesky) = system.normal.cholesky() {
            information -= mixed.dot(&cholesky.solve(&mixed));
        }
        Slope {
            gradient,
            information: information.max(0.0),
        }
    }
}

/// Inverse variances of North, East and Down.
fn weights() -> Vector3<f64> {
    let horizontal = 1.0 / (UNIT_SIGMA * UNIT_SIGMA);
    Vector3::new(
        horizontal,
        horizontal,
        horizontal / (HEIGHT_RATIO * HEIGHT_RATIO),
    )
}

/// A window with the inertial displacement looked up at one offset.
struct AtOffset<'a> {
    window: &'a Window,
    displacement: Vec<Vector3<f64>>,
    rate: Vec<Vector3<f64>>,
    sensitivity: Vec<Sensitivity>,
}

/// The linearised fit.
struct System {
    normal: SMatrix<f64, 9, 9>,
    right: Nuisance,
    residual: Vec<Vector3<f64>>,
    design: Vec<SMatrix<f64, 3, 9>>,
}

impl<'a> AtOffset<'a> {
    fn new(window: &'a Window, offset: f64) -> Self {
        let mut out = AtOffset {
            window,
            displacement: Vec::new(),
            rate: Vec::new(),
            sensitivity: Vec::new(),
        };
        for t in &window.t {
            let (s, v) = window.inertial.at(t - offset);
            out.displacement.push(s);
            out.rate.push(v);
            out.sensitivity
                .push(window.inertial.sensitivity_at(t - offset));
        }
        out
    }

    /// Attitude by the best rotation of the displacements onto the fixes (\[Markley88\]), biases zero.
    fn start(&self) -> Solution {
        let mut s = self.displacement.clone();
        self.window.line.take_out(&mut s);
        let b: Matrix3<f64> = self
            .window
            .fixes
            .iter()
            .zip(&s)
            .map(|(p, s)| p * s.transpose())
            .sum();
        let svd = b.svd(true, true);
        let rotation = match (svd.u, svd.v_t) {
            (Some(u), Some(v_t)) => {
                let handed = (u * v_t).determinant().signum();
                u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, handed)) * v_t
            }
            _ => Matrix3::identity(),
        };
        Solution {
            attitude: UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
                rotation,
            )),
            gyro_bias: Vector3::zeros(),
            accel_bias: Vector3::zeros(),
            cost: f64::INFINITY,
        }
    }

    fn linearize(&self, at: &Solution) -> (System, f64) {
        let c = at.attitude.to_rotation_matrix().into_inner();
        let mut residual = Vec::with_capacity(self.displacement.len());
        let mut design = Vec::with_capacity(self.displacement.len());
        for (s, by) in self.displacement.iter().zip(&self.sensitivity) {
            let gyro = c * by.gyro_bias;
            let accel = c * by.accel_bias;
            let moved = c * s + gyro * at.gyro_bias + accel * at.accel_bias;
            let mut h = SMatrix::<f64, 3, 9>::zeros();
            h.fixed_view_mut::<3, 3>(0, 0).copy_from(&-skew(&moved));
            h.fixed_view_mut::<3, 3>(0, 3).copy_from(&gyro);
            h.fixed_view_mut::<3, 3>(0, 6).copy_from(&accel);
            residual.push(moved);
            design.push(h);
        }
        self.window.line.take_out(&mut residual);
        self.window.line.take_out(&mut design);
        for (r, p) in residual.iter_mut().zip(&self.window.fixes) {
            *r = p - *r;
        }
        let weight = weights();
        let mut system = System {
            normal: SMatrix::zeros(),
            right: SVector::zeros(),
            residual,
            design,
        };
        let mut cost = 0.0;
        for (r, h) in system.residual.iter().zip(&system.design) {
            let wr = weight.component_mul(r);
            cost += wr.dot(r);
            system.right += h.tr_mul(&wr);
            for (k, row) in h.row_iter().enumerate() {
                system
                    .normal
                    .ger(weight[k], &row.transpose(), &row.transpose(), 1.0);
            }
        }
        for k in 0..3 {
            for (first, sigma, bias) in [
                (3, GYRO_BIAS_SIGMA, &at.gyro_bias),
                (6, ACCEL_BIAS_SIGMA, &at.accel_bias),
            ] {
                let weight = 1.0 / (sigma * sigma);
                system.normal[(first + k, first + k)] += weight;
                system.right[first + k] -= weight * bias[k];
                cost += weight * bias[k] * bias[k];
            }
            // Heading is unknown where the way is straight; a radian of freedom keeps the equations solvable.
            system.normal[(k, k)] += 1.0;
        }
        (system, cost)
    }
}

/// Least-squares straight lines over the fixes of a window.
struct Line {
    /// Stamps from the middle, s.
    t: Vec<f64>,
    mean: f64,
    spread: f64,
}

impl Line {
    fn new(t: Vec<f64>) -> Self {
        let mean = t.iter().sum::<f64>() / t.len() as f64;
        let spread = t.iter().map(|t| (t - mean).powi(2)).sum();
        Line { t, mean, spread }
    }

    /// Subtract from each component its straight line.
    fn take_out<const R: usize, const C: usize>(&self, values: &mut [SMatrix<f64, R, C>]) {
        let n = values.len() as f64;
        let mut mean = SMatrix::<f64, R, C>::zeros();
        let mut slope = SMatrix::<f64, R, C>::zeros();
        for (v, t) in values.iter().zip(&self.t) {
            mean += v;
            slope += v * (t - self.mean);
        }
        mean /= n;
        slope /= self.spread;
        for (v, t) in values.iter_mut().zip(&self.t) {
            *v -= mean + slope * (t - self.mean);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::Sample;
    use crate::sim::Scenario;

    fn window() -> Window {
        let mut scenario = Scenario::car_drive(160.0);
        scenario.gnss.position_rate_hz = 5.0;
        scenario.gnss.position_sigma_m = [0.05; 3];
        let samples = scenario.simulate(2).expect("valid scenario").samples;
        let zero = samples.iter().map(Sample::time).min().expect("some");
        let (steps, path) = (Steps::new(&samples, zero), Path::new(&samples, zero));
        Window::new(
            &steps,
            &path,
            (130.0, 140.0),
            0.6,
            10,
            &Vector3::new(0.5, 0.2, -1.0),
        )
        .expect("no gap")
    }

    /// Fitted until nothing moves any more.
    fn fitted(window: &Window, offset: f64) -> Solution {
        let first = window.fit(offset, None);
        (0..5).fold(first, |s, _| window.fit(offset, Some(&s)))
    }

    #[test]
    fn the_slope_is_the_derivative_of_the_refitted_cost() {
        let window = window();
        for offset in [-0.3, -0.02, 0.01, 0.1, 0.4] {
            let slope = window.slope(offset, &fitted(&window, offset));
            let h = 0.01;
            let cost = |o: f64| 0.5 * fitted(&window, o).cost;
            let (low, mid, high) = (cost(offset - h), cost(offset), cost(offset + h));
            let gradient = (high - low) / (2.0 * h);
            let bend = (high - 2.0 * mid + low) / (h * h);
            // The sensitivities' path between their nodes differs from the samples' sum by a per cent; without them the
            // gradient is 12 % off. At the minimum 0.1 ms of offset are left.
            let tolerance = 0.03 * gradient.abs() + 1e-4 * bend;
            let error = slope.gradient - gradient;
            assert!(
                error.abs() < tolerance,
                "{offset}: {} {gradient}",
                slope.gradient
            );
            // Gauss–Newton leaves the curvature of the residuals out: it holds near the best offset, which is 0.
            let ratio = slope.information / bend;
            let near = offset.abs() < 0.05;
            assert!(!near || (0.9..1.1).contains(&ratio), "{offset}: {ratio}");
        }
    }

    #[test]
    fn lines_leave_nothing_of_lines() {
        let line = Line::new(vec![-2.0, -0.5, 0.1, 3.0]);
        let mut values: Vec<_> = line
            .t
            .iter()
            .map(|t| Vector3::new(1.0, -2.0 * t, 5.0 + 3.0 * t))
            .collect();
        line.take_out(&mut values);
        assert!(values.iter().all(|v| v.norm() < 1e-14));
    }
}
