//! Between the common CSV, ROS 2 logs, and TUM trajectories.

use crate::calendar::rfc3339;
use crate::csv::{self, GnssTable, ImuTable};
use crate::error::LogError;
use crate::frames::FLU_FRD;
use crate::gnss_file::{GnssFileOptions, GnssTrack};
use crate::log::{ImuAxes, Log};
use crate::log_writer::{LogWriter, LogWriterOptions};
use crate::run::Warning;
use crate::solution::SolutionTable;
use crate::topics::Role;
use crate::tum::Trajectory;
use insnav_core::alignment::EARTH_FIELD;
use insnav_core::earth::Geodetic;
use insnav_core::sample::{ImuSample, MagneticField, Sample};
use insnav_core::time::Time;
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Where `t_s` = 0 is put unless told otherwise: 2020-09-13 12:26:40 UTC, a round number that every tool takes for a date.
pub const DEFAULT_T0: Time = Time(1_600_000_000_000_000_000);

/// The tables of one recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CsvInputs {
    /// Inertial data.
    pub imu: PathBuf,
    /// GNSS, if there is any: a common CSV, an RTKLIB `.pos` or NMEA sentences.
    pub gnss: Option<PathBuf>,
}

impl CsvInputs {
    /// The tables in a folder, by their usual names: `imu.csv[.gz]` and, if it is there, `gnss.csv[.gz]`.
    pub fn in_folder(folder: &Path) -> Result<Self, LogError> {
        let find = |name: &str| {
            ["csv.gz", "csv"]
                .map(|end| folder.join(format!("{name}.{end}")))
                .into_iter()
                .find(|p| p.is_file())
        };
        let imu = find("imu").ok_or_else(|| LogError::NoSuchFile {
            path: folder.join("imu.csv"),
        })?;
        Ok(CsvInputs {
            imu,
            gnss: find("gnss"),
        })
    }
}

/// How to turn tables into a log.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvertOptions {
    /// Where `t_s` = 0 is on the log's clock.
    pub t0: Time,
    /// Axes of the inertial table. The log is written forward-left-up either way.
    pub axes: ImuAxes,
    /// Height of the geoid above the ellipsoid, m: for GNSS files with heights above sea level that do not tell it.
    pub geoid_height_m: f64,
    /// An instant near the recording, for GNSS files that do not tell the date.
    pub near: Option<Time>,
    /// How to write the log; its `t0` is set from here.
    pub writer: LogWriterOptions,
}

impl Default for ConvertOptions {
    fn default() -> Self {
        ConvertOptions {
            t0: DEFAULT_T0,
            axes: ImuAxes::Frd,
            geoid_height_m: 0.0,
            near: None,
            writer: LogWriterOptions::default(),
        }
    }
}

/// What was converted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ConvertSummary {
    /// Inertial samples.
    pub imu: u64,
    /// GNSS positions.
    pub gnss_position: u64,
    /// GNSS velocities.
    pub gnss_velocity: u64,
    /// Magnetic fields.
    pub magnetic: u64,
    /// Files written.
    pub outputs: Vec<PathBuf>,
    /// Columns or topics that have no place in the output.
    pub ignored: Vec<String>,
    /// Positions by the kind of fix, where the GNSS file names it.
    pub quality: BTreeMap<&'static str, u64>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

/// Tables to a ROS 2 log, in order of time.
pub fn csv_to_mcap(
    inputs: &CsvInputs,
    output: &Path,
    options: &ConvertOptions,
) -> Result<ConvertSummary, LogError> {
    let imu = csv::read_imu(&inputs.imu)?;
    let reading = GnssFileOptions {
        t0: options.t0,
        geoid_height_m: options.geoid_height_m,
        near: options.near,
    };
    let gnss = inputs.gnss.as_deref();
    let gnss = gnss
        .map(|path| GnssTrack::read(path, &reading))
        .transpose()?;
    let to_frd = match options.axes {
        ImuAxes::Frd => Matrix3::identity(),
        ImuAxes::Flu => FLU_FRD,
    };
    // Fields first: whoever reads the log has that of an instant when its inertial sample comes.
    let mut samples: Vec<Sample> = imu
        .magnetic_fields(options.t0)
        .map(|s| MagneticField {
            field_b: to_frd * s.field_b,
            ..s
        })
        .map(Sample::Magnetic)
        .collect();
    let mut summary = ConvertSummary {
        imu: imu.t_s.len() as u64,
        magnetic: samples.len() as u64,
        outputs: vec![output.into()],
        ..Default::default()
    };
    summary.warnings.extend(no_microtesla(&samples, inputs));
    let inertial = imu.samples(options.t0).map(|s| ImuSample {
        angular_rate_b: to_frd * s.angular_rate_b,
        specific_force_b: to_frd * s.specific_force_b,
        ..s
    });
    samples.extend(inertial.map(Sample::Imu));
    if !imu.moving.is_empty() {
        summary.ignored.push("moving".into());
    }
    if let Some(gnss) = gnss {
        summary.gnss_position = gnss.positions.len() as u64;
        summary.gnss_velocity = gnss.velocities.len() as u64;
        let columns = gnss.ignored.iter().map(|c| (*c).to_owned());
        summary.ignored.extend(columns);
        summary.quality.clone_from(&gnss.quality);
        summary.warnings.extend_from_slice(&gnss.warnings);
        summary.warnings.extend(apart(&samples, &gnss, inputs));
        samples.extend(gnss.positions.into_iter().map(Sample::GnssPosition));
        samples.extend(gnss.velocities.into_iter().map(Sample::GnssVelocity));
    }
    // Stable: a position stays before the velocity of the same instant.
    samples.sort_by_key(Sample::time);
    let mut writer = LogWriter::create(
        output,
        LogWriterOptions {
            t0: Some(options.t0),
            ..options.writer.clone()
        },
    )?;
    for sample in &samples {
        writer.write(sample)?;
    }
    writer.finish()?;
    Ok(summary)
}

/// A magnetometer that is not one in microtesla: its direction may be right all the same.
fn no_microtesla(fields: &[Sample], inputs: &CsvInputs) -> Option<Warning> {
    let lengths = fields.iter().filter_map(|sample| match sample {
        Sample::Magnetic(field) => Some(field.field_b.norm() / csv::MICROTESLA),
        _ => None,
    });
    let mean = lengths.sum::<f64>() / fields.len() as f64;
    let earth = EARTH_FIELD.map(|t| t / csv::MICROTESLA);
    let normalised = (0.5..2.0).contains(&mean);
    (!fields.is_empty() && !(earth[0]..=earth[1]).contains(&mean)).then(|| Warning {
        code: "magnetic_units",
        message: format!(
            "{}: mx,my,mz are {mean:.3} long in the mean, not between {:.0} and {:.0} as the Earth's field in microtesla{}: they are \
             written as if they were microtesla",
            inputs.imu.display(),
            earth[0],
            earth[1],
            if normalised { "; they look normalised to 1" } else { "" }
        ),
        remedy: "nothing has to be done for `insnav ahrs`, which uses the direction of the field alone; `run` takes no heading from such a field: \
                 multiply the columns by what makes them microtesla"
            .into(),
    })
}

/// Inertial data and fixes that have no time in common: dated fixes call for the date of the inertial data.
fn apart(imu: &[Sample], gnss: &GnssTrack, inputs: &CsvInputs) -> Option<Warning> {
    let range = |times: &mut dyn Iterator<Item = Time>| {
        times.fold(None, |range: Option<(Time, Time)>, t| {
            Some(range.map_or((t, t), |(a, b)| (a.min(t), b.max(t))))
        })
    };
    let (imu_begin, imu_end) = range(&mut imu.iter().map(Sample::time))?;
    let (gnss_begin, gnss_end) = range(&mut gnss.positions.iter().map(|p| p.time))?;
    (gnss_end < imu_begin || imu_end < gnss_begin).then(|| Warning {
        code: "no_overlap",
        message: format!(
            "{} lasts from {} to {}, {} from {} to {}: they have no time in common",
            inputs.imu.display(),
            rfc3339(imu_begin),
            rfc3339(imu_end),
            inputs.gnss.as_deref().unwrap_or(Path::new("")).display(),
            rfc3339(gnss_begin),
            rfc3339(gnss_end)
        ),
        remedy: "say with `--t0` which Unix time (UTC) the zero of the inertial table is; `--t0 0` if its times are Unix times already".into(),
    })
}

/// A ROS 2 log to `imu.csv.gz` and, if it has GNSS, `gnss.csv.gz` in a folder; forward-right-down, `t_s` from the log's zero.
pub fn mcap_to_csv(log: &Log, folder: &Path, force: bool) -> Result<ConvertSummary, LogError> {
    let t0 = log.t0()?.unwrap_or_default();
    let mut imu = ImuTable::default();
    let mut gnss = GnssTable::default();
    let mut fields = Vec::new();
    let mut summary = ConvertSummary::default();
    for sample in log.samples()? {
        match sample? {
            Sample::Imu(sample) => {
                imu.t_s.push(sample.time.since(t0));
                imu.angular_rate.push(sample.angular_rate_b);
                imu.specific_force.push(sample.specific_force_b);
                summary.imu += 1;
            }
            Sample::GnssPosition(sample) => {
                let row = gnss_row(&mut gnss, sample.time.since(t0));
                gnss.position[row] = sample.position;
                gnss.position_sigma_n[row] = sigma(sample.covariance_n.as_ref());
                summary.gnss_position += 1;
            }
            Sample::GnssVelocity(sample) => {
                let row = gnss_row(&mut gnss, sample.time.since(t0));
                gnss.velocity_n[row] = sample.velocity_n;
                gnss.velocity_sigma_n[row] = sigma(sample.covariance_n.as_ref());
                summary.gnss_velocity += 1;
            }
            Sample::Magnetic(sample) => {
                fields.push((sample.time.since(t0), sample.field_b));
                summary.magnetic += 1;
            }
            _ => {}
        }
    }
    imu.magnetic_field = field_rows(&imu.t_s, &fields);
    std::fs::create_dir_all(folder).map_err(|source| LogError::OutputNotWritable {
        path: folder.into(),
        source,
    })?;
    let path = folder.join("imu.csv.gz");
    csv::write_imu(&path, &imu, force)?;
    summary.outputs.push(path);
    if !gnss.t_s.is_empty() {
        let path = folder.join("gnss.csv.gz");
        csv::write_gnss(&path, &gnss, force)?;
        summary.outputs.push(path);
    }
    // The tables have no column for who stands.
    let selected: Vec<usize> = Role::ALL
        .iter()
        .filter(|role| **role != Role::Standing)
        .filter_map(|role| log.selected().topic(*role))
        .collect();
    let others = log
        .topics()
        .iter()
        .enumerate()
        .filter(|(index, _)| !selected.contains(index));
    summary.ignored = others.map(|(_, topic)| topic.name.clone()).collect();
    Ok(summary)
}

/// Magnetic fields (seconds and tesla) in the rows of the inertial samples nearest to them, in microtesla; NaN where there is none.
fn field_rows(t_s: &[f64], fields: &[(f64, Vector3<f64>)]) -> Vec<Vector3<f64>> {
    if fields.is_empty() || t_s.is_empty() {
        return Vec::new();
    }
    let mut rows = vec![Vector3::repeat(f64::NAN); t_s.len()];
    let mut distance = vec![f64::INFINITY; t_s.len()];
    for (t, field) in fields {
        let after = t_s.partition_point(|row| row < t).min(t_s.len() - 1);
        let before = after.saturating_sub(1);
        let off = |row: usize| (t_s[row] - t).abs();
        let row = if off(before) < off(after) {
            before
        } else {
            after
        };
        // Of two fields at one sample the nearer one.
        if off(row) < distance[row] {
            distance[row] = off(row);
            rows[row] = field / csv::MICROTESLA;
        }
    }
    rows
}

/// The row of an instant: the last one if it has this time, else a new one where nothing is known.
fn gnss_row(table: &mut GnssTable, t_s: f64) -> usize {
    if table.t_s.last() != Some(&t_s) {
        let unknown = Vector3::repeat(f64::NAN);
        table.t_s.push(t_s);
        table.position.push(Geodetic {
            latitude: f64::NAN,
            longitude: f64::NAN,
            height: f64::NAN,
        });
        table.velocity_n.push(unknown);
        table.position_sigma_n.push(unknown);
        table.velocity_sigma_n.push(unknown);
        table.fix.push(f64::NAN);
    }
    table.t_s.len() - 1
}

fn sigma(covariance: Option<&Matrix3<f64>>) -> Vector3<f64> {
    covariance.map_or_else(
        || Vector3::repeat(f64::NAN),
        |p| p.diagonal().map(f64::sqrt),
    )
}

/// A solution to a TUM trajectory in its map. Returns the number of poses.
pub fn solution_to_tum(input: &Path, output: &Path, force: bool) -> Result<usize, LogError> {
    let solution = SolutionTable::read(input)?;
    let Some(origin) = solution.origin().filter(|_| solution.has_attitude) else {
        return Err(LogError::NotASolution {
            path: input.into(),
            reason: "no epochs with an attitude".into(),
        });
    };
    Trajectory::from_solution(&solution, origin).write(output, force)?;
    Ok(solution.len())
}

/// A solution to a CSV in the form of a `truth.csv`. Returns the number of epochs.
pub fn solution_to_csv(input: &Path, output: &Path, force: bool) -> Result<usize, LogError> {
    let solution = SolutionTable::read(input)?;
    csv::write_solution(output, &solution, solution.t0().unwrap_or_default(), force)?;
    Ok(solution.len())
}

/// Whether a log is a solution written here rather than a recording.
pub fn is_solution(log: &Log) -> bool {
    log.topics()
        .iter()
        .any(|topic| topic.name == "/insnav/state")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_go_to_the_nearest_row() {
        let field = |x: f64| Vector3::new(x, 0.0, 0.0);
        let microtesla = |x: f64| (x, field(x * 1e-6));
        let rows = field_rows(
            &[0.0, 1.0, 2.0, 3.0],
            // Before the begin; two at one row, the nearer one first; past the end.
            &[
                microtesla(-5.0),
                microtesla(1.9),
                microtesla(2.2),
                microtesla(9.0),
            ],
        );
        let x: Vec<f64> = rows.iter().map(|r| (r.x * 1e3).round() / 1e3).collect();
        assert!(x[1].is_nan(), "{x:?}");
        assert_eq!((x[0], x[2], x[3]), (-5.0, 1.9, 9.0));
        assert!(field_rows(&[], &[microtesla(1.0)]).is_empty());
    }
}
