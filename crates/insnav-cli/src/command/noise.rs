//! `insnav noise`: what Q and R a log shows.

use super::log_flags::LogFlags;
use super::settings_flags::SettingsFlags;
use crate::failure::{Failure, WARNED};
use crate::output::Output;
use crate::progress::Watched;
use crate::text;
use clap::Args;
use insnav_core::config::Config;
use insnav_log::{Log, NoiseRequest, Role, identify_log_noise};
use std::path::PathBuf;

/// Noise of gyros, accelerometers and magnetometer, with standard errors, as a [noise] block for the settings
///
/// Two ways. Over the longest rest the Allan deviation, with white noise (N), flicker noise (B) and random walk (K) of every axis.
/// Over all of the log, rest or motion, autocovariance least squares (ALS): in windows the gyros carry the attitude, gravity tells
/// its tilt, and what the two noises are follows from the covariances of the innovations. Windows in which the body accelerates do
/// not fit that and are left out. What the log does not tell is kept as it was known, and that is said.
#[derive(Args, Debug)]
pub(crate) struct Noise {
    /// The log: MCAP with ROS 2, ROS 1, JSON or foxglove protobuf messages, `-` is standard input; GNSS is not needed
    log: PathBuf,

    /// Look at the log from here only, seconds from the zero that `insnav info` prints; with --to, this part counts as rest
    #[arg(long, value_name = "S", allow_hyphen_values = true, requires = "to", value_parser = seconds)]
    from: Option<f64>,

    /// And up to here
    #[arg(long, value_name = "S", allow_hyphen_values = true, requires = "from", value_parser = seconds)]
    to: Option<f64>,

    /// Length of a window of ALS, seconds [default: 40 time constants of the best filter, 20 to 60 s]
    #[arg(long, value_name = "S", value_parser = positive)]
    window: Option<f64>,

    /// List every window with its verdict
    #[arg(long)]
    windows: bool,

    #[command(flatten)]
    settings: SettingsFlags,

    #[command(flatten)]
    reading: LogFlags,

    /// End with code 3 when there are warnings about the data
    #[arg(long)]
    strict: bool,
}

fn seconds(text: &str) -> Result<f64, String> {
    text.trim()
        .parse::<f64>()
        .ok()
        .filter(|s| s.is_finite())
        .ok_or_else(|| "must be a number of seconds".into())
}

fn positive(text: &str) -> Result<f64, String> {
    seconds(text)
        .ok()
        .filter(|s| *s > 0.0)
        .ok_or_else(|| "must be a number of seconds above 0".into())
}

impl Noise {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        let part = self.from.zip(self.to).map(|(from, to)| [from, to]);
        if let Some([from, to]) = part
            && from >= to
        {
            return Err(Failure::usage(
                format!("--from {from} is not before --to {to}"),
                "give the earlier time first",
            ));
        }
        let mut config = self.settings.load()?;
        let options = |config: &Config| -> Result<_, Failure> {
            Ok(self.reading.options(config, self.settings.for_reading()?))
        };
        let mut log = Log::open(&self.log, options(&config)?)?;
        if config.gnss.used && log.optional(Role::GnssPosition)?.is_none() {
            // Rest is then looked for without it.
            config.gnss.used = false;
            log = log.read_anew(options(&config)?)?;
        }
        let request = NoiseRequest {
            part,
            window_s: self.window,
        };
        let found = identify_log_noise(&Watched::new(&log), &config, &request)
            .map_err(|e| Failure::from(e).about(&self.log))?;
        output.result(&found, || {
            text::noise_report(&self.log, &found, self.windows)
        });
        output.warnings(&found.warnings);
        Ok(if self.strict && !found.warnings.is_empty() {
            WARNED
        } else {
            0
        })
    }
}
