//! `insnav ahrs`: orientation from gyro, accelerometer and magnetometer.

use super::log_flags::LogFlags;
use super::run_inputs::{Ending, Job, job_list, not_the_input};
use super::settings_flags::SettingsFlags;
use crate::failure::{FAILED, Failure, WARNED};
use crate::output::Output;
use crate::progress::Watched;
use crate::text;
use clap::Args;
use insnav_core::config::Config;
use insnav_log::{
    Choice, GyroRange, Log, OrientationNoise, OrientationPlan, OrientationReport,
    OrientationRequest, OrientationSink, OrientationSinkOptions, OrientationTable, ReadOptions,
    Role, Warning, check_output, is_standard_stream,
};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Orientation with its covariance, from gyro, accelerometer and, where there is one, magnetometer
///
/// Written as /insnav/imu (sensor_msgs/Imu: body forward-left-up against east, north, up, with covariance) and /tf. Headings count
/// from magnetic north, or from true north with --set alignment.declination_deg=…; without a magnetometer from where the body looked
/// at the begin. Roll and pitch need none.
#[derive(Args, Debug)]
pub(crate) struct Ahrs {
    /// Logs, MCAP with ROS 2, ROS 1, JSON or foxglove protobuf messages, or folders of them; GNSS is not needed
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,

    /// Noise of the sensors: auto, what each log shows by itself, as `insnav noise` finds it; datasheet, what the settings say and else
    /// the class of the unit; or a file with a [noise] block
    #[arg(long, value_name = "auto|datasheet|FILE", default_value = "auto")]
    noise: NoiseFrom,

    /// Use the whole log for every instant, in place of what was before it
    #[arg(long)]
    smooth: bool,

    /// Where the gyros' range ends, degrees per second, or none [default: where the log shows it]
    #[arg(long, value_name = "DEG_PER_S|none", value_parser = gyro_range)]
    gyro_range: Option<Range>,

    /// How fast the carrier goes about, standard deviation in m/s: 1 for hands, people and small robots, 8 for cars, whose long
    /// accelerations look like tilts otherwise [default: 1]
    #[arg(long, value_name = "M_PER_S", value_parser = carrier_speed)]
    carrier_speed: Option<f64>,

    /// Where to write [default: LOG with the ending .ahrs.mcap]; a folder when there are several logs
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,

    /// Overwrite the output
    #[arg(long)]
    force: bool,

    /// Orientations per second to write, or imu for one at every sample
    #[arg(long, value_name = "HZ|imu", default_value = "imu", value_parser = rate)]
    rate: Rate,

    /// Write a table of quaternions too, beside the output under its name: csv
    #[arg(long, value_name = "FORMAT", value_parser = ["csv"])]
    also: Option<String>,

    #[command(flatten)]
    settings: SettingsFlags,

    #[command(flatten)]
    reading: LogFlags,

    /// End with code 3 when there are warnings about the data
    #[arg(long)]
    strict: bool,
}

/// A speed that a carrier can have.
fn carrier_speed(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(speed) if (0.01..=1000.0).contains(&speed) => Ok(speed),
        _ => Err("must be from 0.01 to 1000 m/s".into()),
    }
}

/// Where the noise is taken from.
#[derive(Clone, Debug, PartialEq)]
enum NoiseFrom {
    Auto,
    DataSheet,
    File(PathBuf),
}

impl From<&str> for NoiseFrom {
    fn from(text: &str) -> Self {
        match text {
            "auto" => NoiseFrom::Auto,
            "datasheet" => NoiseFrom::DataSheet,
            path => NoiseFrom::File(path.into()),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Rate(f64);

#[derive(Clone, Copy, Debug, PartialEq)]
struct Range(GyroRange);

fn gyro_range(text: &str) -> Result<Range, String> {
    if text == "none" {
        return Ok(Range(GyroRange::Unlimited));
    }
    match text.parse::<f64>() {
        Ok(range) if range.is_finite() && range > 0.0 => {
            Ok(Range(GyroRange::Of(range.to_radians())))
        }
        _ => Err("a positive number of degrees per second or none is needed".into()),
    }
}

fn rate(text: &str) -> Result<Rate, String> {
    if text == "imu" {
        return Ok(Rate(0.0));
    }
    match text.parse::<f64>() {
        Ok(hz) if hz.is_finite() && hz > 0.0 => Ok(Rate(hz)),
        _ => Err("a positive number of orientations per second or imu is needed".into()),
    }
}

/// What one log gave, with the names of its files.
#[derive(Debug, Serialize)]
pub(crate) struct Oriented {
    pub(crate) input: PathBuf,
    pub(crate) output: PathBuf,
    /// What was written besides, by `--also`.
    pub(crate) also: Vec<PathBuf>,
    #[serde(flatten)]
    pub(crate) report: OrientationReport,
}

/// One of several logs: done or failed.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Entry {
    Done(Box<Oriented>),
    Failed { input: PathBuf, error: Failure },
}

impl Ahrs {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        let config = self.config()?;
        let jobs = job_list(&self.logs, self.output.as_deref(), Ending::Orientation)?;
        let to_stdout = jobs.iter().any(|job| is_standard_stream(&job.output));
        if to_stdout && self.also.is_some() {
            return Err(Failure::usage(
                "--also writes beside the output, and standard output has no place",
                "name the output with -o",
            ));
        }
        if let Some(job) = jobs.iter().find(|job| is_table(&job.output)) {
            return Err(Failure::usage(
                format!(
                    "{}: an orientation is written as MCAP, and that is a name for CSV",
                    job.output.display()
                ),
                "give it the ending .mcap; `--also csv` writes the table beside it",
            ));
        }
        if to_stdout {
            output.leave_stdout_to_a_file();
        }
        for job in &jobs {
            not_the_input(&job.input, &job.output)?;
            check_output(&job.output, self.force)?;
            if let Some(table) = self.table(job) {
                check_output(&table, self.force)?;
            }
        }
        let single = jobs.len() == 1 && !self.logs[0].is_dir();
        let (mut warned, mut failed) = (false, false);
        let mut entries = Vec::new();
        for job in &jobs {
            match self.one(job, &config) {
                Ok(done) => {
                    warned |= !done.report.warnings.is_empty();
                    output.warnings(&done.report.warnings);
                    entries.push(Entry::Done(Box::new(done)));
                }
                Err(error) if single => return Err(error.about(&job.input)),
                Err(error) => {
                    failed = true;
                    output.complain(&error.clone().about(&job.input));
                    entries.push(Entry::Failed {
                        input: job.input.clone(),
                        error,
                    });
                }
            }
        }
        let text = || {
            let one = |entry: &Entry| match entry {
                Entry::Done(done) => text::oriented(done),
                Entry::Failed { input, error } => {
                    format!("{}: failed: {}\n", input.display(), error.message)
                }
            };
            entries.iter().map(one).collect::<Vec<_>>().join("\n")
        };
        match entries.as_slice() {
            [Entry::Done(done)] if single => output.result(&**done, text),
            all => output.result(&serde_json::json!({ "runs": all }), text),
        }
        Ok(match (failed, warned && self.strict) {
            (true, _) => FAILED,
            (false, true) => WARNED,
            (false, false) => 0,
        })
    }

    /// The settings, with the noise of `--noise FILE` over them.
    fn config(&self) -> Result<Config, Failure> {
        let mut config = self.settings.load()?;
        if let NoiseFrom::File(path) = &self.noise {
            if !path.exists() {
                return Err(Failure::usage(
                    format!(
                        "--noise {}: no such file, and neither auto nor datasheet",
                        path.display()
                    ),
                    "give auto, datasheet, or the path of a file with a [noise] block, such as `insnav noise` prints",
                ));
            }
            config.noise = self.settings.noise_of(path)?;
        }
        Ok(config)
    }

    fn table(&self, job: &Job) -> Option<PathBuf> {
        self.also.as_ref()?;
        Some(job.output.with_extension("csv"))
    }

    fn one(&self, job: &Job, config: &Config) -> Result<Oriented, Failure> {
        let mut config = *config;
        let options = |config: &Config| -> Result<_, Failure> {
            Ok(self.reading.options(config, self.settings.for_reading()?))
        };
        let mut log = Log::open(&job.input, options(&config)?)?;
        // Neither wanted nor needed.
        config.gnss.used = false;
        log = log.read_anew(options(&config)?)?;
        log.require(Role::Imu)?;
        let source = Watched::new(&log);
        let request = OrientationRequest {
            noise: match self.noise {
                NoiseFrom::Auto => OrientationNoise::Identified,
                _ => OrientationNoise::Stated,
            },
            smooth: self.smooth,
            gyro_range: self.gyro_range.map_or(GyroRange::AsSeen, |r| r.0),
            carrier_speed: self.carrier_speed,
        };
        let plan = OrientationPlan::make(&source, &config, request)?;
        let mut metadata = plan.metadata();
        metadata.insert("input".into(), job.input.display().to_string());
        metadata.insert("input_crc32".into(), format!("{:08x}", log.crc32()));
        let options = OrientationSinkOptions {
            force: self.force,
            rate_hz: self.rate.0,
            metadata,
            ..OrientationSinkOptions::default()
        };
        let mut sink = OrientationSink::create(&job.output, options)?;
        let mut report = plan.execute(&source, |epoch| sink.write(epoch))?;
        sink.finish()?;
        report.warnings.extend(log.recovery_warning());
        report.warnings.extend(several(&log));
        let mut also = Vec::new();
        if let Some(path) = self.table(job) {
            let written = Log::open(&job.output, ReadOptions::default())?;
            OrientationTable::from_mcap(&written)?.write_csv(&path, self.force)?;
            also.push(path);
        }
        Ok(Oriented {
            input: job.input.clone(),
            output: job.output.clone(),
            also,
            report,
        })
    }
}

/// Magnetometers of which none is taken.
fn several(log: &Log) -> Option<Warning> {
    let Choice::Ambiguous(topics) = log.selected().choice(Role::Magnetometer) else {
        return None;
    };
    let names: Vec<&str> = topics
        .iter()
        .map(|topic| log.topics()[*topic].name.as_str())
        .collect();
    Some(Warning {
        code: "several_magnetometers",
        message: format!(
            "{}: several magnetometers, none of which is taken: {}",
            log.path().display(),
            names.join(", ")
        ),
        remedy: format!(
            "name one: `--topic magnetometer={}`",
            names.first().unwrap_or(&"/its/name")
        ),
    })
}

fn is_table(path: &Path) -> bool {
    let name = path.to_string_lossy().to_lowercase();
    name.ends_with(".csv") || name.ends_with(".csv.gz")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_and_rates() {
        assert_eq!(NoiseFrom::from("auto"), NoiseFrom::Auto);
        assert_eq!(NoiseFrom::from("datasheet"), NoiseFrom::DataSheet);
        assert_eq!(NoiseFrom::from("a.toml"), NoiseFrom::File("a.toml".into()));
        assert_eq!((rate("imu"), rate("50")), (Ok(Rate(0.0)), Ok(Rate(50.0))));
        assert_eq!(gyro_range("none"), Ok(Range(GyroRange::Unlimited)));
        assert!(gyro_range("-1").is_err() && gyro_range("fast").is_err());
        assert!(rate("0").is_err() && rate("nan").is_err());
        assert!(is_table(Path::new("a.csv.gz")) && !is_table(Path::new("a.ahrs.mcap")));
    }
}
