//! Positions and velocities of a receiver, from the text files that receivers and their software write.

mod nmea;
mod rtklib;

use crate::csv::{self, open_text};
use crate::error::LogError;
use crate::run::Warning;
use insnav_core::sample::{GnssPosition, GnssVelocity};
use insnav_core::time::Time;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

/// Kinds of files with the fixes of a receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GnssFormat {
    /// `gnss.csv`: seconds from a zero that something else has to tell.
    Csv,
    /// RTKLIB's solutions (`.pos`): dated.
    RtklibPos,
    /// NMEA 0183 sentences: the time of day, and the date where there is an RMC or ZDA.
    Nmea,
}

impl GnssFormat {
    /// By the first bytes, and where these leave it open by the ending of the name.
    pub fn of(path: &Path) -> Result<Self, LogError> {
        let mut start = Vec::new();
        open_text(path)?
            .take(4096)
            .read_to_end(&mut start)
            .map_err(|e| LogError::opening(path, e))?;
        let ending = |known: &[&str]| {
            let name = path.to_string_lossy().to_lowercase();
            let name = name.strip_suffix(".gz").unwrap_or(&name);
            known.iter().any(|end| name.ends_with(end))
        };
        Ok(match start.trim_ascii_start().first() {
            Some(b'%') => GnssFormat::RtklibPos,
            Some(b'$') => GnssFormat::Nmea,
            _ if ending(&[".pos"]) => GnssFormat::RtklibPos,
            _ if ending(&[".nmea", ".nma", ".ubx"]) => GnssFormat::Nmea,
            _ => GnssFormat::Csv,
        })
    }
}

/// How to read a file of fixes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GnssFileOptions {
    /// Where the seconds of a CSV count from.
    pub t0: Time,
    /// Height of the geoid above the ellipsoid, m: added to heights above sea level for which the file does not say it.
    pub geoid_height_m: f64,
    /// An instant near the recording, for sentences without a date: the day is chosen so that the first is nearest to it.
    pub near: Option<Time>,
}

/// What a receiver measured, on UTC.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GnssTrack {
    /// Positions of the antenna, ellipsoidal heights.
    pub positions: Vec<GnssPosition>,
    /// Velocities; Down is NaN where it is not measured.
    pub velocities: Vec<GnssVelocity>,
    /// Positions by the kind of fix, as the file names it.
    pub quality: BTreeMap<&'static str, u64>,
    /// Columns that have no place in samples.
    pub ignored: Vec<&'static str>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

impl GnssTrack {
    /// Read a common `gnss.csv`, an RTKLIB `.pos` or NMEA sentences, gzip or not.
    pub fn read(path: &Path, options: &GnssFileOptions) -> Result<Self, LogError> {
        match GnssFormat::of(path)? {
            GnssFormat::Csv => from_csv(path, options.t0),
            GnssFormat::RtklibPos => rtklib::read(path, options),
            GnssFormat::Nmea => nmea::read(path, options),
        }
    }

    fn warn(&mut self, code: &'static str, message: String, remedy: &str) {
        self.warnings.push(Warning {
            code,
            message,
            remedy: remedy.into(),
        });
    }

    /// Heights above sea level were taken as they are.
    fn warn_sea_level(&mut self, path: &Path) {
        self.warn(
            "height_above_sea_level",
            format!(
                "{}: heights are above sea level and the file does not say where the geoid is; they are taken as ellipsoidal",
                path.display()
            ),
            "give the height N of the geoid above the ellipsoid with `--altitude msl=N`",
        );
    }
}

fn from_csv(path: &Path, t0: Time) -> Result<GnssTrack, LogError> {
    let table = csv::read_gnss(path)?;
    let rows = 0..table.t_s.len();
    // A receiver's own code of the kind of fix: no message has the same codes for all receivers.
    let coded = table.fix.iter().any(|code| !code.is_nan());
    Ok(GnssTrack {
        ignored: if coded { vec!["fix"] } else { Vec::new() },
        positions: rows
            .clone()
            .filter_map(|row| table.position_sample(row, t0))
            .collect(),
        velocities: rows
            .filter_map(|row| table.velocity_sample(row, t0))
            .collect(),
        ..GnssTrack::default()
    })
}
