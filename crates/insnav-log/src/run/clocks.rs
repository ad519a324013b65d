//! Clock offsets of a log: found, used or only told.

use super::RunError;
use super::execute::is_withheld;
use super::plan::Plan;
use super::report::{Estimate, Warning};
use super::source::Source;
use insnav_core::clock_offset::{
    ClockOffset, Search, imu_offset, imu_offset_by_filter, velocity_lag,
};
use insnav_core::config::Config;
use insnav_core::sample::Sample;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// What is known of the clocks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Clocks {
    /// Offset of the IMU's clock that the run uses, if it was found in the data.
    pub offset_used: Option<Estimate>,
    /// Offset that the data show, if it is not used.
    pub offset_found: Option<Estimate>,
    /// Lag of GNSS velocity that the run uses, if it was found in the data.
    pub lag_used: Option<Estimate>,
    /// Lag that the data show, if it is not used.
    pub lag_found: Option<Estimate>,
}

/// An offset of fewer sigmas may be none.
const CHANCE: f64 = 3.0;
/// What is known no better tells nothing of the offsets that logs commonly have, which begin there, s. It is used when it is certain.
const VAGUE: f64 = 0.05;
/// So many sigmas from the settings a vague offset is certain: where noise rivals motion sigmas are a fifth too small.
const CERTAIN: f64 = 4.0;
/// Estimates of the same offset that differ by more of their sigmas do not tell the same.
const APART: f64 = 4.0;
/// The navigator looks for an offset so far to either side, s. Positions alone have other minima beyond half a second.
const WIDE: f64 = 1.5;
/// Larger offsets come from stamps of different sources, not from the way that samples take, s.
const LARGE: f64 = 0.5;
/// Without being asked for, offsets are looked for in this much of the log only, s of samples at the IMU's rate.
const GLANCE_S: f64 = 1200.0;

/// Look for both offsets. What cannot be observed stays unknown.
pub(super) fn find_clocks(
    source: &(impl Source + ?Sized),
    plan: &Plan,
    (auto, thorough): (bool, bool),
) -> Result<Clocks, RunError> {
    let withholding = plan.withholding();
    let begin = plan.survey.imu_span.map(|(first, _)| first);
    let mut samples: Vec<Sample> = Vec::new();
    for sample in source.samples()? {
        let sample = sample?;
        if !(auto || thorough) && begin.is_some_and(|begin| sample.time().since(begin) > GLANCE_S) {
            break;
        }
        // A withheld fix must not tell the clock either.
        if !is_withheld(&withholding, &sample, plan.config.gnss.velocity_lag_s) {
            samples.push(sample);
        }
    }
    let lever_arm_b = Vector3::from(plan.config.gnss.lever_arm_b_m.unwrap_or_default());
    let search = Search::default();
    // What cannot be observed is no failure of the run: it stays as the settings have it.
    let lag = velocity_lag(&samples, &search).ok().map(estimate);
    let by_positions = imu_offset(&samples, &lever_arm_b, &search)
        .ok()
        .map(estimate);
    // A finding has to be certain: a scale of the forces that is a per cent off feigns an offset to the filter. There it stands in only
    // where positions alone do not tell and the lag is known.
    let told_apart = thorough && by_positions.is_none() && lag.is_some();
    let by_filter = (auto || told_apart)
        .then(|| with_velocities(&samples, plan, lag))
        .flatten();
    Ok(Clocks {
        offset_found: better(by_positions, by_filter),
        lag_found: lag,
        ..Clocks::default()
    })
}

fn estimate(found: ClockOffset) -> Estimate {
    Estimate {
        value: found.value,
        sigma: Some(found.sigma),
    }
}

/// The offset by everything that the navigator uses, with the lag that the run would take.
fn with_velocities(samples: &[Sample], plan: &Plan, lag: Option<Estimate>) -> Option<Estimate> {
    let mut config = plan.config;
    let lag = lag.filter(|lag| judge(lag, config.gnss.velocity_lag_s) == Verdict::Found);
    let search = Search { range: WIDE };
    if let Some(lag) = lag {
        config.gnss.velocity_lag_s = lag.value;
    }
    let found = imu_offset_by_filter(samples, &config, &plan.noise(), &search).ok()?;
    // Velocities tell the sum of both offsets: what a lag from the data is wrong by, the offset is.
    let lag_sigma = lag.and_then(|lag| lag.sigma).unwrap_or(0.0);
    Some(Estimate {
        value: found.value,
        sigma: Some(found.sigma.hypot(lag_sigma)),
    })
}

/// The estimate with the lesser sigma; where they contradict each other that of positions alone, which supposes least.
fn better(by_positions: Option<Estimate>, by_filter: Option<Estimate>) -> Option<Estimate> {
    let (Some(p), Some(f)) = (by_positions, by_filter) else {
        return by_filter.or(by_positions);
    };
    let (p_sigma, f_sigma) = (p.sigma.unwrap_or(0.0), f.sigma.unwrap_or(0.0));
    let agree = (p.value - f.value).abs() < APART * p_sigma.hypot(f_sigma);
    Some(if agree && f_sigma < p_sigma { f } else { p })
}

/// What an estimate says against the settings.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Verdict {
    /// It differs by more than chance.
    Found,
    /// It is known well, and is what the settings say.
    AsSet,
    /// It may be what the settings say or be far from it.
    Unknown,
}

fn judge(found: &Estimate, set: f64) -> Verdict {
    let sigma = found.sigma.unwrap_or(0.0);
    let off = (found.value - set).abs();
    match sigma > VAGUE {
        true if off < CERTAIN * sigma => Verdict::Unknown,
        false if off < CHANCE * sigma => Verdict::AsSet,
        _ => Verdict::Found,
    }
}

impl Clocks {
    /// Put what was found into the settings; what may be chance leaves them as they are.
    pub(super) fn use_what_was_found(&mut self, config: &mut Config) {
        let take = |found: &mut Option<Estimate>, set: &mut f64| {
            let estimate = (*found)?;
            match judge(&estimate, *set) {
                Verdict::Unknown => return None,
                Verdict::Found => *set = estimate.value,
                Verdict::AsSet => {}
            }
            *found = None;
            Some(Estimate {
                value: *set,
                ..estimate
            })
        };
        let gnss = &mut config.gnss;
        self.offset_used = take(&mut self.offset_found, &mut gnss.time_offset_s);
        self.lag_used = take(&mut self.lag_found, &mut gnss.velocity_lag_s);
    }

    /// What was asked for and could not be found, and what was found and is strange.
    pub(super) fn warnings(&self, has_velocity: bool) -> Vec<Warning> {
        let mut told = Vec::new();
        let mut missing = |code, what: &str, vague: Option<Estimate>, key: &str| {
            let why = match vague {
                Some(Estimate {
                    value,
                    sigma: Some(sigma),
                }) => format!(
                    "not found (the data say {value:.2} ± {sigma:.2} s, too vague to be used)"
                ),
                _ => "not observable in this log".into(),
            };
            told.push(Warning {
                code,
                message: format!("{what} is {why} and is left as the settings have it"),
                remedy: format!(
                    "give it as {key}, from a log of the same setup with turns and changes of speed"
                ),
            });
        };
        if self.offset_used.is_none() {
            missing(
                "time_offset_unknown",
                "the offset of the IMU's clock",
                self.offset_found,
                "gnss.time_offset_s",
            );
        }
        if self.lag_used.is_none() && has_velocity {
            missing(
                "velocity_lag_unknown",
                "the lag of GNSS velocity",
                self.lag_found,
                "gnss.velocity_lag_s",
            );
        }
        told.extend(self.offset_used.filter(|o| o.value.abs() > LARGE).map(|o| Warning {
            code: "time_offset_large",
            message: format!(
                "IMU stamps are {:.3} s off the clock of GNSS positions, and are moved: half a second and more is not the way that samples take, but stamps of different sources",
                o.value
            ),
            remedy: "check with `insnav info` which clocks stamp the topics".into(),
        }));
        told
    }
}
