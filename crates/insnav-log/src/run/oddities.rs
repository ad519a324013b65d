//! Findings of a source: what looks wrong in it, before a run or for `info`.

use super::RunError;
use super::report::Warning;
use super::source::Source;
use super::survey::Survey;
use super::withhold::{Withhold, Withholding};
use crate::findings::{self, Facts};
use crate::{Finding, Log, ReadOptions, Role, Severity, SourceFacts, TopicInfo};
use insnav_core::config::Config;
use insnav_core::time::Time;

pub(super) fn lever_arm_unknown() -> Warning {
    Warning {
        code: "lever_arm_unknown",
        message: "the lever arm from IMU to antenna is not known and taken as zero".into(),
        remedy:
            "measure it and put it into the config: [gnss] lever_arm_b_m = [forward, right, down]"
                .into(),
    }
}

impl Log {
    /// That the log was damaged, and what is left of it; `None` when it is whole or was read without recovery.
    pub fn recovery_warning(&self) -> Option<Warning> {
        let recovery = self.recovery().filter(|recovery| !recovery.is_clean())?;
        let begin = self.time_range().map(|(first, _)| first);
        let zero = self.t0().ok().flatten().or(begin).unwrap_or_default();
        Some(Warning {
            code: "recovered",
            message: format!(
                "{}: damaged, recovered: {}",
                self.path().display(),
                recovery.account(zero)
            ),
            remedy:
                "copy the file again from its origin; what is lost is bridged like any other gap"
                    .into(),
        })
    }
}

/// Statistics of the topics in use, and how the log is read.
pub(super) fn facts_of_log(log: &Log) -> Result<SourceFacts, RunError> {
    let statistics = log.statistics()?;
    let roles = [Role::Imu, Role::GnssPosition, Role::GnssVelocity];
    let topics = roles
        .into_iter()
        .filter_map(|role| {
            let index = log.selected().topic(role)?;
            // A receiver's message may play two parts.
            Some((role, statistics.get(index)?.clone()))
        })
        .collect();
    let imu = log.selected().topic(Role::Imu);
    let others = log.topics().iter().enumerate();
    Ok(SourceFacts {
        topics,
        options: Some(ReadOptions {
            // By the transforms, where the user gives none.
            imu_mounting_rpy_deg: log.mounting_rpy_deg()?,
            ..log.options().clone()
        }),
        recovered: log.recovery_warning(),
        gnss_left_out: if log.options().leaves_out(Role::GnssPosition) {
            let gnss = [Role::GnssPosition, Role::GnssVelocity];
            let has = |t: &&TopicInfo| {
                t.count > 0
                    && gnss
                        .iter()
                        .any(|r| t.serves(*r) && r.accepts_unnamed(&t.name))
            };
            log.topics()
                .iter()
                .filter(has)
                .map(|t| t.name.clone())
                .collect()
        } else {
            Vec::new()
        },
        other_imu_topics: others
            .filter(|(i, t)| Some(*i) != imu && t.serves(Role::Imu) && t.count > 0)
            .map(|(_, t)| t.name.clone())
            .collect(),
    })
}

/// All findings of a source; the clocks' come later, from their search.
pub(super) fn findings_of(
    facts: &SourceFacts,
    survey: &Survey,
    config: &Config,
    origin: Time,
    withhold: &Withhold,
) -> Vec<Finding> {
    // What is withheld is mended: nothing more is to be said of it.
    let shorter = match withhold {
        Withhold::Intervals(_) => {
            let epochs = survey.positions.iter().map(|p| p.time).collect();
            let withholding = Withholding::new(withhold.clone(), origin, epochs);
            let mut survey = survey.clone();
            survey.positions.retain(|p| !withholding.takes(p.time));
            Some(survey)
        }
        _ => None,
    };
    let survey = shorter.as_ref().unwrap_or(survey);
    findings::all(&Facts::new(origin, config, survey, facts))
}

/// Refuse a log whose data would give no solution worth the name.
pub(super) fn refuse_fatal(found: &[Finding]) -> Result<(), RunError> {
    let fatal: Vec<&Finding> = found
        .iter()
        .filter(|f| f.severity == Severity::Fatal)
        .collect();
    match fatal.as_slice() {
        [] => Ok(()),
        [first, ..] => Err(RunError::Unusable {
            finding: Box::new((*first).clone()),
            others: fatal.len() - 1,
        }),
    }
}

/// Everything that looks wrong in a source, whether a run of it is possible or not.
///
/// # Errors
/// Those of reading the messages; what only makes samples impossible leaves the findings about the topics.
pub fn find(source: &(impl Source + ?Sized), config: &Config) -> Result<Vec<Finding>, RunError> {
    let origin = source.origin()?;
    let facts = source.facts()?;
    let Ok(survey) = Survey::of(source) else {
        return Ok(findings::of_topics(&facts, origin.unwrap_or_default()));
    };
    let origin = origin.or(survey.imu_span.map(|s| s.0)).unwrap_or_default();
    Ok(findings_of(
        &facts,
        &survey,
        config,
        origin,
        &Withhold::Nothing,
    ))
}
