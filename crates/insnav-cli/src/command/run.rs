//! `insnav run`: the main job.

use super::log_flags::LogFlags;
use super::settings_flags::SettingsFlags;
use crate::failure::{Failure, WARNED};
use crate::output::Output;
use crate::text;
use clap::Args;
use insnav_core::config::Config;
use insnav_log::{Log, McapSink, Plan, RunOptions, RunReport, Withhold};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Navigate: IMU and GNSS of a log become a trajectory with its uncertainty
#[derive(Args, Debug)]
pub(crate) struct Run {
    /// Logs, MCAP with ROS 2 messages; each is a run of its own
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,

    /// Where to write the solution [default: LOG with the ending .insnav.mcap]; a folder when there are several logs
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,

    /// Overwrite the output
    #[arg(long)]
    force: bool,

    #[command(flatten)]
    settings: SettingsFlags,

    #[command(flatten)]
    reading: LogFlags,

    /// Seconds added to IMU stamps to meet the clock of GNSS positions; auto: find it, and the lag of GNSS velocity, in the
    /// data. Without this flag a difference is looked for and told, but not used
    #[arg(long, value_name = "S|auto", value_parser = time_offset, allow_hyphen_values = true)]
    time_offset: Option<TimeOffset>,

    /// Fixes to keep from the filter, so that `compare` can judge by them: intervals in seconds (120:150,300:330) or one in N
    /// epochs (every:2)
    #[arg(long, value_name = "WHICH", allow_hyphen_values = true)]
    withhold: Option<Withhold>,

    /// Epochs per second to write, or imu for one at every sample [default: 50]
    #[arg(long, value_name = "HZ|imu", value_parser = rate)]
    rate: Option<Rate>,

    /// Heading at the first sample, degrees clockwise from true north [default: from the GNSS course]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    heading_deg: Option<f64>,

    /// End with code 3 when there are warnings about the data
    #[arg(long)]
    strict: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum TimeOffset {
    Auto,
    Seconds(f64),
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Rate(f64);

fn time_offset(text: &str) -> Result<TimeOffset, String> {
    if text == "auto" {
        return Ok(TimeOffset::Auto);
    }
    match text.parse::<f64>() {
        Ok(s) if s.is_finite() => Ok(TimeOffset::Seconds(s)),
        _ => Err("a number of seconds or auto is needed".into()),
    }
}

fn rate(text: &str) -> Result<Rate, String> {
    if text == "imu" {
        return Ok(Rate(0.0));
    }
    match text.parse::<f64>() {
        Ok(hz) if hz.is_finite() && hz > 0.0 => Ok(Rate(hz)),
        _ => Err("a positive number of epochs per second or imu is needed".into()),
    }
}

/// What one run tells, with the names of its files.
#[derive(Debug, Serialize)]
pub(crate) struct Outcome {
    pub(crate) input: PathBuf,
    pub(crate) output: PathBuf,
    #[serde(flatten)]
    pub(crate) report: RunReport,
}

impl Run {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        let config = self.config()?;
        let mut outcomes = Vec::new();
        for log in &self.logs {
            let to = self.output_of(log)?;
            let outcome = self.one(log, &to, &config)?;
            output.warnings(&outcome.report.warnings);
            outcomes.push(outcome);
        }
        let warned = outcomes.iter().any(|o| !o.report.warnings.is_empty());
        match outcomes.as_slice() {
            [one] => output.result(one, || text::run_summary(one)),
            all => output.result(&serde_json::json!({ "runs": all }), || {
                all.iter()
                    .map(text::run_summary)
                    .collect::<Vec<_>>()
                    .join("\n")
            }),
        }
        Ok(if warned && self.strict { WARNED } else { 0 })
    }

    fn config(&self) -> Result<Config, Failure> {
        let mut config = self.settings.load()?;
        if let Some(TimeOffset::Seconds(s)) = self.time_offset {
            config.gnss.time_offset_s = s;
        }
        if let Some(Rate(hz)) = self.rate {
            config.output.rate_hz = hz;
        }
        if self.heading_deg.is_some() {
            config.alignment.heading_deg = self.heading_deg;
        }
        Ok(config)
    }

    fn output_of(&self, log: &Path) -> Result<PathBuf, Failure> {
        let default = default_output(log);
        match &self.output {
            None if log == Path::new("-") => Err(Failure::usage(
                "standard input has no name to derive the output's from",
                "name it with -o",
            )),
            None => Ok(default),
            Some(to) if to.is_dir() => Ok(to.join(default.file_name().unwrap_or_default())),
            Some(to) if self.logs.len() == 1 => Ok(to.clone()),
            Some(to) => Err(Failure::usage(
                format!("{}: several logs need a folder that exists", to.display()),
                "make the folder, or run the logs one by one",
            )),
        }
    }

    fn one(&self, input: &Path, output: &Path, config: &Config) -> Result<Outcome, Failure> {
        let options = RunOptions {
            time_offset_auto: self.time_offset == Some(TimeOffset::Auto),
            ignore_clocks: matches!(self.time_offset, Some(TimeOffset::Seconds(_))),
            withhold: self.withhold.clone().unwrap_or_default(),
        };
        if options.time_offset_auto && input == Path::new("-") {
            return Err(Failure::usage(
                "--time-offset auto reads the log more than once, which standard input does not allow",
                "save the log to a file, or give the offset as a number",
            ));
        }
        let log = Log::open(input, self.reading.options(config))?;
        execute(&log, input, output, config, &options, self.force)
    }
}

/// Plan, run, write.
pub(super) fn execute(
    log: &Log,
    input: &Path,
    output: &Path,
    config: &Config,
    options: &RunOptions,
    force: bool,
) -> Result<Outcome, Failure> {
    if let (Ok(a), Ok(b)) = (input.canonicalize(), output.canonicalize())
        && a == b
    {
        return Err(Failure::new(
            "output_is_input",
            format!(
                "{}: the solution would take the place of the log",
                output.display()
            ),
            "name another output with `-o`",
        ));
    }
    let plan = Plan::make(log, config, options)?;
    let mut sink_options = plan.sink_options();
    sink_options.force = force;
    let metadata = &mut sink_options.metadata;
    metadata.insert("input".into(), input.display().to_string());
    metadata.insert("input_crc32".into(), format!("{:08x}", log.crc32()));
    let mut sink = McapSink::create(output, sink_options)?;
    let report = plan.execute(log, &mut sink)?;
    sink.finish()?;
    Ok(Outcome {
        input: input.into(),
        output: output.into(),
        report,
    })
}

/// `drive.mcap` becomes `drive.insnav.mcap` beside it.
pub(super) fn default_output(log: &Path) -> PathBuf {
    log.with_extension("insnav.mcap")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_and_rates() {
        assert_eq!(time_offset("auto"), Ok(TimeOffset::Auto));
        assert_eq!(time_offset("-0.21"), Ok(TimeOffset::Seconds(-0.21)));
        assert!(time_offset("nan").is_err() && time_offset("later").is_err());
        assert_eq!(rate("imu"), Ok(Rate(0.0)));
        assert!(rate("0").is_err() && rate("-5").is_err());
    }

    #[test]
    fn the_solution_stands_beside_its_log() {
        assert_eq!(
            default_output(Path::new("/data/drive.mcap")),
            Path::new("/data/drive.insnav.mcap")
        );
    }
}
