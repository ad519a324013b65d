//! `insnav convert`: between the common CSV, logs and trajectories.

use super::log_flags::{Axes, LogFlags};
use super::run_inputs::not_the_input;
use crate::failure::Failure;
use crate::output::Output;
use crate::progress::Progress;
use clap::Args;
use insnav_core::config::Config;
use insnav_core::time::Time;
use insnav_log::convert::{
    ConvertOptions, CsvInputs, DEFAULT_T0, csv_to_mcap, is_solution, mcap_to_csv,
};
use insnav_log::{
    ExportFormat, ImuAxes, Log, LogSettings, LogWriterOptions, OrientationTable, Warning,
    check_output, export, is_standard_stream,
};
use nalgebra::Vector3;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Convert: common CSV to a log, a log to common CSV, a solution to CSV, TUM, KML or GeoJSON
///
/// What is meant follows from the input and the ending of the output: a folder with imu.csv (and gnss.csv), or an imu.csv
/// itself, becomes a log OUT.mcap; a log becomes a folder OUT with imu.csv.gz and gnss.csv.gz; a solution becomes OUT.csv or
/// OUT.tum with every epoch, or OUT.kml or OUT.geojson with five points a second; an orientation of `ahrs` becomes OUT.csv with its
/// quaternions. A magnetometer's columns mx,my,mz are microtesla. Heights are above the ellipsoid; KML, whose
/// heights would be above the sea, is laid on the ground.
#[derive(Args, Debug)]
pub(crate) struct Convert {
    /// A folder of common CSV, an imu.csv, a log, or a solution
    input: PathBuf,

    /// Where to write
    #[arg(short, long, value_name = "OUT")]
    output: PathBuf,

    /// Fixes, instead of a gnss.csv beside the imu.csv: another gnss.csv, RTKLIB's FILE.pos (any of its times and positions, GPS
    /// time becomes UTC), or NMEA sentences
    #[arg(long, value_name = "FILE")]
    gnss: Option<PathBuf>,

    /// Axes of the CSV's inertial data
    #[arg(long, value_enum, default_value = "frd", value_name = "AXES")]
    axes: Axes,

    /// Unix time (UTC) of t_s = 0 in the CSV, s; 0 when its times are Unix times already [default: 1600000000]
    #[arg(long, value_name = "UNIX_S", value_parser = unix_time, allow_hyphen_values = true)]
    t0: Option<f64>,

    /// Antenna from the IMU, forward,right,down in metres, to be written into the log as a static transform
    #[arg(long, value_name = "F,R,D", value_parser = vector, allow_hyphen_values = true)]
    lever_arm_b_m: Option<Metres>,

    /// Overwrite the output
    #[arg(long)]
    force: bool,

    #[command(flatten)]
    reading: LogFlags,
}

/// Stamps of ROS messages count seconds since 1970 in 32 bits with a sign; a recording needs room behind its zero.
fn unix_time(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if (0.0..=2.0e9).contains(&s) => Ok(s),
        _ => Err("seconds since 1970 are needed, between 0 and 2000000000".into()),
    }
}

/// Three lengths.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Metres(Vector3<f64>);

fn vector(text: &str) -> Result<Metres, String> {
    let numbers: Vec<f64> = text
        .split(',')
        .filter_map(|x| x.trim().parse().ok())
        .filter(|x: &f64| x.is_finite())
        .collect();
    match numbers[..] {
        [x, y, z] if text.split(',').count() == 3 => Ok(Metres(Vector3::new(x, y, z))),
        _ => Err("three numbers are needed, such as 0.3,-0.4,-1.2".into()),
    }
}

/// What was converted.
#[derive(Debug, Default, Serialize)]
struct Converted {
    input: PathBuf,
    outputs: Vec<PathBuf>,
    imu_samples: Option<u64>,
    gnss_positions: Option<u64>,
    gnss_velocities: Option<u64>,
    magnetic_fields: Option<u64>,
    epochs: Option<usize>,
    ignored: Vec<String>,
    gnss_quality: BTreeMap<&'static str, u64>,
    warnings: Vec<Warning>,
}

impl Convert {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        if is_standard_stream(&self.output) {
            return Err(Failure::usage(
                "-o -: what is written follows from the ending of the output's name, and standard output has none",
                "name a file, or a folder for the CSV of a log",
            ));
        }
        not_the_input(&self.input, &self.output)?;
        if !ending(&self.output).is_empty() {
            check_output(&self.output, self.force)?;
        }
        let converted = {
            let _progress = Progress::new(&format!("converting {}", self.input.display()), None);
            self.convert()?
        };
        output.warnings(&converted.warnings);
        output.result(&converted, || summary(&converted));
        Ok(0)
    }

    fn convert(&self) -> Result<Converted, Failure> {
        let ending = ending(&self.output);
        if self.input.is_dir() || matches!(self::ending(&self.input).as_str(), "csv") {
            if ending != "mcap" {
                return Err(Failure::usage(
                    format!("{}: CSV is converted to a log only", self.output.display()),
                    "give the output the ending .mcap",
                ));
            }
            return self.to_log();
        }
        let mut converted = Converted {
            input: self.input.clone(),
            ..Converted::default()
        };
        let log = Log::open(
            &self.input,
            self.reading
                .options(&Config::default(), LogSettings::default()),
        )?;
        converted.warnings.extend(log.recovery_warning());
        if is_solution(&log) {
            let Some(format) = ExportFormat::from_name(&ending) else {
                return Err(Failure::usage(
                    format!(
                        "{}: a solution is converted to CSV, TUM, KML or GeoJSON",
                        self.output.display()
                    ),
                    "give the output the ending .csv, .csv.gz, .tum, .kml or .geojson",
                ));
            };
            converted.epochs = Some(export(&log, &self.output, format, self.force)?);
            converted.outputs.push(self.output.clone());
            return Ok(converted);
        }
        if OrientationTable::is_in(&log) {
            if ending != "csv" {
                return Err(Failure::usage(
                    format!(
                        "{}: an orientation is converted to CSV",
                        self.output.display()
                    ),
                    "give the output the ending .csv or .csv.gz",
                ));
            }
            let table = OrientationTable::from_mcap(&log)?;
            table.write_csv(&self.output, self.force)?;
            converted.epochs = Some(table.time.len());
            converted.outputs.push(self.output.clone());
            return Ok(converted);
        }
        log.require(insnav_log::Role::Imu)?;
        if !ending.is_empty() {
            return Err(Failure::usage(
                format!(
                    "{}: a log is converted to a folder of CSV",
                    self.output.display()
                ),
                "give the name of a folder, without an ending (the input is a recording, not a solution of `run`)",
            ));
        }
        let summary = mcap_to_csv(&log, &self.output, self.force)?;
        converted.outputs = summary.outputs;
        converted.imu_samples = Some(summary.imu);
        converted.gnss_positions = Some(summary.gnss_position);
        converted.gnss_velocities = Some(summary.gnss_velocity);
        converted.magnetic_fields = Some(summary.magnetic);
        converted.ignored = summary.ignored;
        Ok(converted)
    }

    fn to_log(&self) -> Result<Converted, Failure> {
        let mut inputs = if self.input.is_dir() {
            CsvInputs::in_folder(&self.input)?
        } else {
            CsvInputs {
                imu: self.input.clone(),
                gnss: None,
            }
        };
        if self.gnss.is_some() {
            inputs.gnss.clone_from(&self.gnss);
        }
        let options = ConvertOptions {
            t0: self.t0.map_or(DEFAULT_T0, Time::from_seconds),
            near: self.t0.map(Time::from_seconds),
            geoid_height_m: self
                .reading
                .options(&Config::default(), LogSettings::default())
                .geoid_height_m,
            axes: match self.axes {
                Axes::Frd => ImuAxes::Frd,
                Axes::Flu => ImuAxes::Flu,
            },
            writer: LogWriterOptions {
                force: self.force,
                lever_arm_b: self.lever_arm_b_m.map(|m| m.0),
                ..LogWriterOptions::default()
            },
        };
        let summary = csv_to_mcap(&inputs, &self.output, &options)?;
        Ok(Converted {
            input: self.input.clone(),
            outputs: summary.outputs,
            imu_samples: Some(summary.imu),
            gnss_positions: Some(summary.gnss_position),
            gnss_velocities: Some(summary.gnss_velocity),
            magnetic_fields: Some(summary.magnetic),
            epochs: None,
            ignored: summary.ignored,
            gnss_quality: summary.quality,
            warnings: summary.warnings,
        })
    }
}

/// The ending that tells the kind of a file, that of the packed file if it is gzip.
fn ending(path: &Path) -> String {
    let lower = path
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase();
    if lower == "gz" {
        ending(&path.with_extension(""))
    } else {
        lower
    }
}

fn summary(c: &Converted) -> String {
    let outputs: Vec<String> = c.outputs.iter().map(|p| p.display().to_string()).collect();
    let mut text = format!("{} → {}\n", c.input.display(), outputs.join(", "));
    if let (Some(imu), Some(p), Some(v)) = (c.imu_samples, c.gnss_positions, c.gnss_velocities) {
        text.push_str(&format!(
            "  {imu} inertial samples, {p} positions, {v} velocities{}\n",
            match c.magnetic_fields {
                Some(n) if n > 0 => format!(", {n} magnetic fields"),
                _ => String::new(),
            }
        ));
    }
    if !c.gnss_quality.is_empty() {
        let kinds = c.gnss_quality.iter().map(|(kind, n)| format!("{n} {kind}"));
        text.push_str(&format!(
            "  fixes: {}\n",
            kinds.collect::<Vec<_>>().join(", ")
        ));
    }
    if let Some(epochs) = c.epochs {
        text.push_str(&format!("  {epochs} epochs\n"));
    }
    if !c.ignored.is_empty() {
        text.push_str(&format!("  not converted: {}\n", c.ignored.join(", ")));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endings() {
        assert_eq!(ending(Path::new("a/imu.csv.gz")), "csv");
        assert_eq!(ending(Path::new("a/x.insnav.MCAP")), "mcap");
        assert_eq!(ending(Path::new("a/folder")), "");
    }

    #[test]
    fn instants() {
        assert_eq!(unix_time("1600000000.5"), Ok(1_600_000_000.5));
        for wrong in ["nan", "inf", "1e30", "-1", "soon"] {
            assert!(unix_time(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn vectors() {
        assert_eq!(
            vector("0.3,-0.4,-1.2"),
            Ok(Metres(Vector3::new(0.3, -0.4, -1.2)))
        );
        for wrong in ["1,2", "1,2,x", "1,2,3,4", "1,2,nan"] {
            assert!(vector(wrong).is_err(), "{wrong}");
        }
    }
}
