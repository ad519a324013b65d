//! Autocovariance least squares on blocks of the filter's own innovations, as \[Belokurov18\] feeds it back.

use super::adaptation::WINDOW;
use crate::ahrs::{AttitudeChannelNoise, InvariantFilter};
use crate::error::Result;
use crate::noise::{ChannelDesign, ChannelNoise};
use crate::sim::AttitudeRecord;
use nalgebra::{Matrix2, Matrix3, RowVector2, Vector2, Vector3};

/// What comes out negative is replaced by this share of the start; the paper does not tell what it does.
const FLOOR: f64 = 0.01;

/// Innovations of a block, and the gain that it began with.
#[derive(Clone, Debug)]
pub(super) struct Blocks {
    innovations: [[f64; WINDOW]; 3],
    filled: usize,
    gains: [Vector2<f64>; 3],
    step_s: f64,
    start: AttitudeChannelNoise,
    bias_noise: f64,
    constrained: bool,
}

impl Blocks {
    /// Eq. (8): least squares without constraint, the noise of the bias unknown as well.
    pub(super) fn as_printed(record: &AttitudeRecord) -> Self {
        Blocks {
            innovations: [[0.0; WINDOW]; 3],
            filled: 0,
            gains: [Vector2::zeros(); 3],
            step_s: record.step_s,
            start: record.datasheet,
            bias_noise: record.bias_noise,
            constrained: false,
        }
    }

    /// Non-negative, the noise of the bias known.
    pub(super) fn nonnegative(record: &AttitudeRecord) -> Self {
        Blocks {
            constrained: true,
            ..Blocks::as_printed(record)
        }
    }

    /// Take an innovation of angles (rad); at the end of a block its noise, and that of the biases.
    pub(super) fn push(
        &mut self,
        filter: &InvariantFilter,
        innovation: &Vector3<f64>,
    ) -> Option<(AttitudeChannelNoise, [f64; 3])> {
        if self.filled == 0 {
            // The design wants a constant gain: this one, though the filter's goes on (E12).
            let angles = filter.gain.fixed_view::<3, 3>(0, 0);
            let c = filter.q_nb.to_rotation_matrix();
            let biases: Matrix3<f64> = c.matrix() * filter.gain.fixed_view::<3, 3>(3, 0);
            // Gains of half angles: on angles, half of a bias' gain.
            self.gains =
                core::array::from_fn(|i| Vector2::new(angles[(i, i)], 0.5 * biases[(i, i)]));
        }
        for (axis, nu) in self.innovations.iter_mut().zip(innovation.iter()) {
            axis[self.filled] = *nu;
        }
        self.filled += 1;
        if self.filled < WINDOW {
            return None;
        }
        self.filled = 0;
        let mut bias = [self.bias_noise; 3];
        let mut found = self.start;
        let [north, east] = &mut found.tilt;
        for (i, channel) in [north, east, &mut found.heading].into_iter().enumerate() {
            // An axis that is not measured has no gain, and what begins has one that is not stable: as it was.
            let Ok(theta) = self.solve(i) else {
                continue;
            };
            *channel = ChannelNoise {
                process: theta[0].max(FLOOR * channel.process),
                measured: theta[2].max(FLOOR * channel.measured),
            };
            bias[i] = theta[1].max(FLOOR * self.bias_noise);
        }
        Some((found, bias))
    }

    fn solve(&self, axis: usize) -> Result<[f64; 3]> {
        let nu = &self.innovations[axis];
        let covariances: [f64; WINDOW] = core::array::from_fn(|j| {
            let products = nu[..WINDOW - j].iter().zip(&nu[j..]).map(|(a, b)| a * b);
            products.sum::<f64>() / (WINDOW - j) as f64
        });
        let f = Matrix2::new(1.0, -self.step_s, 0.0, 1.0);
        let design =
            ChannelDesign::<WINDOW>::new(&f, &RowVector2::new(1.0, 0.0), &self.gains[axis])?;
        if self.constrained {
            return design.solve(&covariances, [None, Some(self.bias_noise), None]);
        }
        let columns = design.columns();
        let dot = |a: &[f64; WINDOW], b: &[f64; WINDOW]| -> f64 {
            a.iter().zip(b).map(|(a, b)| a * b).sum()
        };
        let lengths = columns.each_ref().map(|column| dot(column, column).sqrt());
        let normal =
            Matrix3::from_fn(|i, j| dot(&columns[i], &columns[j]) / (lengths[i] * lengths[j]));
        let right = Vector3::from_fn(|i, _| dot(&columns[i], &covariances) / lengths[i]);
        let theta = normal
            .lu()
            .solve(&right)
            .unwrap_or_else(|| Vector3::repeat(f64::NAN));
        Ok(core::array::from_fn(|i| theta[i] / lengths[i]))
    }
}
