//! Flags for the settings: a file, single keys, and the few that deserve a flag of their own.

use crate::failure::Failure;
use clap::Args;
use insnav_core::config::{Config, NoiseConfig};
use insnav_core::error::Error as CoreError;
use insnav_log::{ConfigError, LogSettings, RunError, load_config};
use std::path::{Path, PathBuf};

#[derive(Args, Clone, Debug)]
pub(super) struct SettingsFlags {
    /// Settings, TOML; with [[map]] for messages of types of your own (which field is which quantity) and
    /// stationary.topic for one that declares standing
    #[arg(short, long, value_name = "FILE")]
    config: Option<PathBuf>,

    /// One setting over those of the file, such as gnss.sigma_scale=2 (repeatable)
    #[arg(long, value_name = "KEY=VALUE", allow_hyphen_values = true)]
    set: Vec<String>,
}

/// A flag of a verb that stands for a setting.
pub(super) struct SetBy {
    /// As it was typed.
    pub(super) flag: String,
    /// The key of the setting.
    pub(super) key: &'static str,
}

impl SettingsFlags {
    /// The settings of file and `--set`, checked.
    pub(super) fn load(&self) -> Result<Config, Failure> {
        self.load_over(|_| Vec::new())
    }

    /// The noise of a file of its own, with `--set` over it.
    pub(super) fn noise_of(&self, path: &Path) -> Result<NoiseConfig, Failure> {
        Ok(load_config(Some(path), &self.set).map_err(blame)?.noise)
    }

    /// What the settings say to the reader of logs.
    pub(super) fn for_reading(&self) -> Result<LogSettings, Failure> {
        LogSettings::load(self.config.as_deref(), &self.set).map_err(blame)
    }

    /// As [`SettingsFlags::load`], with what a verb's own flags set on top: `apply` sets it, and says by which flag.
    pub(super) fn load_over(
        &self,
        apply: impl FnOnce(&mut Config) -> Vec<SetBy>,
    ) -> Result<Config, Failure> {
        let mut config = load_config(self.config.as_deref(), &self.set).map_err(blame)?;
        let set_by = apply(&mut config);
        match config.validate() {
            Ok(()) => Ok(config),
            Err(error) => Err(self.out_of_range(error, &set_by)),
        }
    }

    /// Where a setting of a key comes from, if it is not the default.
    pub(super) fn source_of(&self, key: &str) -> String {
        match (self.assigned(key), &self.config) {
            (Some(_), _) => format!("--set {key}"),
            (None, Some(path)) => format!("{key} in {}", path.display()),
            (None, None) => key.to_owned(),
        }
    }

    /// The last `--set` of a key.
    fn assigned(&self, key: &str) -> Option<&String> {
        let assigns = |text: &&String| {
            let name = text.split_once('=').map(|(name, _)| name.trim());
            name == Some(key)
        };
        self.set.iter().rfind(assigns)
    }

    /// A number out of its range, with the flag or the file that set it.
    fn out_of_range(&self, error: CoreError, set_by: &[SetBy]) -> Failure {
        let CoreError::Config {
            key,
            value,
            expected,
        } = error
        else {
            return RunError::from(error).into();
        };
        let failure =
            |message: String, remedy: &str| Failure::new("bad_config_value", message, remedy);
        if let Some(by) = set_by.iter().find(|by| by.key == key) {
            // Of a list it is one number that is wrong.
            let what = match key {
                "stationary.intervals_s" => format!("{value} s"),
                _ => key.to_owned(),
            };
            return failure(
                format!("{}: {what} must be {expected}", by.flag),
                "give the flag another value",
            )
            .into_usage();
        }
        if let Some(text) = self.assigned(key) {
            return failure(
                format!("--set {text}: must be {expected}"),
                "give the key another value",
            )
            .into_usage();
        }
        match &self.config {
            Some(path) => failure(
                format!("{}: {key} = {value}: must be {expected}", path.display()),
                "change it in the config file",
            ),
            None => RunError::from(error).into(),
        }
    }
}

/// What is wrong with a flag is wrong usage; what is wrong with a file is a failure.
fn blame(error: ConfigError) -> Failure {
    let by_flag = match &error {
        ConfigError::NotAnAssignment { .. } => true,
        ConfigError::Syntax { origin, .. }
        | ConfigError::UnknownKey { origin, .. }
        | ConfigError::Value { origin, .. } => origin.starts_with("--set"),
        _ => false,
    };
    let failure = Failure::from(error);
    if by_flag {
        failure.into_usage()
    } else {
        failure
    }
}
