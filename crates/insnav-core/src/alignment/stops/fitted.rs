//! Methods that fit the stops: joint regression, Kalman filter, and the paper's equations beside them.

use super::coarse;
use super::free_run::Start;
use super::geometry::{Geometry, geometry};
use super::joint::Joint;
use super::kalman::{self, Filtered};
use super::paper;
use super::problem::Problem;
use super::rates::rate_limit;
use super::rates::{Rates, disagreement, rates};
use super::standing::{Standing, Taper};
use super::sway::PERIODS;
use super::task::Task;
use super::{AlignmentMethod, AlignmentResult, Refusal, StopReport};
use crate::attitude::{Euler, exp, wrap_angle};
use crate::error::Result;
use core::f64::consts::PI;
use nalgebra::{Matrix3, Vector3};
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

/// A smaller turn between stops is none, rad (1°).
const LEAST_TURN: f64 = 0.017_5;
/// Least singular value of the geometry for methods that need the positions to tell drift and azimuth apart.
const LEAST_RATIO: f64 = 0.05;
/// Halves of a stop that differ by more sigmas are no standing.
pub(super) const LARGEST_DISAGREEMENT: f64 = 4.0;
/// Rocking that is too slow for a taper is told from a drift when the stop holds three of its periods: eight over three.
const LEAST_CYCLES: f64 = 2.7;
/// A body whose attitude scatters by more is turned, not rocking, rad rms.
const LARGEST_ROCKING: f64 = 0.1;
/// The Kalman filter's normalised innovations on a quiet base: their mean over thousands stays below.
pub(super) const QUIET_NIS: f64 = 1.3;
/// A heading that is told may differ from the stops' by so many sigmas.
const LARGEST_CONTRADICTION: f64 = 5.0;
/// The horizontal Earth rate may be off by so many sigmas.
const LARGEST_NORM: f64 = 4.0;

impl Task<'_> {
    /// Coarse start at the first stop's begin, turned to a heading that is kept.
    pub(super) fn start(&self, keeps_heading: bool) -> Start {
        let mut start = coarse::inertial_frame(self.record, self.spans[0], &self.place);
        if let Some((heading, _)) = self.options.heading.filter(|_| keeps_heading) {
            let turn = wrap_angle(heading - Euler::from_quaternion(&start.q_nb).heading);
            start.q_nb = exp(&Vector3::new(0.0, 0.0, turn)) * start.q_nb;
        }
        start
    }

    pub(super) fn require_turned(&self) -> Result<()> {
        let largest = self.turns().into_iter().fold(0.0, f64::max);
        if largest < LEAST_TURN {
            return Err(Refusal::MissingRotation {
                turn_deg: largest.to_degrees(),
            }
            .into());
        }
        let error = largest * self.options.gyro_scale_sigma * self.place.horizontal_rate();
        let noise = rate_limit(
            &self.options.noise,
            self.place.gravity,
            self.length(self.spans[0]),
        );
        if error > noise {
            return Err(Refusal::TurnScaleDominates {
                turn_deg: largest.to_degrees(),
                scale_ppm: self.options.gyro_scale_sigma * 1e6,
                error_nrad_per_s: error * 1e9,
                noise_nrad_per_s: noise * 1e9,
            }
            .into());
        }
        Ok(())
    }

    /// The paper's own equations.
    pub(super) fn paper(&self) -> Result<AlignmentResult> {
        let keeps = self.options.heading.is_some();
        let start = self.start(keeps);
        let (drift, azimuth, q_nb) = match self.spans.as_slice() {
            [span] => {
                if self.options.heading.is_none() {
                    return Err(Refusal::MissingRotation { turn_deg: 0.0 }.into());
                }
                let drift = paper::zupt2(self.record, *span, &self.place, &start);
                let azimuth = Euler::from_quaternion(&start.q_nb).heading;
                (drift, azimuth, self.carried(*span, &start))
            }
            [first, .., last] => {
                self.require_turned()?;
                let vertical = self.options.paper_vertical;
                let spans = [*first, *last];
                let found = paper::zupt1(self.record, spans, &self.place, &start, vertical)?;
                (found.drift, found.azimuth, found.q_nb)
            }
            [] => return Err(Refusal::NoStop.into()),
        };
        // The paper gives no covariance: that of the joint regression of the same stops is what its noise would leave at best.
        let problem = self.problem(start, keeps);
        let fit = Joint::fit(&problem, Taper::None, false).ok_or(Refusal::NoData)?;
        let mut result = self.result(
            AlignmentMethod::Paper,
            "asked for; its covariance is that of the joint regression".to_string(),
            q_nb,
            drift,
            Vector3::zeros(),
            fit.covariance,
        );
        self.report(
            &mut result,
            &fit,
            Taper::None,
            &self.halves(&fit, Taper::None),
        );
        result.azimuth = Some(azimuth.rem_euclid(core::f64::consts::TAU));
        Ok(result)
    }

    pub(super) fn problem(&self, start: Start, keeps_heading: bool) -> Problem<'_> {
        let noise = &self.options.noise;
        // Positions that do not tell drift and azimuth apart leave that to what is known beforehand; others are fitted without.
        let apart = keeps_heading || self.shape(&start).ratio >= LEAST_RATIO;
        Problem {
            knowledge: (!apart).then_some([noise.gyro_bias_sigma, noise.accel_bias_sigma]),
            record: self.record,
            place: self.place,
            spans: self.spans.clone(),
            noise: &self.options.noise,
            gyro_scale_sigma: self.options.gyro_scale_sigma,
            heading: self.options.heading,
            keeps_heading,
            prior: None,
            start,
        }
    }

    /// Geometry of the stops by the attitudes at their begins, which the gyros carry.
    pub(super) fn shape(&self, start: &Start) -> Geometry {
        let mut q = start.q_nb;
        let mut next = self.spans[0].begin;
        let mut axes = Vec::with_capacity(self.spans.len());
        for span in &self.spans {
            for node in &self.record.nodes[next..span.begin] {
                q *= node.rotation;
            }
            next = span.begin;
            axes.push(q.to_rotation_matrix().into_inner());
        }
        geometry(&axes)
    }

    /// Kalman filter or joint regression.
    pub(super) fn fitted(&self, asked: AlignmentMethod) -> Result<AlignmentResult> {
        match asked {
            AlignmentMethod::MultiPosition => self.require_turned()?,
            AlignmentMethod::Zupt2 if self.options.heading.is_none() => {
                return Err(Refusal::Option {
                    key: "heading",
                    value: f64::NAN,
                    expected: "given: ZUPT-2 needs the azimuth",
                }
                .into());
            }
            _ => {}
        }
        let keeps = asked == AlignmentMethod::Zupt2;
        if keeps {
            self.require_heading()?;
        }
        let problem = self.problem(self.start(keeps), keeps);
        let plain = Joint::fit(&problem, Taper::None, false).ok_or(Refusal::NoData)?;
        let shape = geometry_of(&plain);
        if asked == AlignmentMethod::MultiPosition && shape.ratio < LEAST_RATIO {
            return Err(paper::singular(&shape));
        }
        let filtered = kalman::filter(&problem, &plain.start);
        let nis = filtered.nis / filtered.dof as f64;
        let halves = self.halves(&plain, Taper::None);
        let quiet = nis < QUIET_NIS && halves.iter().all(|d| *d < LARGEST_DISAGREEMENT);
        let regress = match asked {
            // ZUPT-2 goes into a filter that has its own prior: a regression adds none.
            AlignmentMethod::Joint | AlignmentMethod::Zupt2 => true,
            AlignmentMethod::Kalman | AlignmentMethod::Fine => false,
            _ => !quiet,
        };
        let mut result = if regress {
            let taper = self.options.taper.unwrap_or(if quiet {
                Taper::None
            } else {
                Taper::HannSquared
            });
            let fit = if quiet && taper == Taper::None {
                plain
            } else {
                Joint::fit(&problem, taper, !quiet).ok_or(Refusal::NoData)?
            };
            self.by_joint(asked, &fit, taper, quiet, nis)?
        } else {
            self.by_filter(asked, &plain, &filtered, &halves)?
        };
        result.nis_ratio = Some(nis);
        self.require_latitude(&mut result)?;
        Ok(result)
    }

    /// A heading that is kept must be one that the stops can have.
    pub(super) fn require_heading(&self) -> Result<()> {
        let Some((told, sigma)) = self.options.heading else {
            return Ok(());
        };
        let problem = Problem {
            heading: None,
            ..self.problem(self.start(false), false)
        };
        // Tapered, with what rocking does: the check is for degrees, not for the last minute of arc.
        let fit = Joint::fit(&problem, Taper::HannSquared, true).ok_or(Refusal::NoData)?;
        let found = Euler::from_quaternion(&fit.run.q_nb[0]).heading;
        let own = fit.covariance[(2, 2)].sqrt().hypot(sigma);
        let sigmas = wrap_angle(told - found).abs() / own;
        if sigmas > LARGEST_CONTRADICTION {
            return Err(Refusal::HeadingContradicted {
                told_deg: told.to_degrees(),
                found_deg: found.to_degrees().rem_euclid(360.0),
                sigmas,
            }
            .into());
        }
        Ok(())
    }

    pub(super) fn halves(&self, fit: &Joint, taper: Taper) -> Vec<f64> {
        let noise = &self.options.noise;
        fit.stops
            .iter()
            .map(|s| disagreement(s, &fit.run, &self.place, noise, taper, None).amax())
            .collect()
    }

    pub(super) fn by_filter(
        &self,
        asked: AlignmentMethod,
        fit: &Joint,
        filtered: &Filtered,
        halves: &[f64],
    ) -> Result<AlignmentResult> {
        for (standing, worst) in fit.stops.iter().zip(halves) {
            if *worst > LARGEST_DISAGREEMENT {
                return Err(self.not_stationary(fit, standing, *worst));
            }
        }
        let method = match asked {
            AlignmentMethod::Fine | AlignmentMethod::Zupt2 => asked,
            _ => AlignmentMethod::Kalman,
        };
        let mut result = self.result(
            method,
            self.why(asked, "the base is quiet"),
            filtered.q_nb,
            filtered.gyro_bias,
            filtered.accel_bias,
            filtered.covariance,
        );
        self.report(&mut result, fit, Taper::None, halves);
        Ok(result)
    }

    pub(super) fn by_joint(
        &self,
        asked: AlignmentMethod,
        fit: &Joint,
        taper: Taper,
        quiet: bool,
        nis: f64,
    ) -> Result<AlignmentResult> {
        let noise = &self.options.noise;
        let mut halves = Vec::with_capacity(fit.stops.len());
        for (i, standing) in fit.stops.iter().enumerate() {
            let left = fit.periods_s.get(i).map(|_| fit.residuals[i].as_slice());
            let apart = disagreement(standing, &fit.run, &self.place, noise, taper, left).amax();
            halves.push(apart);
            if apart > LARGEST_DISAGREEMENT {
                let slow = fit
                    .periods_s
                    .get(i)
                    .map(|period| period * PERIODS as f64)
                    .filter(|need_s| (1.0..LEAST_CYCLES).contains(&(need_s / standing.length())));
                return Err(match slow {
                    Some(need_s) if rocking_rms(standing).amax() < LARGEST_ROCKING => {
                        Refusal::StopTooShort {
                            begin_s: self.begin_s(standing.span),
                            have_s: standing.length(),
                            need_s,
                            reason: "it rocks slowly, and a taper needs eight periods of that",
                        }
                        .into()
                    }
                    _ => self.not_stationary(fit, standing, apart),
                });
            }
        }
        let method = match asked {
            AlignmentMethod::Zupt2 => asked,
            _ => AlignmentMethod::Joint,
        };
        let end = fit.run.q_nb[fit.run.q_nb.len() - 1];
        let because = if quiet {
            "the base is quiet"
        } else if nis >= QUIET_NIS {
            "the base rocks"
        } else {
            "the halves of a stop differ without a taper"
        };
        let mut result = self.result(
            method,
            self.why(asked, because),
            end,
            fit.start.gyro_bias,
            fit.start.accel_bias,
            fit.covariance,
        );
        self.report(&mut result, fit, taper, &halves);
        Ok(result)
    }

    pub(super) fn why(&self, asked: AlignmentMethod, because: &str) -> String {
        match asked {
            AlignmentMethod::Auto | AlignmentMethod::MultiPosition => because.to_string(),
            AlignmentMethod::Zupt2 if self.options.method == AlignmentMethod::Auto => {
                format!("a heading is given; {because}")
            }
            _ => format!("asked for; {because}"),
        }
    }

    pub(super) fn not_stationary(
        &self,
        fit: &Joint,
        standing: &Standing,
        worst: f64,
    ) -> crate::error::Error {
        let i = fit
            .stops
            .iter()
            .position(|s| s.span == standing.span)
            .unwrap_or(0);
        Refusal::NotStationary {
            begin_s: self.begin_s(standing.span),
            velocity_rms_m_per_s: velocity_rms(&fit.residuals[i]),
            disagreement_sigma: worst,
        }
        .into()
    }

    /// With two or more positions, whether the horizontal Earth rate is that of the latitude: the paper's unit norm.
    pub(super) fn require_latitude(&self, result: &mut AlignmentResult) -> Result<()> {
        if result.stops.len() < 2 || self.options.heading.is_some() {
            return Ok(());
        }
        let (first, last) = (&result.stops[0], &result.stops[result.stops.len() - 1]);
        let axes = [first, last].map(|s| s.q_nb.to_rotation_matrix().into_inner());
        let Ok((drift, _)) = paper::linear(
            [&first.rate_n, &last.rate_n],
            [&axes[0], &axes[1]],
            &self.place,
        ) else {
            return Ok(());
        };
        let horizontal = self.place.horizontal_rate();
        let left = first.rate_n - axes[0] * drift;
        let residual = left.x.hypot(left.y) / horizontal - 1.0;
        let turn = (axes[1] - axes[0]).fixed_view::<2, 2>(0, 0).norm() / 8f64.sqrt();
        // Two rates, what the gyros wander between them, and what their scale error makes of the turn.
        let apart = last.begin.since(first.begin);
        let noise = &self.options.noise;
        let wander = 2.0 * noise.gyro_bias_sigma.powi(2) / noise.gyro_bias_tau * apart;
        let scale = self.options.gyro_scale_sigma * PI * horizontal;
        let variance = first.sigma_rate.x.powi(2) + last.sigma_rate.x.powi(2);
        let sigma = (variance + wander + scale * scale).sqrt() / (2.0 * turn * horizontal);
        result.norm_residual = Some([residual, sigma]);
        let sigmas = residual.abs() / sigma;
        if sigmas > LARGEST_NORM && turn > 0.1 {
            return Err(Refusal::LatitudeInconsistent {
                norm_residual: residual,
                sigmas,
            }
            .into());
        }
        Ok(())
    }

    pub(super) fn report(
        &self,
        result: &mut AlignmentResult,
        fit: &Joint,
        taper: Taper,
        halves: &[f64],
    ) {
        let noise = &self.options.noise;
        result.stops = fit
            .stops
            .iter()
            .enumerate()
            .map(|(i, standing)| {
                let all = (0, standing.t.len() - 1);
                let Rates { rate_n, sigma } =
                    rates(standing, &fit.run, &self.place, noise, taper, all);
                let through = standing.axes_n * fit.start.gyro_bias;
                StopReport {
                    begin: self.record.times[standing.span.begin],
                    end: self.record.times[standing.span.end],
                    rate_n: self.place.earth_n + through + rate_n,
                    residual_rate_n: rate_n,
                    sigma_rate: sigma,
                    q_nb: standing.q_nb,
                    rocking_rms: rocking_rms(standing),
                    velocity_rms: velocity_rms(&fit.residuals[i]),
                    taper,
                    half_disagreement: halves[i],
                    rocking_period_s: fit
                        .periods_s
                        .get(i)
                        .copied()
                        .filter(|period| period * PERIODS as f64 <= standing.length()),
                }
            })
            .collect();
        let shape = geometry_of(fit);
        result.weakest = shape.weakest;
        result.geometry_ratio = shape.ratio;
        let q = fit.run.q_nb[0];
        result.azimuth = Some(
            Euler::from_quaternion(&q)
                .heading
                .rem_euclid(core::f64::consts::TAU),
        );
    }
}

fn geometry_of(fit: &Joint) -> Geometry {
    let axes: Vec<Matrix3<f64>> = fit
        .stops
        .iter()
        .map(|s| s.q_nb.to_rotation_matrix().into_inner())
        .collect();
    geometry(&axes)
}

fn rocking_rms(standing: &Standing) -> Vector3<f64> {
    let count = standing.rocking.len() as f64;
    let squares: Vector3<f64> = standing.rocking.iter().map(|r| r.component_mul(r)).sum();
    (squares / count).map(f64::sqrt)
}

pub(super) fn velocity_rms(residuals: &[Vector3<f64>]) -> f64 {
    let squares: f64 = residuals.iter().map(|r| r.xy().norm_squared()).sum();
    (squares / residuals.len() as f64).sqrt()
}
