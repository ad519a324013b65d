//! A run put aside: everything that it carries, so that the next part of the drive goes on as if there were no cut.

use super::RunError;
use super::clocks::Clocks;
use super::plan::Plan;
use super::source::Source;
use super::tally::Totals;
use crate::output_file::OutputFile;
use crate::samples::ReaderState;
use crate::sink::SinkState;
use crate::transforms::Mounting;
use crate::{LogError, ReadOptions, config_text, parse_config};
use insnav_core::config::Config;
use insnav_core::imu::ImuGrade;
use insnav_core::navigator::Navigator;
use insnav_core::time::Time;
use insnav_core::wheeled::WheelReport;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::{Path, PathBuf};

/// First bytes of a file.
const MAGIC: &[u8; 16] = b"insnav run state";
/// Changes with every change of what follows.
const VERSION: u32 = 5;
/// Magic, version, program, settings, length.
const HEADER: usize = 16 + 4 + 4 + 4 + 8;

/// A run at the end of a log, to go on with the next: navigator, samples that still wait, counts, and where the output was.
///
/// The file is magic, version, a fingerprint of the program, a checksum of the settings, the length of the payload (all
/// little-endian), the payload in postcard's form, and a CRC-32 of it all.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SavedRun {
    /// The settings as they were given.
    pub(super) given: String,
    /// The settings as they were completed.
    pub(super) config: String,
    /// How the log was read.
    pub(super) reading: String,
    pub(super) withhold: String,
    /// Stamps of all fixes so far, where withholding counts them.
    pub(super) epochs: Vec<Time>,
    pub(super) origin: Time,
    pub(super) grade: ImuGrade,
    pub(super) grade_picked: bool,
    pub(super) clocks: Clocks,
    pub(super) wheels: Option<WheelReport>,
    /// The mounting that the first part's transforms gave.
    pub(super) mounting: Option<Mounting>,
    pub(super) reader: ReaderState,
    /// Where it was read from.
    #[serde(skip)]
    pub(super) path: PathBuf,
    pub(super) navigator: Navigator,
    pub(super) totals: Totals,
    pub(super) sink: Option<SinkState>,
}

/// Why a run cannot be resumed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StateError {
    /// Some other file.
    #[error("{}: not a saved run of insnav", path.display())]
    NotAState {
        /// The path as given.
        path: PathBuf,
    },
    /// Written by another program.
    #[error("{}: saved by another version of insnav ({found}; this one is {own})", path.display())]
    Version {
        /// The path as given.
        path: PathBuf,
        /// Form and program that wrote it.
        found: String,
        /// Form and program that read it.
        own: String,
    },
    /// Not what was written.
    #[error("{}: damaged: {reason}", path.display())]
    Damaged {
        /// The path as given.
        path: PathBuf,
        /// What shows it.
        reason: String,
    },
    /// Other settings.
    #[error("{}: saved by a run with other settings: {what} was {saved}, and now is {now}", path.display())]
    Settings {
        /// The path as given.
        path: PathBuf,
        /// Which setting.
        what: String,
        /// Its value then.
        saved: String,
        /// Its value now.
        now: String,
    },
}

impl StateError {
    /// A short name for programs.
    pub fn code(&self) -> &'static str {
        match self {
            StateError::NotAState { .. } => "not_a_state",
            StateError::Version { .. } => "state_version",
            StateError::Damaged { .. } => "state_damaged",
            StateError::Settings { .. } => "state_settings",
        }
    }

    /// What the user can do about it.
    pub fn remedy(&self) -> String {
        match self {
            StateError::NotAState { .. } => "give the file that `--save-state` wrote".into(),
            StateError::Version { .. } | StateError::Damaged { .. } => {
                "run the part before again with `--save-state`".into()
            }
            StateError::Settings { what, .. } if what == INTERVALS => {
                "give every part the intervals of the whole drive, in seconds from the zero of its first part".into()
            }
            StateError::Settings { .. } => {
                "give the same flags and config as to the part before".into()
            }
        }
    }
}

/// Intervals are the one setting that one would like to change from part to part.
const INTERVALS: &str = "stationary.intervals_s";

/// Tells programs apart whose navigators begin with other contents: their saved bytes do not mean the same.
fn fingerprint() -> u32 {
    let fresh = Navigator::new(&Config::default(), ImuGrade::Consumer.noise());
    let bytes = fresh
        .ok()
        .and_then(|n| postcard::to_stdvec(&n).ok())
        .unwrap_or_default();
    crc32fast::hash(&bytes) ^ crc32fast::hash(env!("CARGO_PKG_VERSION").as_bytes())
}

impl SavedRun {
    /// Write it; the file appears whole or not at all.
    pub fn write(&self, path: &Path, overwrite: bool) -> Result<(), RunError> {
        let failed = |source| LogError::OutputNotWritable {
            path: path.into(),
            source,
        };
        let payload =
            postcard::to_stdvec(self).map_err(|e| failed(std::io::Error::other(e.to_string())))?;
        let mut bytes = Vec::with_capacity(HEADER + payload.len() + 4);
        bytes.extend_from_slice(MAGIC);
        bytes.extend_from_slice(&VERSION.to_le_bytes());
        bytes.extend_from_slice(&fingerprint().to_le_bytes());
        bytes.extend_from_slice(&crc32fast::hash(self.given.as_bytes()).to_le_bytes());
        bytes.extend_from_slice(&(payload.len() as u64).to_le_bytes());
        bytes.extend_from_slice(&payload);
        bytes.extend_from_slice(&crc32fast::hash(&bytes).to_le_bytes());
        let mut file = OutputFile::create(path, overwrite)?;
        file.write_all(&bytes).map_err(failed)?;
        file.commit()?;
        Ok(())
    }

    /// Read what [`SavedRun::write`] wrote.
    pub fn read(path: &Path) -> Result<Self, RunError> {
        let bytes = std::fs::read(path).map_err(|e| LogError::opening(path, e))?;
        Ok(Self::from_bytes(&bytes, path)?)
    }

    fn from_bytes(bytes: &[u8], path: &Path) -> Result<Self, StateError> {
        let path = path.to_path_buf();
        if !bytes.starts_with(MAGIC) {
            return Err(StateError::NotAState { path });
        }
        let damaged = |reason: &str| StateError::Damaged {
            path: path.clone(),
            reason: reason.into(),
        };
        let number = |at: usize| {
            let four = bytes.get(at..at + 4)?;
            Some(u32::from_le_bytes(four.try_into().ok()?))
        };
        let cut = || damaged("it ends too early");
        let (version, program) = (number(16).ok_or_else(cut)?, number(20).ok_or_else(cut)?);
        let own = fingerprint();
        if (version, program) != (VERSION, own) {
            return Err(StateError::Version {
                path,
                found: format!("form {version}, program {program:08x}"),
                own: format!("form {VERSION}, program {own:08x}"),
            });
        }
        let settings = number(24).ok_or_else(cut)?;
        let length = bytes
            .get(28..HEADER)
            .and_then(|b| Some(u64::from_le_bytes(b.try_into().ok()?)))
            .ok_or_else(cut)?;
        let end = usize::try_from(length)
            .ok()
            .and_then(|l| l.checked_add(HEADER))
            .ok_or_else(cut)?;
        let payload = bytes.get(HEADER..end).ok_or_else(cut)?;
        let stored = number(end).ok_or_else(cut)?;
        if bytes.len() != end + 4 {
            return Err(damaged("there is more in it than was written"));
        }
        if stored != crc32fast::hash(&bytes[..end]) {
            return Err(damaged("its checksum does not match"));
        }
        let mut run: SavedRun =
            postcard::from_bytes(payload).map_err(|e| damaged(&format!("{e}")))?;
        if settings != crc32fast::hash(run.given.as_bytes()) {
            return Err(damaged("its settings are not those of its header"));
        }
        run.path = path;
        Ok(run)
    }

    /// How to read the next part: as the user says, and with the mounting that the first part's transforms gave, which its
    /// recorder need not repeat.
    #[must_use]
    pub fn read_options(&self, mut options: ReadOptions) -> ReadOptions {
        if options.imu_mounting_rpy_deg.is_none() {
            options.imu_mounting_rpy_deg = self.mounting.as_ref().map(|m| m.rpy_deg);
        }
        options
    }

    /// Refuse to go on with other settings than the run began with.
    pub(super) fn check(
        &self,
        config: &Config,
        source: &(impl Source + ?Sized),
        withhold: &str,
    ) -> Result<(), StateError> {
        let differs = |what: &str, saved: &str, now: &str| StateError::Settings {
            path: self.path.clone(),
            what: what.into(),
            saved: saved.into(),
            now: now.into(),
        };
        let now = config_text(config);
        // The settings as completed are the same settings stated in full.
        if now != self.given && now != self.config {
            let (what, saved, now) = first_difference(&self.given, &now);
            return Err(differs(&what, &saved, &now));
        }
        let reading = source.reading();
        if reading != self.reading {
            return Err(differs("the reading of the log", &self.reading, &reading));
        }
        if withhold != self.withhold {
            let shown = |w: &str| {
                if w.is_empty() {
                    "nothing".to_owned()
                } else {
                    w.to_owned()
                }
            };
            return Err(differs(
                "--withhold",
                &shown(&self.withhold),
                &shown(withhold),
            ));
        }
        Ok(())
    }

    /// The settings as they were completed.
    pub(super) fn complete_config(&self) -> Result<Config, RunError> {
        let origin = self.path.display().to_string();
        Ok(parse_config(&self.config, &origin, &[])?)
    }
}

impl Plan {
    /// The plan of the next part of a drive: everything that the first part chose from its data stays as it was.
    ///
    /// # Errors
    /// Other settings than those of the first part; no inertial data.
    pub fn resume(
        source: &(impl Source + ?Sized),
        config: &Config,
        options: &super::RunOptions,
        saved: &SavedRun,
    ) -> Result<Self, RunError> {
        saved.check(config, source, &options.withhold.to_string())?;
        Plan::go_on(source, saved, options)
    }
}

/// The first key with another value, by its section, and both values.
fn first_difference(saved: &str, now: &str) -> (String, String, String) {
    let keys = |text: &str| -> std::collections::BTreeMap<String, String> {
        let mut section = String::new();
        let mut keys = std::collections::BTreeMap::new();
        for line in text.lines() {
            if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
                section = format!("{name}.");
            } else if let Some((key, value)) = line.split_once(" = ") {
                keys.insert(format!("{section}{key}"), value.to_owned());
            }
        }
        keys
    };
    let (saved, now) = (keys(saved), keys(now));
    let value = |of: &std::collections::BTreeMap<String, String>, key: &str| {
        of.get(key).cloned().unwrap_or_else(|| "not set".into())
    };
    let differing = saved
        .keys()
        .chain(now.keys())
        .find(|key| saved.get(*key) != now.get(*key));
    match differing {
        Some(key) => (key.clone(), value(&saved, key), value(&now, key)),
        None => ("the config".into(), "other".into(), "another".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_differing_key_is_named() {
        let mut other = Config::default();
        other.gnss.sigma_scale = insnav_core::config::SigmaScale::Fixed(2.0);
        assert_eq!(
            first_difference(&config_text(&Config::default()), &config_text(&other)),
            ("gnss.sigma_scale".into(), "\"auto\"".into(), "2.0".into())
        );
    }

    #[test]
    fn garbage_is_refused_and_every_cut() {
        let path = Path::new("x.state");
        let code = |bytes: &[u8]| SavedRun::from_bytes(bytes, path).unwrap_err().code();
        assert_eq!(code(b""), "not_a_state");
        assert_eq!(code(b"Dear diary, today I"), "not_a_state");
        let mut header = MAGIC.to_vec();
        header.extend_from_slice(&VERSION.to_le_bytes());
        header.extend_from_slice(&fingerprint().to_le_bytes());
        header.extend_from_slice(&[0; 4]);
        header.extend_from_slice(&u64::MAX.to_le_bytes());
        for length in MAGIC.len()..=header.len() {
            assert_eq!(code(&header[..length]), "state_damaged", "{length}");
        }
        header[16] += 1;
        assert_eq!(code(&header), "state_version");
    }
}
