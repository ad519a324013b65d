//! `insnav info`: what a log holds, what looks wrong in it, and what `run` would do with it.

use super::log_flags::LogFlags;
use super::settings_flags::SettingsFlags;
use crate::failure::{Failure, WARNED};
use crate::output::Output;
use crate::progress::Watched;
use crate::text;
use clap::Args;
use insnav_core::stationary::Witness;
use insnav_core::time::Time;
use insnav_log::{
    Checksums, Choice, Estimate, Finding, Log, METADATA_NAME, METADATA_T0, Mounting, NoiseReport,
    Plan, Role, RunOptions, StopReport, TopicInfo, TopicStatistics, Warning, config_text_with,
    find,
};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Look at a log: topics, rates, gaps, clocks, stops, what looks wrong, and what `run` would use
#[derive(Args, Debug)]
pub(crate) struct Info {
    /// The log: MCAP with ROS 2, ROS 1, JSON or foxglove protobuf messages
    log: PathBuf,

    #[command(flatten)]
    settings: SettingsFlags,

    #[command(flatten)]
    reading: LogFlags,

    /// End with code 3 when there are warnings about the data
    #[arg(long)]
    strict: bool,
}

/// What is known of a log.
#[derive(Debug, Serialize)]
pub(crate) struct LogReport {
    pub(crate) input: PathBuf,
    pub(crate) profile: String,
    pub(crate) library: String,
    pub(crate) indexed: bool,
    /// Whether damage to messages would be noticed: all, some, none.
    pub(crate) checksums: &'static str,
    pub(crate) begin_unix_s: Option<f64>,
    pub(crate) duration_s: Option<f64>,
    /// The zero of all seconds, Unix time.
    pub(crate) zero_unix_s: f64,
    /// Whether the log's metadata state it; else it is the first IMU stamp.
    pub(crate) zero_stated: bool,
    /// What is wrong with the data, the worst first.
    pub(crate) findings: Vec<Finding>,
    pub(crate) topics: Vec<TopicReport>,
    pub(crate) metadata: BTreeMap<String, String>,
    /// What `run` would do; absent when it could not.
    pub(crate) run: Option<RunPreview>,
    /// Why `run` could not.
    pub(crate) problem: Option<Failure>,
    pub(crate) warnings: Vec<Warning>,
}

/// One topic.
#[derive(Debug, Serialize)]
pub(crate) struct TopicReport {
    pub(crate) name: String,
    pub(crate) schema: String,
    pub(crate) encoding: String,
    pub(crate) count: u64,
    pub(crate) role: Option<&'static str>,
    pub(crate) rate_hz: Option<f64>,
    pub(crate) jitter_s: Option<f64>,
    pub(crate) interval_max_s: Option<f64>,
    pub(crate) gaps: Vec<Span>,
    pub(crate) duplicates: u64,
    pub(crate) backward_steps: u64,
    pub(crate) unstamped: u64,
    pub(crate) not_finite: u64,
    pub(crate) no_fix: u64,
    pub(crate) zero_position: u64,
    pub(crate) header_minus_log_s: Option<MeanAndRange>,
}

/// A stretch of time, s from the log's origin.
#[derive(Debug, Serialize)]
pub(crate) struct Span {
    pub(crate) begin_s: f64,
    pub(crate) end_s: f64,
}

/// Who says that the vehicle stood.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum SeenBy {
    /// The detector of a run: inertial data, and speed where it is heard.
    Detector,
    /// The topic that declares standing.
    Topic,
    /// An interval of the settings.
    Interval,
    /// GNSS velocity alone: a run makes nothing of it.
    GnssVelocity,
}

/// A stop.
#[derive(Debug, Serialize)]
pub(crate) struct SeenStop {
    #[serde(flatten)]
    pub(crate) span: Span,
    pub(crate) seen_by: SeenBy,
}

#[derive(Debug, Serialize)]
pub(crate) struct MeanAndRange {
    pub(crate) mean: f64,
    pub(crate) min: f64,
    pub(crate) max: f64,
}

/// What `run` would use.
#[derive(Debug, Serialize)]
pub(crate) struct RunPreview {
    pub(crate) imu_samples: usize,
    pub(crate) gnss_positions: usize,
    pub(crate) gnss_velocities: usize,
    /// Declarations of standing.
    pub(crate) standstills: usize,
    /// Speeds of wheels.
    pub(crate) wheel_speeds: usize,
    pub(crate) time_offset_s: Option<Estimate>,
    pub(crate) gnss_velocity_lag_s: Option<Estimate>,
    /// Those that a run finds or is told of, and those that GNSS velocity alone shows.
    pub(crate) stops: Vec<SeenStop>,
    /// On a foot: how many stops were shorter than a second, which are not listed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) stances: Option<usize>,
    pub(crate) imu_grade: &'static str,
    pub(crate) imu_grade_picked: bool,
    pub(crate) imu_noise: Option<NoiseReport>,
    /// Zero where it is not known.
    pub(crate) lever_arm_b_m: [f64; 3],
    pub(crate) lever_arm_known: bool,
    /// What altitudes of fixes are taken to be above.
    pub(crate) altitude_above: String,
    pub(crate) imu_mounting: Option<Mounting>,
    pub(crate) config: String,
}

impl Info {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        let config = self.settings.load()?;
        let log = Log::open(
            &self.log,
            self.reading.options(&config, self.settings.for_reading()?),
        )?;
        let options = RunOptions {
            thorough_clocks: true,
            ..RunOptions::default()
        };
        let plan = Plan::make(&Watched::new(&log), &config, &options);
        let origin = match &plan {
            Ok(plan) => plan.origin,
            Err(_) => log
                .t0()
                .ok()
                .flatten()
                .or(log.time_range().map(|(first, _)| first))
                .unwrap_or_default(),
        };
        let (run, problem, findings, warnings) = match plan {
            Ok(plan) => (
                Some(preview(&plan, &log)),
                None,
                plan.findings,
                plan.warnings,
            ),
            Err(error) => {
                let findings = find(&log, &config).unwrap_or_default();
                let recovered = log.recovery_warning().into_iter();
                let warnings = recovered
                    .chain(findings.iter().map(Warning::from))
                    .collect();
                (None, Some(Failure::from(error)), findings, warnings)
            }
        };
        let stated = |pairs: &BTreeMap<String, String>| pairs.contains_key(METADATA_T0);
        let zero_stated = log.metadata(METADATA_NAME).is_some_and(stated);
        let (profile, library) = log.written_by();
        let range = log.time_range();
        let report = LogReport {
            input: self.log.clone(),
            profile: profile.to_owned(),
            library: library.to_owned(),
            indexed: log.is_indexed(),
            checksums: match log.checksums() {
                Checksums::All => "all",
                Checksums::Some => "some",
                Checksums::None => "none",
            },
            begin_unix_s: range.map(|(first, _)| first.seconds()),
            duration_s: range.map(|(first, last)| last.since(first)),
            zero_unix_s: origin.seconds(),
            zero_stated,
            findings,
            topics: topics(&log, origin)?,
            metadata: log.metadata(METADATA_NAME).cloned().unwrap_or_default(),
            run,
            problem,
            warnings,
        };
        output.result(&report, || text::log_report(&report));
        // The findings stand in the report already.
        let told = |w: &&Warning| report.findings.iter().any(|f| f.code == w.code);
        let others: Vec<Warning> = report
            .warnings
            .iter()
            .filter(|w| !told(w))
            .cloned()
            .collect();
        output.warnings(&others);
        Ok(
            if self.strict
                && !(report.warnings.is_empty()
                    && report.findings.is_empty()
                    && report.problem.is_none())
            {
                WARNED
            } else {
                0
            },
        )
    }
}

/// What a run makes of the log, from one pass of the navigator; and where only GNSS velocity shows a stop.
fn stops(plan: &Plan, log: &Log) -> (Vec<SeenStop>, Option<usize>) {
    let report = plan.execute(&Watched::new(log), &mut ()).ok();
    let stances = report.as_ref().and_then(|r| r.stances);
    let found = report.map(|r| r.stops).unwrap_or_default();
    let seen_by = |witness| match witness {
        Witness::Declared => SeenBy::Topic,
        Witness::Interval => SeenBy::Interval,
        Witness::Detector | Witness::Nobody => SeenBy::Detector,
    };
    let mut all: Vec<SeenStop> = found
        .iter()
        .map(|stop| SeenStop {
            span: Span {
                begin_s: stop.begin_s,
                end_s: stop.end_s,
            },
            seen_by: seen_by(stop.evidence.witness),
        })
        .collect();
    let by_gnss = plan.stops().into_iter().map(|stop| Span {
        begin_s: stop.begin.since(plan.origin),
        end_s: stop.end.since(plan.origin),
    });
    let overlaps = |a: &Span| {
        let meets = |b: &StopReport| a.begin_s < b.end_s && b.begin_s < a.end_s;
        found.iter().any(meets)
    };
    all.extend(by_gnss.filter(|span| !overlaps(span)).map(|span| SeenStop {
        span,
        seen_by: SeenBy::GnssVelocity,
    }));
    all.sort_by(|a, b| a.span.begin_s.total_cmp(&b.span.begin_s));
    (all, stances)
}

fn preview(plan: &Plan, log: &Log) -> RunPreview {
    let geoid_height_m = log.options().geoid_height_m;
    let (stops, stances) = stops(plan, log);
    let mut config = plan.config;
    if !plan.lever_arm_known {
        // Zero stated in a file would be taken for a measured zero.
        config.gnss.lever_arm_b_m = None;
    }
    RunPreview {
        imu_samples: plan.survey.imu_samples,
        gnss_positions: plan.survey.positions.len(),
        gnss_velocities: plan.survey.velocities.len(),
        standstills: plan.survey.standstills,
        wheel_speeds: plan.survey.speeds,
        time_offset_s: plan.clocks.offset_found,
        gnss_velocity_lag_s: plan.clocks.lag_found,
        stops,
        stances,
        imu_grade: plan.grade.name(),
        imu_grade_picked: plan.grade_picked,
        imu_noise: plan.survey.noise_floor.as_ref().map(NoiseReport::from),
        lever_arm_b_m: plan.config.gnss.lever_arm_b_m.unwrap_or_default(),
        imu_mounting: plan.mounting.clone(),
        lever_arm_known: plan.lever_arm_known,
        altitude_above: if geoid_height_m == 0.0 {
            "the ellipsoid, as NavSatFix defines".into()
        } else {
            format!("sea level, {geoid_height_m} m above the ellipsoid")
        },
        config: config_text_with(&config, plan.standing_topic.as_deref()),
    }
}

fn topics(log: &Log, origin: Time) -> Result<Vec<TopicReport>, Failure> {
    let statistics = log.statistics()?;
    let report = |(index, (topic, s)): (usize, (&TopicInfo, TopicStatistics))| TopicReport {
        name: topic.name.clone(),
        schema: topic.schema.clone(),
        encoding: topic.encoding.clone(),
        count: topic.count,
        role: role_of(log, index),
        rate_hz: s.rate_hz.or(topic.rate_hz),
        jitter_s: s.jitter_s,
        interval_max_s: s.interval_max_s,
        gaps: s
            .gaps
            .iter()
            .map(|(a, b)| Span {
                begin_s: a.since(origin),
                end_s: b.since(origin),
            })
            .collect(),
        duplicates: s.duplicates,
        backward_steps: s.backward_steps,
        unstamped: s.unstamped,
        not_finite: s.not_finite,
        no_fix: s.no_fix,
        zero_position: s.zero_position,
        header_minus_log_s: s.header_minus_log_s.map(|h| MeanAndRange {
            mean: h.mean,
            min: h.min,
            max: h.max,
        }),
    };
    Ok(log
        .topics()
        .iter()
        .zip(statistics)
        .enumerate()
        .map(report)
        .collect())
}

/// The part a topic plays, or could play if it were chosen.
fn role_of(log: &Log, index: usize) -> Option<&'static str> {
    Role::ALL
        .into_iter()
        .find_map(|role| match log.selected().choice(role) {
            Choice::Topic(i) if *i == index => Some(role.key()),
            _ => None,
        })
}
