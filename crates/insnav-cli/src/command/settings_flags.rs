//! Flags for the settings: a file, single keys, and the few that deserve a flag of their own.

use crate::failure::Failure;
use clap::Args;
use insnav_core::config::Config;
use insnav_log::load_config;
use std::path::PathBuf;

#[derive(Args, Clone, Debug)]
pub(super) struct SettingsFlags {
    /// Settings, TOML
    #[arg(short, long, value_name = "FILE")]
    config: Option<PathBuf>,

    /// One setting over those of the file, such as gnss.sigma_scale=2 (repeatable)
    #[arg(long, value_name = "KEY=VALUE", allow_hyphen_values = true)]
    set: Vec<String>,
}

impl SettingsFlags {
    pub(super) fn load(&self) -> Result<Config, Failure> {
        Ok(load_config(self.config.as_deref(), &self.set)?)
    }
}
