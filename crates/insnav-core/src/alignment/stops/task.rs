//! The data and the question together: what stands against an answer, and the form that every answer has.

use super::geometry::geometry;
use super::joint::GLOBAL;
use super::level;
use super::options::AlignmentOptions;
use super::place::Place;
use super::rates::rate_limit;
use super::record::{Record, Span};
use super::{AlignmentMethod, AlignmentResult, Refusal};
use crate::earth::EARTH_RATE;
use crate::error::Result;
use nalgebra::{Matrix3, SMatrix, UnitQuaternion, Vector3};
use std::string::String;
use std::vec::Vec;

/// The shortest stop from which a rate is taken, s.
pub(super) const SHORTEST: f64 = 40.0;
/// Windows are cut to whole nodes: a tenth of a second may be missing at each end, s.
pub(super) const TOLERANCE: f64 = 0.25;
/// Means of the halves of a stop that is only levelled: their sigmas are those of a class, and units differ within it.
const LARGEST_DIFFERENCE: f64 = 6.0;

/// Why a short stop does not do.
pub(super) const BEND: &str =
    "the Earth's rate is seen by the bend of the velocity, which grows with the square of time";

pub(super) struct Task<'a> {
    pub(super) record: &'a Record,
    pub(super) place: Place,
    pub(super) spans: Vec<Span>,
    pub(super) options: &'a AlignmentOptions,
}

impl Task<'_> {
    pub(super) fn whole(&self) -> Span {
        Span {
            begin: self.spans[0].begin,
            end: self.spans[self.spans.len() - 1].end,
        }
    }

    pub(super) fn length(&self, span: Span) -> f64 {
        self.record.seconds(span.begin, span.end)
    }

    pub(super) fn begin_s(&self, span: Span) -> f64 {
        self.record.times[span.begin].seconds()
    }

    pub(super) fn require_long(&self) -> Result<()> {
        for span in &self.spans {
            let have_s = self.length(*span);
            if have_s < SHORTEST - TOLERANCE {
                return Err(Refusal::StopTooShort {
                    begin_s: self.begin_s(*span),
                    have_s,
                    need_s: SHORTEST,
                    reason: BEND,
                }
                .into());
            }
        }
        Ok(())
    }

    /// Turn of the body from the first stop to each other one, by the gyros, less what their biases may have made of it, rad.
    pub(super) fn turns(&self) -> Vec<f64> {
        let first = self.spans[0].end;
        self.spans[1..]
            .iter()
            .map(|span| {
                let turn = self.record.nodes[first..span.begin]
                    .iter()
                    .fold(UnitQuaternion::identity(), |q, node| q * node.rotation);
                let drifted = 3.0 * self.options.noise.gyro_bias_sigma + EARTH_RATE;
                (turn.angle() - drifted * self.record.seconds(first, span.begin)).max(0.0)
            })
            .collect()
    }

    /// Sigma that the azimuth will have, from noise, biases, lengths and turns alone, rad.
    pub(super) fn predicted_azimuth_sigma(&self) -> f64 {
        let noise = &self.options.noise;
        let (g, horizontal) = (self.place.gravity, self.place.horizontal_rate());
        let rate = |span: &Span| rate_limit(noise, g, self.length(*span));
        let best = self.spans.iter().map(rate).fold(f64::INFINITY, f64::min);
        let tilt = self.place.tan_latitude * noise.accel_bias_sigma / g;
        let single = (best / horizontal)
            .hypot(noise.gyro_bias_sigma / horizontal)
            .hypot(tilt);
        self.turns()
            .iter()
            .zip(&self.spans[1..])
            .map(|(turn, span)| {
                let both = rate(&self.spans[0]).hypot(rate(span)) / 2.0;
                both / ((0.5 * turn).sin().abs().max(1e-9) * horizontal)
            })
            .fold(single, f64::min)
    }

    /// The accelerometers must feel gravity: wrong units are found nowhere else.
    pub(super) fn require_gravity(&self) -> Result<()> {
        let allowed = (0.05 * self.place.gravity).max(5.0 * self.options.noise.accel_bias_sigma);
        for span in &self.spans {
            let nodes = &self.record.nodes[span.begin..span.end];
            let felt: f64 = nodes.iter().map(|node| node.gain.norm()).sum();
            let force = felt / self.length(*span);
            if (force - self.place.gravity).abs() > allowed {
                return Err(Refusal::NotGravity {
                    begin_s: self.begin_s(*span),
                    force_m_per_s2: force,
                    gravity_m_per_s2: self.place.gravity,
                }
                .into());
            }
        }
        Ok(())
    }

    /// For methods without a fit through the stop: its halves have the same means.
    pub(super) fn require_still(&self, span: Span) -> Result<()> {
        let difference_sigma = level::halves(self.record, span, &self.options.noise);
        if difference_sigma > LARGEST_DIFFERENCE {
            return Err(Refusal::Moving {
                begin_s: self.begin_s(span),
                difference_sigma,
            }
            .into());
        }
        Ok(())
    }

    pub(super) fn result(
        &self,
        method: AlignmentMethod,
        reason: String,
        q_nb: UnitQuaternion<f64>,
        gyro_bias: Vector3<f64>,
        accel_bias: Vector3<f64>,
        covariance: SMatrix<f64, GLOBAL, GLOBAL>,
    ) -> AlignmentResult {
        let axes: Vec<Matrix3<f64>> = std::vec![q_nb.to_rotation_matrix().into_inner()];
        let shape = geometry(&axes);
        let mut result = AlignmentResult {
            method,
            reason,
            at: self.record.times[self.whole().end],
            q_nb,
            azimuth: None,
            gyro_bias,
            accel_bias,
            covariance: (covariance + covariance.transpose()) * 0.5,
            observable: [true; 9],
            azimuth_sigma: covariance[(2, 2)].sqrt(),
            weakest: shape.weakest,
            geometry_ratio: shape.ratio,
            norm_residual: None,
            nis_ratio: None,
            stops: Vec::new(),
        };
        self.judge(&mut result);
        result
    }

    pub(super) fn judge(&self, result: &mut AlignmentResult) {
        let noise = &self.options.noise;
        let sigma = result.sigma();
        for i in 0..3 {
            result.observable[i] = sigma[i] <= self.options.largest_azimuth_sigma;
            result.observable[3 + i] = sigma[3 + i] < 0.9 * noise.gyro_bias_sigma;
            result.observable[6 + i] = sigma[6 + i] < 0.9 * noise.accel_bias_sigma;
        }
        result.azimuth_sigma = sigma[2];
    }
}
