//! What is wrong with a log: found in its numbers, named, and with the flag that mends it.
//!
//! Every finding is a pure function of what one pass gathered ([`Facts`]). A finding that is not certain is not made: a log in
//! which nothing turns says nothing about the unit of its gyros, and nothing is then said. Numbers are never mended silently;
//! what would spoil a run altogether is [`Severity::Fatal`] and ends it.

mod blocks;
mod clocks;
mod fit;
mod frozen;
mod imu_units;
mod motion;
mod mounting;
mod position_sigma;
mod positions;
mod sigma_missing;
mod stamps;
mod velocity;

pub(crate) use blocks::{BlockMeter, Blocks};
pub use positions::why_no_place;
pub(crate) use stamps::step_of;

use crate::{Estimate, ImuAxes, ReadOptions, Role, Survey, TopicStatistics, Warning};
use insnav_core::config::Config;
use insnav_core::time::Time;
use motion::Motion;
use serde::Serialize;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Worth knowing; the run copes.
    Note,
    /// The solution suffers.
    Warning,
    /// There would be no solution worth the name: `run` refuses.
    Fatal,
}

/// Something that is wrong with a log.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// A short name for programs.
    pub code: &'static str,
    /// How bad it is.
    pub severity: Severity,
    /// The numbers that say so.
    pub evidence: String,
    /// What follows if nothing is done.
    pub consequence: String,
    /// What to do.
    pub remedy: String,
    /// The arguments to `run` and `info` that mend it, where there are such.
    pub flag: Option<String>,
}

impl Finding {
    fn new(
        code: &'static str,
        severity: Severity,
        evidence: impl Into<String>,
        consequence: impl Into<String>,
    ) -> Self {
        Finding {
            code,
            severity,
            evidence: evidence.into(),
            consequence: consequence.into(),
            remedy: String::new(),
            flag: None,
        }
    }

    /// Mended by arguments.
    fn flag(mut self, flag: impl Into<String>) -> Self {
        let flag = flag.into();
        self.remedy = format!("add `{flag}`");
        self.flag = Some(flag);
        self
    }

    /// Mended by no argument, or by more than one.
    fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = remedy.into();
        self
    }

    /// More about the remedy.
    fn and(mut self, more: &str) -> Self {
        self.remedy.push_str(more);
        self
    }
}

/// What a run tells by itself as it meets it, with what it did about it.
const TOLD_BY_RUN: [&str; 3] = ["imu_not_finite", "duplicate_stamps", "imu_gaps"];

/// Findings as warnings of a run, without those that it will tell itself.
pub(crate) fn warnings(found: &[Finding]) -> Vec<Warning> {
    let untold = |f: &&Finding| !TOLD_BY_RUN.contains(&f.code);
    found.iter().filter(untold).map(Warning::from).collect()
}

impl From<&Finding> for Warning {
    fn from(f: &Finding) -> Self {
        Warning {
            code: f.code,
            message: format!("{}: {}", f.evidence, f.consequence),
            remedy: f.remedy.clone(),
        }
    }
}

/// What a source tells besides its samples.
#[derive(Clone, Debug, Default)]
pub struct SourceFacts {
    /// Regularity of the topics in use.
    pub topics: Vec<(Role, TopicStatistics)>,
    /// How the log is read; absent for arrays.
    pub options: Option<ReadOptions>,
    /// That the log was damaged, and what is left of it.
    pub recovered: Option<Warning>,
    /// Topics of GNSS that are not read since none is wanted.
    pub gnss_left_out: Vec<String>,
    /// Other topics that could be the IMU.
    pub other_imu_topics: Vec<String>,
}

/// Everything that findings are made of.
pub(crate) struct Facts<'a> {
    pub(crate) origin: Time,
    pub(crate) config: &'a Config,
    pub(crate) survey: &'a Survey,
    pub(crate) source: &'a SourceFacts,
    motion: Motion,
}

impl<'a> Facts<'a> {
    pub(crate) fn new(
        origin: Time,
        config: &'a Config,
        survey: &'a Survey,
        source: &'a SourceFacts,
    ) -> Self {
        Facts {
            origin,
            config,
            survey,
            source,
            motion: Motion::new(survey, config.gnss.time_offset_s),
        }
    }

    /// Seconds from the origin.
    fn seconds(&self, time: Time) -> f64 {
        time.since(self.origin)
    }

    fn options(&self) -> ReadOptions {
        // Arrays are forward-right-down by definition.
        self.source.options.clone().unwrap_or(ReadOptions {
            imu_axes: ImuAxes::Frd,
            ..ReadOptions::default()
        })
    }
}

/// All findings, the worst first.
pub(crate) fn all(facts: &Facts<'_>) -> Vec<Finding> {
    let mut found = Vec::new();
    found.extend(imu_units::find(facts));
    let misread = positions::find(facts);
    // What else is judged by the positions would be judged wrongly.
    if !misread.iter().any(|f| f.severity == Severity::Fatal) {
        found.extend(mounting::find(facts));
        found.extend(velocity::find(facts));
        found.extend(position_sigma::find(facts));
    }
    found.extend(misread);
    found.extend(frozen::find(facts));
    found.extend(of_topics(facts.source, facts.origin));
    found.extend(sigma_missing::find(facts));
    found.sort_by_key(|f| std::cmp::Reverse(f.severity));
    found
}

/// Findings that need no samples: those of a log that cannot be read as a run would.
pub(crate) fn of_topics(source: &SourceFacts, origin: Time) -> Vec<Finding> {
    stamps::find(source, origin)
}

/// Where clocks in the data contradict the settings by more than chance, given what else was found.
///
/// Offsets are found by motion: what does not fit the motion for another reason feigns them, and is to be mended first.
pub(crate) fn of_clocks(
    offset: Option<Estimate>,
    lag: Option<Estimate>,
    config: &Config,
    others: &[Finding],
) -> Vec<Finding> {
    let spoilt = |begin: &str| {
        let spoils = |f: &Finding| {
            f.severity > Severity::Note
                && (f.code.starts_with(begin) && f.code != "imu_gaps"
                    || [
                        "clock_step",
                        "clock_drift",
                        "different_clocks",
                        "gnss_frozen",
                    ]
                    .contains(&f.code))
        };
        others.iter().any(spoils)
    };
    let offset = offset.filter(|_| !spoilt("imu_"));
    let lag = lag.filter(|_| !spoilt("velocity_"));
    clocks::find(offset, lag, config)
}
