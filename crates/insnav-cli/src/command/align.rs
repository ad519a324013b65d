//! `insnav align`: attitude, azimuth and drifts from stops.

use super::log_flags::LogFlags;
use super::run::{Interval, interval};
use super::settings_flags::SettingsFlags;
use crate::failure::{Failure, WARNED};
use crate::output::Output;
use crate::progress::Watched;
use crate::text;
use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use insnav_core::alignment::AlignmentMethod;
use insnav_core::config::Config;
use insnav_log::{AlignRequest, Log, Role, align_by_stops};
use std::path::PathBuf;

/// Attitude, heading and sensor drifts from standing data, in one position or several
///
/// Gyros that feel the Earth turn find north by themselves; a turn between stops tells their drift apart from it. Units that do
/// not are levelled, and told how far off the azimuth would be.
#[derive(Args, Debug)]
pub(crate) struct Align {
    /// The log: MCAP with ROS 2, ROS 1, JSON or foxglove protobuf messages, `-` is standard input; GNSS is not needed
    log: PathBuf,

    /// How: auto takes what suits the unit and the stops; multi_position (also two_position) needs a turn between them; zupt2
    /// needs a heading; paper is Lobusov & Fomichev 2014 as it stands
    #[arg(long, value_name = "METHOD", default_value = "auto", value_parser = method())]
    method: AlignmentMethod,

    /// A stop, seconds from the zero that `insnav info` prints (repeatable, comma-separated) [default: those that a run finds]
    #[arg(long, value_name = "BEGIN:END", value_parser = interval, value_delimiter = ',', allow_hyphen_values = true)]
    stop: Vec<Interval>,

    /// Latitude, degrees [default: that of output.origin, else of the fixes in the log]
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = latitude)]
    latitude_deg: Option<f64>,

    /// Heading of the body's forward axis at the first stop's begin, degrees from true north
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = heading, requires = "heading_sigma_deg")]
    heading_deg: Option<f64>,

    /// Its standard deviation, degrees; 0.1° leaves 64 nrad/s (0.013 °/h) of drift unknown at 60° of latitude
    #[arg(long, value_name = "DEG", value_parser = sigma, requires = "heading_deg")]
    heading_sigma_deg: Option<f64>,

    /// The azimuth is called unobservable when its standard deviation would be larger, degrees
    #[arg(long, value_name = "DEG", default_value_t = 5.0, value_parser = limit)]
    max_azimuth_sigma_deg: f64,

    #[command(flatten)]
    settings: SettingsFlags,

    #[command(flatten)]
    reading: LogFlags,

    /// End with code 3 when there are warnings about the data
    #[arg(long)]
    strict: bool,
}

/// The other name of `multi_position`.
const TWO_POSITION: &str = "two_position";

fn method() -> impl TypedValueParser<Value = AlignmentMethod> {
    let names: Vec<PossibleValue> = AlignmentMethod::ALL
        .into_iter()
        .map(|method| {
            let value = PossibleValue::new(method.name());
            match method {
                AlignmentMethod::MultiPosition => value.alias(TWO_POSITION),
                _ => value,
            }
        })
        .collect();
    PossibleValuesParser::new(names).map(|name| {
        AlignmentMethod::ALL
            .into_iter()
            .find(|method| method.name() == name)
            .unwrap_or(AlignmentMethod::MultiPosition)
    })
}

fn number(text: &str, good: impl Fn(f64) -> bool, expected: &str) -> Result<f64, String> {
    text.trim()
        .parse::<f64>()
        .ok()
        .filter(|x| good(*x))
        .ok_or_else(|| format!("must be {expected}"))
}

fn latitude(text: &str) -> Result<f64, String> {
    number(text, |x| x.abs() <= 90.0, "from -90 to 90 degrees")
}

fn heading(text: &str) -> Result<f64, String> {
    number(text, |x| x.abs() <= 360.0, "from -360 to 360 degrees")
}

fn sigma(text: &str) -> Result<f64, String> {
    number(
        text,
        |x| x > 0.0 && x <= 180.0,
        "above 0, at most 180 degrees",
    )
}

fn limit(text: &str) -> Result<f64, String> {
    number(
        text,
        |x| x > 0.0 && x <= 180.0,
        "above 0, at most 180 degrees",
    )
}

impl Align {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        if self.method == AlignmentMethod::Zupt2 && self.heading_deg.is_none() {
            return Err(Failure::usage(
                "--method zupt2 needs the heading of the first stop",
                "give --heading-deg and --heading-sigma-deg",
            ));
        }
        let mut config = self.settings.load()?;
        let options = |config: &Config| -> Result<_, Failure> {
            Ok(self.reading.options(config, self.settings.for_reading()?))
        };
        let mut log = Log::open(&self.log, options(&config)?)?;
        if config.gnss.used && log.optional(Role::GnssPosition)?.is_none() {
            // Stops are then looked for without it.
            config.gnss.used = false;
            log = log.read_anew(options(&config)?)?;
        }
        let mut stops: Vec<[f64; 2]> = self.stop.iter().map(|s| s.0).collect();
        stops.extend(config.stationary.intervals_s.as_slice());
        stops.sort_by(|a, b| a[0].total_cmp(&b[0]));
        stops.dedup();
        let request = AlignRequest {
            method: self.method,
            stops,
            latitude_deg: self.latitude_deg,
            heading_deg: self
                .heading_deg
                .zip(self.heading_sigma_deg)
                .map(|(heading, sigma)| [heading, sigma]),
            largest_azimuth_sigma_deg: Some(self.max_azimuth_sigma_deg),
        };
        let report = align_by_stops(&Watched::new(&log), &config, &request)
            .map_err(|e| Failure::from(e).about(&self.log))?;
        output.result(&report, || text::aligned(&self.log, &report));
        output.warnings(&report.warnings);
        Ok(if self.strict && !report.warnings.is_empty() {
            WARNED
        } else {
            0
        })
    }
}
