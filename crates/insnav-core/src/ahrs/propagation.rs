//! The covariance of the orientation filter from one correction to the next, by rows and columns that change only.

use super::state::{
    ACCEL_BIAS, ATTITUDE, Covariance, DELAY, DISTURBANCE, Errors, FIELD, GYRO_BIAS, OFFSET,
    VELOCITY,
};
use crate::attitude::skew;
use nalgebra::{Matrix3, Vector3};

/// Error dynamics over an interval: what attitude and velocity take up, what of a disturbance is left.
///
/// ```text
/// θ₊ = θ − ∫C dt b_g        v₊ = v + (g t)× θ − ∫C dt b_a        d₊ = ρ d
/// ```
///
/// Velocity errors see gravity alone, not the force that was measured: a carrier's acceleration would seem to tell the heading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Propagation {
    /// ∫C dt, s.
    pub(super) turned: Matrix3<f64>,
    /// Force of a body at rest over the interval, −g t, m/s.
    pub(super) pushed: Vector3<f64>,
    /// What is left of the disturbance, ρ.
    pub(super) disturbance_left: f64,
    /// Variances that are added to all states.
    pub(super) noise: Errors,
    /// Attitude noise beside, of gyros that saturate, rad².
    pub(super) unseen_turn: Matrix3<f64>,
}

impl Propagation {
    /// P ← Φ P Φᵀ + Q.
    pub(super) fn apply(&self, p: &mut Covariance) {
        self.rows(p);
        p.transpose_mut();
        self.rows(p);
        for i in 0..p.nrows() {
            p[(i, i)] += self.noise[i];
            for j in 0..i {
                let mean = 0.5 * (p[(i, j)] + p[(j, i)]);
                p[(i, j)] = mean;
                p[(j, i)] = mean;
            }
        }
        let mut attitude = p.fixed_view_mut::<3, 3>(ATTITUDE, ATTITUDE);
        attitude += self.unseen_turn;
    }

    /// M ← Φ M.
    pub(super) fn rows(&self, m: &mut Covariance) {
        let tilt = skew(&self.pushed);
        for mut column in m.column_iter_mut() {
            let part = |at: usize| Vector3::new(column[at], column[at + 1], column[at + 2]);
            let velocity = tilt * part(ATTITUDE) + self.turned * part(ACCEL_BIAS);
            let attitude = self.turned * part(GYRO_BIAS);
            for i in 0..3 {
                column[VELOCITY + i] -= velocity[i];
                column[ATTITUDE + i] -= attitude[i];
                column[DISTURBANCE + i] *= self.disturbance_left;
            }
        }
    }
}

/// Variances in the order of the states.
pub(super) struct Variances {
    pub(super) attitude: f64,
    pub(super) gyro_bias: f64,
    pub(super) velocity: f64,
    pub(super) accel_bias: f64,
    pub(super) field: f64,
    pub(super) offset: f64,
    pub(super) disturbance: f64,
    pub(super) delay: f64,
}

impl Variances {
    pub(super) fn all(&self) -> Errors {
        let mut all = Errors::zeros();
        for (at, count, value) in [
            (ATTITUDE, 3, self.attitude),
            (GYRO_BIAS, 3, self.gyro_bias),
            (VELOCITY, 3, self.velocity),
            (ACCEL_BIAS, 3, self.accel_bias),
            (FIELD, 2, self.field),
            (OFFSET, 3, self.offset),
            (DISTURBANCE, 3, self.disturbance),
            (DELAY, 1, self.delay),
        ] {
            all.rows_mut(at, count).fill(value);
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_columns_are_phi_p_phi_transposed() {
        let propagation = Propagation {
            turned: Matrix3::new(0.9, 0.1, -0.2, 0.3, 0.8, 0.1, -0.1, 0.2, 0.7),
            pushed: Vector3::new(0.1, -0.2, -0.5),
            disturbance_left: 0.95,
            noise: Errors::from_fn(|i, _| 0.1 * i as f64),
            unseen_turn: Matrix3::identity() * 0.5,
        };
        let mut phi = Covariance::identity();
        propagation.rows(&mut phi);
        let root = Covariance::from_fn(|i, j| ((i * 7 + j * 3) % 11) as f64 * 0.1 - 0.5);
        let p = root * root.transpose();
        let mut expected =
            phi * p * phi.transpose() + Covariance::from_diagonal(&propagation.noise);
        for i in 0..3 {
            expected[(i, i)] += 0.5;
        }
        let mut got = p;
        propagation.apply(&mut got);
        assert!((got - expected).amax() < 1e-12);
        assert_eq!(got, got.transpose());
    }

    /// Attitude and velocity of a body that turns at rest, by the nominal integration, against Φ: central differences.
    #[test]
    fn phi_is_the_derivative_of_the_integration() {
        use super::super::state::State;
        use crate::attitude::exp;
        let (step, gravity, turns) = (0.002, 9.81, 20);
        let rate = Vector3::new(0.4, -0.7, 0.9);
        let from = State::at(exp(&Vector3::new(0.3, -0.2, 1.2)));
        let attitude = |k: f64| from.attitude * exp(&(rate * (step * k)));
        let run = |start: State| {
            let (mut end, mut turned) = (start, Matrix3::zeros());
            for k in 0..turns {
                let force =
                    attitude(f64::from(k) + 0.5).conjugate() * Vector3::new(0.0, 0.0, -gravity);
                let turn = (rate - end.gyro_bias) * step;
                let middle = end.attitude * exp(&(turn * 0.5));
                turned += middle.to_rotation_matrix().into_inner() * step;
                end.velocity +=
                    (middle * (force - end.accel_bias) + Vector3::new(0.0, 0.0, gravity)) * step;
                end.attitude *= exp(&turn);
            }
            (end, turned)
        };
        let (end, turned) = run(from);
        let time = step * f64::from(turns);
        let propagation = Propagation {
            turned,
            pushed: Vector3::new(0.0, 0.0, -gravity * time),
            disturbance_left: 1.0,
            noise: Errors::zeros(),
            unseen_turn: Matrix3::zeros(),
        };
        let mut phi = Covariance::identity();
        propagation.rows(&mut phi);
        let by = 1e-5;
        for j in 0..FIELD {
            let beside = |by: f64| {
                let mut errors = Errors::zeros();
                errors[j] = by;
                run(from.corrected(&errors)).0.less(&end)
            };
            let slope = (beside(by) - beside(-by)) / (2.0 * by);
            // A bias tilts the axes by half of b t meanwhile, which Φ leaves out: g t²/2.
            let left_out = if (GYRO_BIAS..VELOCITY).contains(&j) {
                0.6 * gravity * time * time
            } else {
                1e-7
            };
            assert!((slope - phi.column(j)).amax() < left_out, "state {j}");
        }
    }
}
