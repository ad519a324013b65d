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
const CHANCE: f64 = 2.0;
/// Without being asked for, offsets are looked for in this much of the log only, s of samples at the IMU's rate.
const GLANCE_S: f64 = 1200.0;

/// Look for both offsets. What cannot be observed stays unknown.
pub(super) fn find_clocks(
    source: &(impl Source + ?Sized),
    plan: &Plan,
    thorough: bool,
) -> Result<Clocks, RunError> {
    let withholding = plan.withholding();
    let begin = plan.survey.imu_span.map(|(first, _)| first);
    let mut samples: Vec<Sample> = Vec::new();
    for sample in source.samples()? {
        let sample = sample?;
        if !thorough && begin.is_some_and(|begin| sample.time().since(begin) > GLANCE_S) {
            break;
        }
        // A withheld fix must not tell the clock either.
        if !is_withheld(&withholding, &sample, plan.config.gnss.velocity_lag_s) {
            samples.push(sample);
        }
    }
    let lever_arm_b = Vector3::from(plan.config.gnss.lever_arm_b_m.unwrap_or_default());
    let search = Search::default();
    let estimate = |c: ClockOffset| Estimate {
        value: c.value,
        sigma: Some(c.sigma),
    };
    // What cannot be observed is no failure of the run: it stays as the settings have it.
    let lag = velocity_lag(&samples, &search).ok();
    let offset = imu_offset(&samples, &lever_arm_b, &search).or_else(|error| {
        // Positions alone did not tell; velocities whose lag is known may, through the filter.
        let Some(lag) = lag.filter(|_| thorough) else {
            return Err(error);
        };
        let mut config = plan.config;
        config.gnss.velocity_lag_s = lag.value;
        let found = imu_offset_by_filter(&samples, &config, &plan.noise(), &search)?;
        // Velocities tell the sum of both offsets: what the lag is wrong by, the offset is.
        let sigma = found.sigma.hypot(lag.sigma);
        Ok(ClockOffset { sigma, ..found })
    });
    Ok(Clocks {
        offset_found: offset.ok().map(estimate),
        lag_found: lag.map(estimate),
        ..Clocks::default()
    })
}

impl Clocks {
    /// Put what was found into the settings; what may be chance leaves them as they are.
    pub(super) fn use_what_was_found(&mut self, config: &mut Config) {
        let gnss = &config.gnss;
        let beyond_chance = |found: Option<Estimate>, set: f64| {
            found.map(|found| match found.sigma {
                Some(sigma) if (found.value - set).abs() < CHANCE * sigma => Estimate {
                    value: set,
                    ..found
                },
                _ => found,
            })
        };
        self.offset_used = beyond_chance(self.offset_found.take(), gnss.time_offset_s);
        self.lag_used = beyond_chance(self.lag_found.take(), gnss.velocity_lag_s);
        if let Some(offset) = self.offset_used {
            config.gnss.time_offset_s = offset.value;
        }
        if let Some(lag) = self.lag_used {
            config.gnss.velocity_lag_s = lag.value;
        }
    }

    /// What was asked for and could not be found.
    pub(super) fn not_observable(&self, has_velocity: bool) -> Vec<Warning> {
        let mut found = Vec::new();
        let mut missing = |code, what: &str, key: &str| {
            found.push(Warning {
                code,
                message: format!(
                    "{what} is not observable in this log and is left as the settings have it"
                ),
                remedy: format!(
                    "give it as {key}, from a log of the same setup with turns and changes of speed"
                ),
            });
        };
        if self.offset_used.is_none() {
            missing(
                "time_offset_unknown",
                "the offset of the IMU's clock",
                "gnss.time_offset_s",
            );
        }
        if self.lag_used.is_none() && has_velocity {
            missing(
                "velocity_lag_unknown",
                "the lag of GNSS velocity",
                "gnss.velocity_lag_s",
            );
        }
        found
    }
}
