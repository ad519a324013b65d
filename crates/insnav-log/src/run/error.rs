//! Why a run did not come to its end.

use super::saved::StateError;
use crate::{ConfigError, Finding, LogError};
use insnav_core::error::Error as CoreError;

/// Why a run failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The log.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The settings.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A saved run.
    #[error(transparent)]
    State(#[from] StateError),
    /// The navigator.
    #[error(transparent)]
    Navigator(#[from] CoreError),
    /// No inertial sample.
    #[error("no inertial samples")]
    NoImu,
    /// No position fix.
    #[error("no GNSS position: {dropped_hint}")]
    NoGnss {
        /// What may be behind it.
        dropped_hint: &'static str,
    },
    /// Every position that the log has is withheld.
    #[error("all {positions} GNSS positions are withheld: nothing is left to start from")]
    AllWithheld {
        /// How many there are.
        positions: usize,
    },
    /// A run without GNSS that does not begin at rest.
    #[error("without GNSS a run begins at rest: {missing}")]
    NoRest {
        /// What was missing.
        missing: &'static str,
    },
    /// An option about GNSS for a run without it.
    #[error("{option} is about GNSS, and this run is without it")]
    NeedsGnss {
        /// Which option.
        option: &'static str,
    },
    /// Positions and inertial data of different times.
    #[error(
        "no GNSS position lies within the inertial data: IMU from {imu_begin:.1} to {imu_end:.1} s, positions from \
         {gnss_begin:.1} to {gnss_end:.1} s (Unix time)"
    )]
    NoOverlap {
        /// First IMU stamp, s.
        imu_begin: f64,
        /// Last IMU stamp, s.
        imu_end: f64,
        /// First position stamp, s.
        gnss_begin: f64,
        /// Last position stamp, s.
        gnss_end: f64,
    },
    /// A start that is known, at a time of which there are no inertial data.
    #[error(
        "the start is given for {time:.3} s, the inertial data reach from {imu_begin:.3} to {imu_end:.3} s"
    )]
    StartOutside {
        /// The start as given, s after the run's zero.
        time: f64,
        /// First IMU stamp, s after the run's zero.
        imu_begin: f64,
        /// Last IMU stamp, s after the run's zero.
        imu_end: f64,
    },
    /// A detector of stops that looks at more than there is.
    #[error(
        "stationary.window_s = {window} s is longer than the log, whose inertial data last {span:.1} s"
    )]
    WindowTooLong {
        /// The window, s.
        window: f64,
        /// The inertial data, s.
        span: f64,
    },
    /// Noise that cannot be identified.
    #[error(transparent)]
    Noise(insnav_core::noise::Refusal),
    /// A part of the log of which there are no inertial data.
    #[error(
        "the part from {from} to {to} s has no inertial data: they reach from {imu_begin:.3} to {imu_end:.3} s"
    )]
    PartOutside {
        /// Begin of the part, s after the log's zero.
        from: f64,
        /// Its end.
        to: f64,
        /// First IMU stamp, s after the log's zero.
        imu_begin: f64,
        /// Last IMU stamp.
        imu_end: f64,
    },
    /// An alignment without a latitude.
    #[error("no latitude: the log has no GNSS position, and none is given")]
    NoLatitude,
    /// An alignment without stops.
    #[error("no stop of five seconds was found among {found}")]
    NoStops {
        /// How many shorter ones there are.
        found: usize,
    },
    /// Data that would give no solution worth the name.
    #[error("{}: {}{}", finding.evidence, finding.consequence, more(*others))]
    Unusable {
        /// What is wrong.
        finding: Box<Finding>,
        /// How many more findings of that kind there are.
        others: usize,
    },
    /// Somebody asked a [`crate::Stoppable`] source to stop.
    #[error("interrupted")]
    Interrupted,
    /// Nearly all inertial samples are not finite.
    #[error("{not_finite} of {samples} inertial samples have NaN or infinity in them")]
    ImuNotFinite {
        /// How many are bad.
        not_finite: usize,
        /// Of how many.
        samples: usize,
    },
}

/// What a start lacks, by what the core says of it.
fn remedy_of_no_start(missing: &str) -> &'static str {
    if missing.contains("rest") {
        "let the recording begin with two seconds or more without any motion"
    } else if missing.contains("position") {
        "check with `insnav info` what the receiver says about its fixes, or navigate without them, from rest: `--imu-only`"
    } else {
        "check with `insnav info` that the IMU topic has messages"
    }
}

fn more(others: usize) -> String {
    match others {
        0 => String::new(),
        n => format!(" ({n} more of this kind: see `insnav info`)"),
    }
}

impl RunError {
    /// A short name for programs.
    pub fn code(&self) -> &'static str {
        match self {
            RunError::Log(e) => e.code(),
            RunError::Config(e) => e.code(),
            RunError::State(e) => e.code(),
            RunError::Navigator(CoreError::ImuBackward { .. }) => "backward_stamps",
            RunError::Navigator(CoreError::NotFinite { .. }) | RunError::ImuNotFinite { .. } => {
                "not_finite"
            }
            RunError::Navigator(CoreError::Config { .. }) => "bad_config_value",
            RunError::Navigator(CoreError::NotStarted { .. }) => "not_started",
            RunError::Navigator(CoreError::NotObservable { .. }) => "not_observable",
            RunError::Navigator(CoreError::Alignment(refusal)) => refusal.code(),
            RunError::Navigator(_) => "navigator",
            RunError::NoLatitude => "no_latitude",
            RunError::Noise(refusal) => super::noise::code(refusal),
            RunError::PartOutside { .. } => "part_outside",
            RunError::NoStops { .. } => "no_stops",
            RunError::Interrupted => "interrupted",
            RunError::NoImu => "no_imu_samples",
            RunError::Unusable { finding, .. } => finding.code,
            RunError::NoGnss { .. } => "no_gnss_samples",
            RunError::AllWithheld { .. } => "all_withheld",
            RunError::NoRest { .. } => "no_rest",
            RunError::NeedsGnss { .. } => "needs_gnss",
            RunError::NoOverlap { .. } => "no_overlap",
            RunError::StartOutside { .. } => "start_outside",
            RunError::WindowTooLong { .. } => "window_too_long",
        }
    }

    /// What the user can do about it.
    pub fn remedy(&self) -> String {
        match self {
            RunError::Log(e) => e.remedy(),
            RunError::Config(e) => e.remedy(),
            RunError::State(e) => e.remedy(),
            RunError::Navigator(CoreError::ImuBackward { .. }) => {
                "the IMU's clock jumped: cut the log there, or use the recorder's clock with `--time log`".into()
            }
            RunError::Navigator(CoreError::NotStarted { missing }) => remedy_of_no_start(missing).into(),
            RunError::Navigator(CoreError::Config { .. }) => "change it in the config file or with `--set`".into(),
            RunError::Navigator(CoreError::NotObservable { what, .. }) => match *what {
                "the IMU's clock offset" => "give it yourself: `--time-offset`, in seconds".into(),
                "the lag of GNSS velocity" => "give it yourself: `--set gnss.velocity_lag_s=…`".into(),
                _ => "give a longer recording".into(),
            },
            RunError::Navigator(CoreError::Capacity { .. }) => {
                "leave one of the optional states out: scale factors, lever arm, clock offset, colour of GNSS, or the wheels' constraint".into()
            }
            RunError::Navigator(CoreError::NotFinite { .. }) => "check the driver that gives it".into(),
            RunError::Navigator(CoreError::Alignment(refusal)) => refusal.parts().1,
            RunError::Noise(refusal) => super::noise::remedy(refusal).into(),
            RunError::PartOutside { .. } => "give `--from` and `--to` in seconds from the zero that `insnav info` prints".into(),
            RunError::NoLatitude => "give it: `--latitude-deg`, or output.origin in the settings".into(),
            RunError::NoStops { .. } => "give the windows yourself: `--stop 40:200`, in seconds from the zero that `insnav info` prints".into(),
            RunError::Navigator(_) => "check the sigmas in the log and in the config".into(),
            RunError::Unusable { finding, .. } => finding.remedy.clone(),
            RunError::Interrupted => "start it again; nothing half-written is left behind".into(),
            RunError::NoImu => "check with `insnav info` that the IMU topic has messages".into(),
            RunError::NoGnss { .. } => "check with `insnav info` what the receiver says about its fixes, or navigate without them, from rest: `--imu-only`".into(),
            RunError::NoRest { .. } => "let the recording begin with two seconds or more without any motion, four with the engine on".into(),
            RunError::NeedsGnss { option } => format!("leave out `{option}`, or `--imu-only` (`gnss.use = false`)"),
            RunError::AllWithheld { .. } => {
                "leave fixes outside the intervals of `--withhold`, which count in seconds from the begin of the log".into()
            }
            RunError::NoOverlap { .. } => {
                "the clocks differ: take the recorder's with `--time log`, or correct the stamps".into()
            }
            RunError::StartOutside { .. } => "give its time in seconds from the first inertial sample on, or leave it out".into(),
            RunError::WindowTooLong { .. } => "give a shorter one, a few seconds at most, or none".into(),
            RunError::ImuNotFinite { .. } => "check the driver: the navigator cannot run without inertial data".into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn remedies_fit_what_is_missing() {
        let remedy = |error: CoreError| RunError::Navigator(error).remedy();
        let no_start = |missing| remedy(CoreError::NotStarted { missing });
        assert!(
            no_start("the inertial data do not begin with a second of rest")
                .contains("without any motion")
        );
        assert!(no_start("no valid GNSS position").contains("--imu-only"));
        assert!(no_start("no inertial sample").contains("IMU topic"));
        let unknown = |what| {
            let reason = "";
            remedy(CoreError::NotObservable { what, reason })
        };
        assert!(unknown("the IMU's clock offset").contains("--time-offset"));
        assert!(unknown("the lag of GNSS velocity").contains("velocity_lag_s"));
        assert!(!unknown("the errors over the stops").contains("--time-offset"));
    }
}
