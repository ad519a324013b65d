//! What a stop that was looked at as a whole says to the filter that came into it.

use super::eskf::Eskf;
use super::layout::{ACCEL_BIAS, ATTITUDE, CAPACITY, GYRO_BIAS};
use super::standing::Settling;
use crate::alignment::{BeforeStop, FusedStop};
use nalgebra::SMatrix;

/// Attitude, gyro bias, accelerometer bias.
const OWN: usize = 9;

type Own = SMatrix<f64, OWN, OWN>;

impl Eskf {
    /// What is known at the begin of a stop.
    pub fn before_stop(&self) -> BeforeStop {
        let rows = self.own_rows();
        BeforeStop {
            position: self.nominal.nav.position,
            q_nb: self.nominal.nav.q_nb,
            gyro_bias: self.nominal.imu_errors.gyro_bias,
            accel_bias: self.nominal.imu_errors.accel_bias,
            covariance: Own::from_fn(|i, j| self.covariance.get(rows[i], rows[j])),
        }
    }

    /// Go from the begin of a stop, where [`Eskf::before_stop`] was asked, to its end.
    ///
    /// Attitude and biases become what the whole stop says of its end. All other states y were tied to them at the begin, x₀, and
    /// follow what the stop says of that: with G = P_yx P_xx⁻¹, y moves by G x̂₀ and its covariance by G (P₀₀ − P_xx) Gᵀ, and it is
    /// tied to the end by G P₀₁. That is all that inertial data of a body which stands can tell of them. The velocity is what the
    /// stop shows, and tied to nothing.
    ///
    /// `false`, and nothing is changed, where what was known of the begin is no covariance that has an inverse.
    pub fn pass_stop(&mut self, stop: &FusedStop, settling: &Settling) -> bool {
        self.settle();
        let before = self.before_stop();
        let rows = self.own_rows();
        // Unknowns differ by eight orders of magnitude.
        let scale = before.covariance.map_diagonal(|v| v.sqrt().recip());
        let scaled = Own::from_fn(|i, j| before.covariance[(i, j)] * scale[i] * scale[j]);
        let Some(factor) = scaled.cholesky() else {
            return false;
        };
        let n = self.covariance.layout().len();
        let block = |i, j| stop.covariance.fixed_view::<OWN, OWN>(i, j).into_owned();
        let learnt = block(0, 0) - before.covariance;
        let with_end = block(0, OWN);

        let mut gain = [[0.0; OWN]; CAPACITY];
        for (i, gain) in gain.iter_mut().enumerate().take(n) {
            let own =
                SMatrix::<f64, OWN, 1>::from_fn(|j, _| self.covariance.get(i, rows[j]) * scale[j]);
            let solved = factor.solve(&own);
            for j in 0..OWN {
                gain[j] = solved[j] * scale[j];
            }
        }
        let is_own = |i: usize| rows.contains(&i);
        let dt = stop.at.since(self.nominal.nav.time);
        let mut dx = [0.0; CAPACITY];
        for i in (0..n).filter(|i| !is_own(*i)) {
            dx[i] = (0..OWN)
                .map(|k| gain[i][k] * stop.correction_at_begin[k])
                .sum();
            for j in (0..=i).filter(|j| !is_own(*j)) {
                let mut x = self.covariance.get(i, j);
                for a in 0..OWN {
                    for b in 0..OWN {
                        x += gain[i][a] * learnt[(a, b)] * gain[j][b];
                    }
                }
                self.covariance.set(i, j, x);
                self.covariance.set(j, i, x);
            }
        }
        self.nominal = self.nominal.retract(self.covariance.layout(), &dx);
        // The others age; what becomes of attitude and biases meanwhile is in the stop's own covariance.
        self.stay(stop.at, dt, settling);
        let decay = self.phi.decay;
        for i in (0..n).filter(|i| !is_own(*i)) {
            for (j, row) in rows.into_iter().enumerate() {
                let x: f64 = (0..OWN).map(|k| gain[i][k] * with_end[(k, j)]).sum();
                self.covariance.set(i, row, x * decay[i]);
                self.covariance.set(row, i, x * decay[i]);
            }
        }
        let end = block(OWN, OWN);
        for (i, row) in rows.into_iter().enumerate() {
            for (j, column) in rows.into_iter().enumerate() {
                let x = 0.5 * (end[(i, j)] + end[(j, i)]);
                self.covariance.set(row, column, x);
            }
        }
        if let Some(shares) = &mut self.shares {
            shares.lose();
        }
        self.nominal.nav.q_nb = stop.q_nb;
        self.nominal.held_q_nb = stop.q_nb;
        self.nominal.imu_errors.gyro_bias = stop.gyro_bias;
        self.nominal.imu_errors.accel_bias = stop.accel_bias;
        self.nominal.nav.velocity_n = stop.velocity_n[1];
        self.forget_velocity(stop.velocity_sigma);
        true
    }

    fn own_rows(&self) -> [usize; OWN] {
        let layout = self.covariance.layout();
        let mut rows = [0; OWN];
        for (part, block) in [ATTITUDE, GYRO_BIAS, ACCEL_BIAS].into_iter().enumerate() {
            for (k, row) in layout.range(block).into_iter().flatten().enumerate() {
                rows[3 * part + k] = row;
            }
        }
        rows
    }
}
