//! The measurements of an interval: a velocity about zero, a rate at rest, a field.

use super::block::Block;
use super::settings::FieldSettings;
use super::state::{
    ACCEL_BIAS, ATTITUDE, Covariance, DELAY, DISTURBANCE, Errors, FIELD, OFFSET, SIZE, State,
    VELOCITY,
};
use crate::attitude::skew;
#[cfg(not(feature = "std"))]
use nalgebra::ComplexField;
use nalgebra::{Matrix3, SMatrix, Vector3};

/// States that no field corrects: tilt, velocity, accelerometer bias.
const CONSIDERED: [usize; 8] = [
    ATTITUDE,
    ATTITUDE + 1,
    VELOCITY,
    VELOCITY + 1,
    VELOCITY + 2,
    ACCEL_BIAS,
    ACCEL_BIAS + 1,
    ACCEL_BIAS + 2,
];

/// A tilt known worse than this is lost, rad.
const TILT_LOST: f64 = 0.12;

/// Errors and covariance while measurements are taken one after the other about the same estimate.
pub(super) struct Correction<'a> {
    pub(super) errors: Errors,
    pub(super) covariance: &'a mut Covariance,
}

/// What a field is to the filter: its residual with matrix and noise, and the residual's square in units of what was expected.
pub(super) struct FieldResidual {
    residual: Vector3<f64>,
    gain_rows: SMatrix<f64, SIZE, 3>,
    expected: Matrix3<f64>,
    /// Normalised innovation squared, a third of it: one is what is expected.
    pub(super) ratio: f64,
}

impl<'a> Correction<'a> {
    pub(super) fn new(covariance: &'a mut Covariance) -> Self {
        Correction {
            errors: Errors::zeros(),
            covariance,
        }
    }

    /// State `at` of the errors is measured to be `residual`.
    pub(super) fn state(&mut self, at: usize, residual: f64, variance: f64) {
        let column = self.covariance.column(at).into_owned();
        let expected = column[at] + variance;
        let innovation = residual - self.errors[at];
        self.errors.axpy(innovation / expected, &column, 1.0);
        subtract_square(self.covariance, &(column / expected.sqrt()));
    }

    /// What the mean field of a block says, `None` where that is not positive definite.
    ///
    /// ```text
    /// C m − (h + d) − C o = δh + δd + C δo + (h + d)× θ + (∂/∂τ) δτ
    /// ```
    pub(super) fn field(
        &self,
        state: &State,
        block: &Block,
        scale: f64,
        settings: &FieldSettings,
    ) -> Option<FieldResidual> {
        let count = f64::from(block.fields);
        let (mean, turned) = (block.field / count, block.attitudes / count);
        let (outer, per_delay) = (state.outer_field(), block.per_delay / count);
        let about = skew(&outer);
        // P Hᵀ, by the columns of P that H takes.
        let p = &*self.covariance;
        let mut gain_rows = SMatrix::<f64, SIZE, 3>::zeros();
        let field_state = [Some(FIELD), None, Some(FIELD + 1)];
        for row in 0..3 {
            let mut column = p.column(DISTURBANCE + row).into_owned();
            for k in 0..3 {
                column.axpy(about[(row, k)], &p.column(ATTITUDE + k), 1.0);
                column.axpy(turned[(row, k)], &p.column(OFFSET + k), 1.0);
            }
            column.axpy(per_delay[row], &p.column(DELAY), 1.0);
            if let Some(at) = field_state[row] {
                column += p.column(at);
            }
            gain_rows.set_column(row, &column);
        }
        let times_h = |x: &dyn Fn(usize) -> f64, row: usize| {
            let mut sum = x(DISTURBANCE + row) + per_delay[row] * x(DELAY);
            for k in 0..3 {
                sum += about[(row, k)] * x(ATTITUDE + k) + turned[(row, k)] * x(OFFSET + k);
            }
            sum + field_state[row].map_or(0.0, x)
        };
        let independent = count.min((block.time * settings.rate_hz).max(1.0));
        let variance = (settings.sigma * scale).powi(2) / independent
            + settings.stamp_sigma.powi(2) * block.per_stamp_squared / count;
        let expected = Matrix3::from_fn(|i, j| {
            times_h(&|at| gain_rows[(at, j)], i) + if i == j { variance } else { 0.0 }
        });
        let residual = mean - outer - turned * state.offset;
        let innovation = residual - Vector3::from_fn(|i, _| times_h(&|at| self.errors[at], i));
        let weighed = expected.cholesky()?.solve(&innovation);
        Some(FieldResidual {
            residual: innovation,
            gain_rows,
            expected,
            ratio: innovation.dot(&weighed) / 3.0,
        })
    }

    /// Takes a field that is believed: for the heading and what is magnetic. Tilt, velocity and accelerometer bias are considered, not
    /// corrected: gravity tells them, and a field that is not the Earth's must never turn them. A tilt that is lost
    /// (saturated gyros, a start in motion) is helped by any field.
    pub(super) fn take(&mut self, field: &FieldResidual) {
        let Some(root) = field.expected.cholesky() else {
            return;
        };
        // W = P Hᵀ L⁻ᵀ, so that P − W Wᵀ stays symmetric to the last bit.
        let lower = root.l();
        let Some(w_t) = lower.solve_lower_triangular(&field.gain_rows.transpose()) else {
            return;
        };
        let Some(white) = lower.solve_lower_triangular(&field.residual) else {
            return;
        };
        let tilt = self.covariance[(ATTITUDE, ATTITUDE)]
            .max(self.covariance[(ATTITUDE + 1, ATTITUDE + 1)]);
        let tilt_lost = tilt > TILT_LOST * TILT_LOST;
        let kept = |p: &Covariance, e: &Errors| {
            let errors = CONSIDERED.map(|i| e[i]);
            (CONSIDERED.map(|i| CONSIDERED.map(|j| p[(i, j)])), errors)
        };
        let (block, errors) = kept(self.covariance, &self.errors);
        for k in 0..3 {
            let w = w_t.row(k).transpose();
            self.errors.axpy(white[k], &w, 1.0);
            subtract_square(self.covariance, &w);
        }
        if tilt_lost {
            return;
        }
        for (a, &i) in CONSIDERED.iter().enumerate() {
            self.errors[i] = errors[a];
            for (b, &j) in CONSIDERED.iter().enumerate() {
                self.covariance[(i, j)] = block[a][b];
            }
        }
    }
}

/// P ← P − w wᵀ, symmetric to the last bit.
fn subtract_square(p: &mut Covariance, w: &Errors) {
    for j in 0..SIZE {
        p.column_mut(j).axpy(-w[j], w, 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::exp;
    use nalgebra::{UnitQuaternion, Vector2};

    fn state() -> State {
        State {
            field: Vector2::new(0.4, 0.9),
            offset: Vector3::new(0.05, -0.02, 0.03),
            disturbance: Vector3::new(-0.03, 0.06, 0.02),
            delay: 0.01,
            ..State::at(exp(&Vector3::new(0.2, -0.4, 1.1)))
        }
    }

    /// A block of three fields as a body of that truth would measure them, taken with the attitudes of `estimate`.
    fn block(truth: &State, estimate: &State) -> Block {
        let mut block = Block {
            time: 0.05,
            ..Block::default()
        };
        for k in 0..3 {
            let since = exp(&Vector3::new(0.1 * k as f64, 0.3, -0.2 * k as f64));
            let rate = Vector3::new(2.0, -1.0, 0.5 + k as f64);
            let at =
                |s: &State| -> UnitQuaternion<f64> { s.attitude * since * exp(&(-rate * s.delay)) };
            let measured = at(truth).conjugate() * truth.outer_field() + truth.offset;
            let axes = at(estimate).to_rotation_matrix().into_inner();
            block.fields += 1;
            block.field += axes * measured;
            block.attitudes += axes;
            block.per_delay += (axes * rate).cross(&estimate.outer_field());
        }
        block
    }

    fn residual_and_rows(
        truth: &State,
        p: &mut Covariance,
    ) -> (Vector3<f64>, SMatrix<f64, SIZE, 3>) {
        let settings = FieldSettings::default();
        let estimate = state();
        let field = Correction::new(p)
            .field(&estimate, &block(truth, &estimate), 1.0, &settings)
            .expect("positive");
        (field.residual, field.gain_rows)
    }

    /// With P = 1, P Hᵀ is Hᵀ; central differences of what a truth beside the estimate would show.
    #[test]
    fn rows_are_the_derivatives_of_the_residual() {
        let mut one = Covariance::identity();
        let (none, rows) = residual_and_rows(&state(), &mut one);
        assert!(none.norm() < 1e-12);
        let step = 1e-5;
        for j in 0..SIZE {
            let beside = |by: f64| {
                let mut errors = Errors::zeros();
                errors[j] = by;
                residual_and_rows(&state().corrected(&errors), &mut Covariance::identity()).0
            };
            let slope = (beside(step) - beside(-step)) / (2.0 * step);
            let row = rows.row(j).transpose();
            assert!((slope - row).norm() < 1e-8, "state {j}: {slope} {row}");
        }
    }

    /// Joseph's form, true for any gain: with the rows of considered states at zero while the tilt is known, in full while it is lost.
    #[test]
    fn considered_states_stay_and_the_covariance_is_that_of_the_gain() {
        for tilt_sigma in [0.01, 0.5] {
            let root = Covariance::from_fn(|i, j| {
                let off = ((i * 7 + j * 5) % 13) as f64 * 0.02 - 0.12;
                (if i == j { 1.0 } else { off }) * if i < 2 { tilt_sigma } else { 0.3 }
            });
            let prior = root * root.transpose();
            let mut truth = Errors::zeros();
            truth.fixed_rows_mut::<3>(OFFSET).fill(0.02);
            let (estimate, settings) = (state(), FieldSettings::default());
            let block = block(&estimate.corrected(&truth), &estimate);
            let (_, rows) = residual_and_rows(&estimate, &mut Covariance::identity());
            let mut p = prior;
            let mut correction = Correction::new(&mut p);
            let field = correction
                .field(&estimate, &block, 1.0, &settings)
                .expect("positive");
            correction.take(&field);
            let errors = correction.errors;
            let h = rows.transpose();
            let noise = field.expected - h * prior * rows;
            let mut gain = prior * rows * field.expected.try_inverse().expect("regular");
            if tilt_sigma < 0.1 {
                for i in CONSIDERED {
                    gain.row_mut(i).fill(0.0);
                }
            }
            let left = Covariance::identity() - gain * h;
            let joseph = left * prior * left.transpose() + gain * noise * gain.transpose();
            assert!((p - joseph).amax() < 1e-12 * prior.amax(), "{tilt_sigma}");
            assert!((errors - gain * field.residual).amax() < 1e-12);
            assert_eq!(p, p.transpose());
        }
    }
}
