//! `insnav run`: the main job.

use super::log_flags::LogFlags;
use super::run_inputs::{Ending, Job, job_list, not_the_input};
use super::settings_flags::{SetBy, SettingsFlags};
use crate::failure::{FAILED, Failure, WARNED};
use crate::output::Output;
use crate::progress::Watched;
use crate::text;
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use insnav_core::config::{Config, Intervals, MOST_INTERVALS, NoiseAdapt, StationaryMode};
use insnav_log::{
    ExportFormat, Log, McapSink, Plan, ReadOptions, RunOptions, RunReport, SavedRun, Source,
    Withhold, check_output, export, is_standard_stream,
};
use serde::de::IntoDeserializer;
use serde::{Deserialize, Serialize};
use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// Navigate: IMU and GNSS of a log become a trajectory with its uncertainty
///
/// The log `-` is standard input; it is kept in an unnamed temporary file, since it is read more than once. The output `-` is
/// standard output: text and JSON then go to standard error.
#[derive(Args, Debug)]
pub(crate) struct Run {
    /// Logs, MCAP with ROS 2, ROS 1, JSON or foxglove protobuf messages, or folders of them; each is a run of its own
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
    /// data, or say that they do not tell. Without this flag a difference is looked for and told, but not used
    #[arg(long, value_name = "S|auto", value_parser = time_offset, allow_hyphen_values = true)]
    time_offset: Option<TimeOffset>,

    /// Fixes to keep from the filter, so that `compare` can judge by them: intervals in seconds (120:150,300:330) or one in N
    /// epochs (every:2)
    #[arg(long, value_name = "WHICH", allow_hyphen_values = true)]
    withhold: Option<Withhold>,

    /// Epochs per second to write, or imu for one at every sample [default: 50]
    #[arg(long, value_name = "HZ|imu", value_parser = rate)]
    rate: Option<Rate>,

    /// Heading at the first sample, degrees clockwise from true north [default: from the GNSS course; with --imu-only zero, and the map
    /// is turned by what it really is]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    heading_deg: Option<f64>,

    /// What to make of stops [default: auto, which is static, or zupt on a foot]
    #[arg(long, value_name = "MODE", value_parser = stationary_mode())]
    stationary: Option<StationaryMode>,

    /// An interval in which the vehicle is known to stand, such as 40:200 (repeatable, or a list with commas), in seconds from the
    /// log's zero, which `insnav info` prints: t0_ns of its metadata, else the first IMU stamp, on the clock of --time. Added to
    /// those of the settings; other stops are found all the same. With --resume the zero is that of the first part
    #[arg(long, value_name = "BEGIN:END", value_parser = interval, value_delimiter = ',', allow_hyphen_values = true)]
    stop: Vec<Interval>,

    /// als: estimate the white noise of the IMU and the sigmas of GNSS from the log's own innovations, in up to five runs before the one that
    /// is written. What the log does not tell, or what is no white noise, stays as it was; the summary tells of each [default: off]
    #[arg(long, value_name = "HOW", value_parser = noise_adapt())]
    noise_adapt: Option<NoiseAdapt>,

    /// Navigate without GNSS, from rest at the begin: positions count from the start, which is at output.origin if the settings
    /// have it. GNSS in the log is not used. On a foot, with --set vehicle.kind=foot, every step's stance bounds the drift
    #[arg(long)]
    imu_only: bool,

    /// Latitude of a run without GNSS, degrees [default: that of output.origin, else 45]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    latitude_deg: Option<f64>,

    /// Stop in the middle of everything and keep the run in this file, to go on with the next log of the drive by --resume:
    /// both outputs together are those of one run with the settings that this one chose. The last seconds of this log come out with the next one
    #[arg(long, value_name = "FILE")]
    save_state: Option<PathBuf>,

    /// Go on with a run kept by --save-state, under the same settings: noise, clocks and lever arm stay as they were chosen
    #[arg(long, value_name = "FILE")]
    resume: Option<PathBuf>,

    /// How many logs to run at once
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256))]
    jobs: u16,

    /// Only print the settings that the run would use, completed from the data, as TOML
    #[arg(long)]
    print_config: bool,

    /// Write the solution in other formats too, beside the output under its name: csv, tum, kml, geojson (repeatable, or a list
    /// with commas)
    #[arg(long, value_name = "FORMAT", value_parser = export_format, value_delimiter = ',')]
    also: Vec<ExportFormat>,

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

/// Begin and end, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Interval(pub(super) [f64; 2]);

pub(super) fn interval(text: &str) -> Result<Interval, String> {
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|s| s.is_finite());
    let both = text
        .split_once(':')
        .and_then(|(begin, end)| Some([number(begin)?, number(end)?]));
    match both {
        Some([begin, end]) if begin < end => Ok(Interval([begin, end])),
        Some(_) => Err("its end is not after its begin".into()),
        None => Err("begin:end in seconds is needed, such as 40:200".into()),
    }
}

/// All of `stationary.mode`, by the names of the settings.
const STATIONARY_MODES: [&str; 8] = [
    "auto",
    "off",
    "zupt",
    "zihr",
    "heading_hold",
    "attitude_hold",
    "static",
    "batch",
];

fn stationary_mode() -> impl TypedValueParser<Value = StationaryMode> {
    PossibleValuesParser::new(STATIONARY_MODES).try_map(|text| mode_of(&text))
}

fn noise_adapt() -> impl TypedValueParser<Value = NoiseAdapt> {
    PossibleValuesParser::new(["als", "off"]).map(|text| match text.as_str() {
        "als" => NoiseAdapt::Als,
        _ => NoiseAdapt::Off,
    })
}

fn mode_of(text: &str) -> Result<StationaryMode, serde::de::value::Error> {
    let name: serde::de::value::StrDeserializer<'_, serde::de::value::Error> =
        text.into_deserializer();
    StationaryMode::deserialize(name)
}

/// Two intervals that share more than an end.
fn overlap(a: [f64; 2], b: [f64; 2]) -> bool {
    a[0] < b[1] && b[0] < a[1]
}

fn export_format(text: &str) -> Result<ExportFormat, String> {
    ExportFormat::from_name(text).ok_or_else(|| {
        format!(
            "known are {}",
            ExportFormat::ALL.map(ExportFormat::name).join(", ")
        )
    })
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
    /// What was written besides, by `--also`.
    pub(crate) also: Vec<PathBuf>,
    #[serde(flatten)]
    pub(crate) report: RunReport,
}

/// One of several runs: done or failed.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Entry {
    Done(Box<Outcome>),
    Failed { input: PathBuf, error: Failure },
}

impl Run {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        let config = self.config()?;
        let jobs = job_list(&self.logs, self.output.as_deref(), Ending::Solution)?;
        self.check_combination(&jobs)?;
        if self.print_config {
            return self.print_config(&jobs, &config, output);
        }
        if jobs.iter().any(|job| is_standard_stream(&job.output)) {
            output.leave_stdout_to_a_file();
        }
        let single = jobs.len() == 1 && !self.logs[0].is_dir();
        let mut warned = false;
        let mut entries = Vec::new();
        let mut failures = 0_u32;
        let mut quiet = None;
        self.each(&jobs, &config, |job, result| match result {
            Ok(outcome) => {
                warned |= !outcome.report.warnings.is_empty();
                output.warnings(&outcome.report.warnings);
                entries.push(Entry::Done(Box::new(outcome)));
            }
            Err(error) => {
                failures += 1;
                if !single {
                    output.complain(&error.clone().about(&job.input));
                }
                quiet.get_or_insert(error.clone());
                entries.push(Entry::Failed {
                    input: job.input.clone(),
                    error,
                });
            }
        });
        if single {
            match (entries.pop(), quiet) {
                (_, Some(error)) => return Err(error),
                (Some(Entry::Done(one)), None) => {
                    output.result(&*one, || text::run_summary(&one));
                }
                _ => {}
            }
        } else {
            output.result(&serde_json::json!({ "runs": entries }), || {
                summaries(&entries)
            });
        }
        Ok(match (failures, warned && self.strict) {
            (1.., _) => FAILED,
            (0, true) => WARNED,
            (0, false) => 0,
        })
    }

    fn config(&self) -> Result<Config, Failure> {
        let mut stops: Vec<[f64; 2]> = self.stop.iter().map(|i| i.0).collect();
        stops.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut refused = None;
        let config = self.settings.load_over(|config| {
            let mut set_by = Vec::new();
            let mut by = |key, flag: String| set_by.push(SetBy { flag, key });
            if let Some(TimeOffset::Seconds(s)) = self.time_offset {
                config.gnss.time_offset_s = s;
                by("gnss.time_offset_s", format!("--time-offset {s}"));
            }
            if let Some(Rate(hz)) = self.rate {
                config.output.rate_hz = hz;
                by("output.rate_hz", format!("--rate {hz}"));
            }
            if self.imu_only {
                config.gnss.used = false;
            }
            if let Some(latitude) = self.latitude_deg {
                config.alignment.latitude_deg = Some(latitude);
                by(
                    "alignment.latitude_deg",
                    format!("--latitude-deg {latitude}"),
                );
            }
            if let Some(heading) = self.heading_deg {
                config.alignment.heading_deg = Some(heading);
                by("alignment.heading_deg", format!("--heading-deg {heading}"));
            }
            if let Some(mode) = self.stationary {
                config.stationary.mode = mode;
                by("stationary.mode", "--stationary".into());
            }
            if let Some(adapt) = self.noise_adapt {
                config.noise.adapt = adapt;
            }
            if !stops.is_empty() {
                match self.with_stops(&config.stationary.intervals_s, &stops) {
                    Ok(all) => config.stationary.intervals_s = all,
                    Err(failure) => refused = Some(failure),
                }
                // Among themselves: what the settings have is the settings' fault.
                if stops.windows(2).any(|pair| overlap(pair[0], pair[1])) {
                    let list: Vec<String> = stops.iter().map(|[a, b]| format!("{a}:{b}")).collect();
                    let flag = format!("--stop {}", list.join(","));
                    by("stationary.intervals_s", flag);
                }
            }
            set_by
        });
        match refused {
            Some(failure) => Err(failure),
            None => config,
        }
    }

    /// Intervals of the settings and those of `--stop`, which are sorted, in order.
    fn with_stops(&self, given: &Intervals, stops: &[[f64; 2]]) -> Result<Intervals, Failure> {
        let mut all = stops.to_vec();
        for given in given.as_slice() {
            // What a run says that it used may be given back to it together with its flags.
            if stops.contains(given) {
                continue;
            }
            if let Some([a, b]) = stops.iter().find(|stop| overlap(**stop, *given)) {
                let [c, d] = given;
                return Err(Failure::new(
                    "bad_config_value",
                    format!(
                        "--stop {a}:{b} overlaps {c}:{d} of {}: both are used",
                        self.settings.source_of("stationary.intervals_s")
                    ),
                    "give the whole interval in one of the two places",
                )
                .into_usage());
            }
            all.push(*given);
        }
        all.sort_by(|a, b| a[0].total_cmp(&b[0]));
        Intervals::new(&all).ok_or_else(|| {
            Failure::usage(
                format!(
                    "--stop: {} intervals, those of the settings counted, are more than {MOST_INTERVALS}",
                    all.len()
                ),
                "declare standing by a topic: `--topic standing=/its/name`",
            )
        })
    }

    /// What cannot be done together is said before anything is done.
    fn check_combination(&self, jobs: &[Job]) -> Result<(), Failure> {
        let from_stdin = jobs.iter().any(|job| is_standard_stream(&job.input));
        if from_stdin && self.time_offset == Some(TimeOffset::Auto) {
            return Err(Failure::usage(
                "--time-offset auto is not for standard input: the next part of a stream would get another offset",
                "save the log to a file, or give the offset as a number",
            ));
        }
        if from_stdin && std::io::stdin().is_terminal() {
            return Err(Failure::usage(
                "standard input is a terminal, and a log is binary",
                "send a log into it: `insnav run - -o out.mcap < drive.mcap`",
            ));
        }
        let other = |job: &Job| {
            let ending = job.output.extension()?.to_str()?.to_lowercase();
            ExportFormat::from_name(&ending)
        };
        if let Some((job, format)) = jobs.iter().find_map(|job| Some((job, other(job)?))) {
            return Err(Failure::usage(
                format!(
                    "{}: a solution is written as MCAP, and that is a name for {}",
                    job.output.display(),
                    format.name()
                ),
                format!(
                    "give it the ending .mcap; `--also {}` writes the other beside it",
                    format.name()
                ),
            ));
        }
        if !self.also.is_empty() && jobs.iter().any(|job| is_standard_stream(&job.output)) {
            return Err(Failure::usage(
                "--also writes beside the output, and standard output has no place",
                "name the output with -o",
            ));
        }
        if let Some(path) = &self.save_state
            && is_standard_stream(path)
        {
            return Err(Failure::usage(
                "--save-state -: a state is kept in a file, for --resume",
                "name a file with --save-state",
            ));
        }
        if jobs.len() > 1 && (self.save_state.is_some() || self.resume.is_some()) {
            return Err(Failure::usage(
                "--save-state and --resume are for one log at a time",
                "run the parts of a drive one after the other, in order",
            ));
        }
        Ok(())
    }

    /// Run every job, at most `--jobs` at once, and tell each result in the order of the jobs.
    fn each(
        &self,
        jobs: &[Job],
        config: &Config,
        mut tell: impl FnMut(&Job, Result<Outcome, Failure>),
    ) {
        // All outputs are looked at before the first hour of work.
        let mut refused: Vec<Option<Failure>> =
            jobs.iter().map(|job| self.check_job(job).err()).collect();
        let workers = usize::from(self.jobs).min(jobs.len());
        if workers <= 1 {
            for (job, refused) in jobs.iter().zip(refused) {
                let result = refused.map_or_else(|| self.one(job, config, true), Err);
                tell(job, result);
            }
            return;
        }
        let next = AtomicUsize::new(0);
        let (sender, results) = mpsc::channel();
        let todo: Vec<usize> = (0..jobs.len()).filter(|&i| refused[i].is_none()).collect();
        std::thread::scope(|scope| {
            for _ in 0..workers {
                let (sender, next, todo) = (sender.clone(), &next, &todo);
                scope.spawn(move || {
                    while let Some(&i) = todo.get(next.fetch_add(1, Ordering::Relaxed)) {
                        // Several bars in one place would only flicker.
                        let result = self.one(&jobs[i], config, false);
                        if sender.send((i, result)).is_err() {
                            break;
                        }
                    }
                });
            }
            drop(sender);
            let mut done: Vec<Option<Result<Outcome, Failure>>> =
                refused.iter_mut().map(|r| r.take().map(Err)).collect();
            let mut told = 0;
            loop {
                while let Some(result) = done.get_mut(told).and_then(Option::take) {
                    tell(&jobs[told], result);
                    told += 1;
                }
                let Ok((i, result)) = results.recv() else {
                    break;
                };
                done[i] = Some(result);
            }
        });
    }

    fn check_job(&self, job: &Job) -> Result<(), Failure> {
        not_the_input(&job.input, &job.output)?;
        check_output(&job.output, self.force)?;
        for (_, path) in self.also_paths(job) {
            not_the_input(&job.input, &path)?;
            if path == job.output {
                return Err(Failure::usage(
                    format!("{}: --also would write over the solution", path.display()),
                    "give the solution the ending .mcap",
                ));
            }
            check_output(&path, self.force)?;
        }
        if let Some(path) = &self.save_state {
            not_the_input(&job.input, path).map_err(of_state)?;
            check_output(path, self.may_replace_state(path)).map_err(|e| of_state(e.into()))?;
        }
        Ok(())
    }

    /// A state may take the place of the one that it goes on from, as in a loop over the parts of a drive.
    fn may_replace_state(&self, path: &Path) -> bool {
        self.force || self.resume.as_deref() == Some(path)
    }

    fn options(&self) -> RunOptions {
        RunOptions {
            time_offset_auto: self.time_offset == Some(TimeOffset::Auto),
            ignore_clocks: matches!(self.time_offset, Some(TimeOffset::Seconds(_))),
            withhold: self.withhold.clone().unwrap_or_default(),
            start: None,
            more_follows: self.save_state.is_some(),
            ..RunOptions::default()
        }
    }

    fn saved(&self) -> Result<Option<SavedRun>, Failure> {
        Ok(self.resume.as_deref().map(SavedRun::read).transpose()?)
    }

    fn open(&self, job: &Job, config: &Config, saved: Option<&SavedRun>) -> Result<Log, Failure> {
        let mut options = self.reading.options(config, self.settings.for_reading()?);
        if let Some(saved) = saved {
            options = saved.read_options(options);
        }
        Ok(Log::open(&job.input, options)?)
    }

    fn plan(
        &self,
        source: &(impl Source + ?Sized),
        config: &Config,
        saved: Option<&SavedRun>,
    ) -> Result<Plan, Failure> {
        Ok(match saved {
            Some(saved) => Plan::resume(source, config, &self.options(), saved)?,
            None => Plan::make(source, config, &self.options())?,
        })
    }

    fn one(&self, job: &Job, config: &Config, watched: bool) -> Result<Outcome, Failure> {
        let saved = self.saved()?;
        let log = self.open(job, config, saved.as_ref())?;
        let source: &dyn Source = if watched { &Watched::new(&log) } else { &log };
        let plan = self.plan(source, config, saved.as_ref())?;
        let mut sink = sink(&plan, &log, job, self.force)?;
        let keep = self.save_state.is_some();
        let (report, state) = plan.execute_part(source, &mut sink, saved.as_ref(), keep)?;
        sink.finish()?;
        let also = self.export(job)?;
        if let (Some(path), Some(state)) = (&self.save_state, state) {
            state
                .write(path, self.may_replace_state(path))
                .map_err(|e| of_state(e.into()))?;
        }
        Ok(Outcome {
            input: job.input.clone(),
            output: job.output.clone(),
            also,
            report,
        })
    }

    /// The other files that `--also` asks for.
    fn also_paths<'a>(
        &'a self,
        job: &'a Job,
    ) -> impl Iterator<Item = (ExportFormat, PathBuf)> + 'a {
        let beside = |format: &ExportFormat| (*format, job.output.with_extension(format.name()));
        self.also.iter().map(beside)
    }

    fn export(&self, job: &Job) -> Result<Vec<PathBuf>, Failure> {
        if self.also.is_empty() {
            return Ok(Vec::new());
        }
        // From the file, in blocks: a solution of ten hours is not kept in memory.
        let solution = Log::open(&job.output, ReadOptions::default())?;
        self.also_paths(job)
            .map(|(format, path)| {
                export(&solution, &path, format, self.force)?;
                Ok(path)
            })
            .collect()
    }

    fn print_config(&self, jobs: &[Job], config: &Config, output: &Output) -> Result<u8, Failure> {
        let [job] = jobs else {
            return Err(Failure::usage(
                "--print-config is for one log at a time",
                "give one log",
            ));
        };
        let saved = self.saved()?;
        let log = self.open(job, config, saved.as_ref())?;
        let plan = self.plan(&Watched::new(&log), config, saved.as_ref())?;
        let text = plan.config_text();
        output.warnings(&plan.warnings);
        output.result(&serde_json::json!({ "config": text }), || text.clone());
        Ok(0)
    }
}

/// The same failure about the file of `--save-state`: its remedies name the flag of the solution.
fn of_state(mut failure: Failure) -> Failure {
    let remedy = &mut failure.problem.remedy;
    *remedy = remedy.replace("`-o`", "`--save-state`");
    failure
}

fn summaries(entries: &[Entry]) -> String {
    let summary = |entry: &Entry| match entry {
        Entry::Done(outcome) => text::run_summary(outcome),
        Entry::Failed { input, error } => {
            format!("{}: failed: {}\n", input.display(), error.message)
        }
    };
    let all: Vec<String> = entries.iter().map(summary).collect();
    all.join("\n")
}

/// Plan, run, write.
pub(super) fn execute(
    log: &Log,
    job: &Job,
    config: &Config,
    options: &RunOptions,
    force: bool,
) -> Result<Outcome, Failure> {
    not_the_input(&job.input, &job.output)?;
    let source = Watched::new(log);
    let plan = Plan::make(&source, config, options)?;
    let mut sink = sink(&plan, log, job, force)?;
    let report = plan.execute(&source, &mut sink)?;
    sink.finish()?;
    Ok(Outcome {
        input: job.input.clone(),
        output: job.output.clone(),
        also: Vec::new(),
        report,
    })
}

fn sink(plan: &Plan, log: &Log, job: &Job, force: bool) -> Result<McapSink, Failure> {
    let mut options = plan.sink_options();
    options.force = force;
    let metadata = &mut options.metadata;
    metadata.insert("input".into(), job.input.display().to_string());
    metadata.insert("input_crc32".into(), format!("{:08x}", log.crc32()));
    Ok(McapSink::create(&job.output, options)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn offsets_and_rates() {
        assert_eq!(time_offset("auto"), Ok(TimeOffset::Auto));
        assert_eq!(time_offset("-0.21"), Ok(TimeOffset::Seconds(-0.21)));
        assert!(time_offset("nan").is_err() && time_offset("later").is_err());
        assert_eq!(interval("-1.5:200"), Ok(Interval([-1.5, 200.0])));
        for wrong in ["40", "40:", "200:40", "40:40", "nan:1", "40-200"] {
            assert!(interval(wrong).is_err(), "{wrong}");
        }
        assert!(overlap([1.0, 3.0], [2.0, 4.0]) && !overlap([1.0, 2.0], [2.0, 4.0]));
        assert_eq!(rate("imu"), Ok(Rate(0.0)));
        assert!(rate("0").is_err() && rate("-5").is_err());
    }

    /// The flag and the settings know the same names.
    #[test]
    fn modes_are_those_of_the_settings() {
        assert_eq!(mode_of("heading_hold"), Ok(StationaryMode::HeadingHold));
        for name in STATIONARY_MODES {
            assert!(mode_of(name).is_ok(), "{name}");
        }
        let all = STATIONARY_MODES.map(|name| format!("`{name}`")).join(", ");
        let told = mode_of("hold").unwrap_err().to_string();
        assert!(told.ends_with(&format!("expected one of {all}")), "{told}");
    }
}
