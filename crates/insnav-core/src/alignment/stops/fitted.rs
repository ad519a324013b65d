//! Methods that fit the stops: joint regression, Kalman filter, and the paper's equations beside them.

use super::earth_rate::earth_rate;
use super::free_run::{FreeRun, Start};
use super::geometry::{Geometry, geometry};
use super::joint::{GLOBAL, Joint, MOST_PASSES, SETTLED};
use super::kalman::{self, Filtered};
use super::paper;
use super::problem::Problem;
use super::rates::rate_limit;
use super::rates::{Rates, disagreement, leak, rates};
use super::standing::{Standing, Taper};
use super::sway::PERIODS;
use super::task::Task;
use super::{AlignmentMethod, AlignmentResult, Refusal, StopReport};
use crate::attitude::{Euler, log, wrap_angle};
use crate::error::Result;
use nalgebra::{Matrix3, SVector, Vector3};
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
/// The Earth rate may be off by so many sigmas; units of a class differ: of their bias sigma once and a half counts.
const LARGEST_NORM: f64 = 4.0;
const OF_A_CLASS: f64 = 1.5;

impl Task<'_> {
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
                let equations = if keeps { paper::repeat } else { paper::zupt1 };
                let found = equations(self.record, spans, &self.place, &start, vertical)?;
                (found.drift, found.azimuth, found.q_nb)
            }
            [] => return Err(Refusal::NoStop.into()),
        };
        // The paper gives no covariance: that of the joint regression of the same stops is what its noise would leave at best, and what
        // the two differ by is an error that this one has.
        let problem = self.problem(self.near_start(keeps), keeps);
        let fit = self.joint(&problem, Taper::None, false)?;
        let end = fit.run.q_nb[fit.run.q_nb.len() - 1];
        let parts = [
            log(&(q_nb * end.inverse())),
            drift - fit.start.gyro_bias,
            -fit.start.accel_bias,
        ];
        let differs = SVector::<f64, GLOBAL>::from_iterator(parts.iter().flatten().copied());
        let mut result = self.result(
            AlignmentMethod::Paper,
            "asked for; its covariance is that of the joint regression and what it differs from that".to_string(),
            q_nb,
            drift,
            Vector3::zeros(),
            fit.covariance + differs * differs.transpose(),
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

    /// A joint fit that has settled.
    fn joint(&self, problem: &Problem<'_>, taper: Taper, rocking: bool) -> Result<Joint> {
        match Joint::fit(problem, taper, rocking) {
            Some(fit) if fit.step_sigmas <= SETTLED => Ok(fit),
            unsettled => Err(self
                .turned_inside(problem)
                .unwrap_or(Refusal::NotConverged {
                    passes: MOST_PASSES,
                    step_sigmas: unsettled
                        .map(|fit| fit.step_sigmas)
                        .filter(|step| step.is_finite())
                        .unwrap_or(f64::INFINITY),
                }))?,
        }
    }

    /// Of a fit that does not settle: a stop in which the body turns.
    fn turned_inside(&self, problem: &Problem<'_>) -> Option<Refusal> {
        let run = FreeRun::new(self.record, problem.whole(), &self.place, &problem.start);
        self.spans.iter().find_map(|span| {
            let standing = Standing::new(self.record, &run, *span, Taper::None);
            let noise = &self.options.noise;
            let taper = Taper::None;
            let worst = disagreement(&standing, &run, &self.place, noise, taper, None).amax();
            let turned = rocking_rms(&standing).amax() > LARGEST_ROCKING;
            let velocity = &run.velocity_n[run.at(span.begin)..=run.at(span.end)];
            (turned && worst > LARGEST_DISAGREEMENT).then(|| Refusal::NotStationary {
                begin_s: self.begin_s(*span),
                velocity_rms_m_per_s: velocity_rms(velocity),
                disagreement_sigma: worst,
            })
        })
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
        self.require_heading()?;
        let problem = self.problem(self.near_start(keeps), keeps);
        let plain = self.joint(&problem, Taper::None, false)?;
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
                self.joint(&problem, taper, !quiet)?
            };
            self.by_joint(asked, &fit, taper, quiet, nis)?
        } else {
            self.by_filter(asked, &plain, &filtered, &halves)?
        };
        result.nis_ratio = Some(nis);
        self.require_latitude(&mut result)?;
        // A rate that the Earth does not have makes innovations too: it is named first.
        if !regress && nis >= QUIET_NIS {
            return Err(Refusal::BaseRocks {
                nis,
                allowed: QUIET_NIS,
            }
            .into());
        }
        Ok(result)
    }

    /// A heading that is told must be one that the stops can have.
    pub(super) fn require_heading(&self) -> Result<()> {
        let Some((told, sigma)) = self.options.heading else {
            return Ok(());
        };
        let problem = Problem {
            heading: None,
            ..self.problem(self.near_start(false), false)
        };
        // Tapered, with what rocking does: the check is for degrees, not for the last minute of arc.
        let fit = self.joint(&problem, Taper::HannSquared, true)?;
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
            let left = fit.sway.get(i);
            let apart = disagreement(standing, &fit.run, &self.place, noise, taper, left).amax();
            halves.push(apart);
            if apart > LARGEST_DISAGREEMENT {
                let slow = fit
                    .sway
                    .get(i)
                    .map(|s| s.period_s * PERIODS as f64)
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

    /// Whether the Earth's rate is that of the latitude: the paper's unit norm, and the vertical rate.
    pub(super) fn require_latitude(&self, result: &mut AlignmentResult) -> Result<()> {
        let options = self.options;
        let first = result.stops[0].q_nb;
        let turns: Vec<Vector3<f64>> = result
            .stops
            .iter()
            .map(|s| log(&(s.q_nb * first.inverse())))
            .collect();
        let with = |bias_sigma: f64| {
            earth_rate(
                &result.stops,
                &turns,
                &self.place,
                &options.noise,
                bias_sigma,
                options.gyro_scale_sigma,
            )
        };
        let Some(found) = with(OF_A_CLASS * options.noise.gyro_bias_sigma) else {
            return Ok(());
        };
        let horizontal = self.place.horizontal_rate();
        let [norm, norm_sigma] = found.horizontal;
        let [down, down_sigma] = found.vertical;
        if result.stops.len() > 1 {
            result.norm_residual = Some(found.horizontal);
        }
        for (part, off, sigma) in [
            ("horizontal", norm * horizontal, norm_sigma * horizontal),
            ("vertical", down, down_sigma),
        ] {
            if off.abs() > LARGEST_NORM * sigma {
                return Err(Refusal::LatitudeInconsistent {
                    latitude_deg: options.position.latitude.to_degrees(),
                    part,
                    off_deg_per_hour: off.to_degrees() * 3600.0,
                    sigmas: off.abs() / sigma,
                }
                .into());
            }
        }
        Ok(())
    }

    /// Levelled, the vertical rate tells a latitude with the wrong sign, if the gyros are good enough; whatever else it is off by is
    /// the unit's.
    pub(super) fn require_hemisphere(&self, drift_down: f64) -> Result<()> {
        let allowed = LARGEST_NORM * OF_A_CLASS * self.options.noise.gyro_bias_sigma;
        let mirrored = -2.0 * self.place.earth_n.z;
        if drift_down.abs() > allowed && (drift_down - mirrored).abs() < allowed {
            return Err(Refusal::LatitudeInconsistent {
                latitude_deg: self.options.position.latitude.to_degrees(),
                part: "vertical",
                off_deg_per_hour: drift_down.to_degrees() * 3600.0,
                sigmas: LARGEST_NORM * drift_down.abs() / allowed,
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
                let Rates { rate_n, mut sigma } =
                    rates(standing, &fit.run, &self.place, noise, taper, all);
                if let Some(spectrum) = fit.sway.get(i) {
                    let rocks = leak(standing, spectrum, &self.place, taper, all);
                    sigma = (sigma.component_mul(&sigma) + rocks).map(f64::sqrt);
                }
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
                        .sway
                        .get(i)
                        .map(|s| s.period_s)
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
