//! `insnav compare`: a solution against a reference.

use super::run_inputs::Ending;
use crate::failure::{FAILED, Failure, WARNED};
use crate::output::Output;
use crate::text;
use clap::Args;
use insnav_core::metrics::{Comparison, orientation_mean};
use insnav_log::{ComparedReference, ComparedSolution, JudgeRequest, Judged, judge};
use serde::Serialize;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Judge a solution by a reference: errors by component, at stops, where fixes were withheld, and against the stated sigmas
///
/// Both may be an MCAP of `run`, a common CSV (gzip or not; any subset of t_s, lat_deg, lon_deg, h_m, vn, ve, vd, roll_deg,
/// pitch_deg, yaw_deg or heading_deg, qw, qx, qy, qz, and sigmas) or a TUM trajectory, the reference also RTKLIB's .pos or NMEA
/// sentences; or both are folders, whose files are paired by name. Orientations alone, an MCAP of `ahrs` or a table of quaternions
/// (t_s, qw, qx, qy, qz: sensor forward-left-up to east, north, up), are scored against a truth_quat.csv as the BROAD benchmark
/// does: total, heading and inclination, over moving = 1 where there is such a column. The solution is interpolated to the reference, never extrapolated; for a reference of GNSS fixes it is
/// moved to the antenna. NEES is the mean of e'P⁻¹e per degree of freedom: 1 when the stated uncertainty is right.
#[derive(Args, Debug)]
pub(crate) struct Compare {
    /// The solution
    solution: PathBuf,

    /// The reference
    reference: PathBuf,

    /// Leave out what is before, seconds from the time origin
    #[arg(long, value_name = "S", value_parser = seconds, allow_hyphen_values = true)]
    from: Option<f64>,

    /// Leave out what is after
    #[arg(long, value_name = "S", value_parser = seconds, allow_hyphen_values = true)]
    to: Option<f64>,

    /// Whose clock stamped the reference: solutions are on that of GNSS positions, a reference may be on the IMU's
    #[arg(long, value_enum, default_value = "gnss", value_name = "CLOCK")]
    reference_clock: ReferenceClock,

    /// Take the constant rotation between the body axes of both out of the attitude errors
    #[arg(long)]
    remove_mounting: bool,

    /// Take the constant rotation between the earth frames out of orientation errors: for a reference of quaternions that does not
    /// count from magnetic north
    #[arg(long)]
    align_earth: bool,

    /// Compare the heading with the reference's course as well: medians of 20 s on straight stretches above 5 m/s
    #[arg(long)]
    course: bool,

    /// End with code 1 if a number is larger, such as horizontal_rms_m=0.05 or withheld.height_rms_m=0.1 (repeatable)
    #[arg(long, value_name = "KEY=VALUE", value_parser = limit)]
    max: Vec<Limit>,

    /// End with code 3 when there are warnings about the comparison
    #[arg(long)]
    strict: bool,
}

/// A clock of the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum ReferenceClock {
    /// That of GNSS positions, which solutions are on
    Gnss,
    /// The IMU's: the time offset that the run used is added to the reference's stamps
    Imu,
}

/// One `--max`.
#[derive(Clone, Debug, PartialEq)]
struct Limit {
    key: String,
    value: f64,
}

fn seconds(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|s: &f64| s.is_finite());
    number.ok_or_else(|| "a number of seconds is needed".into())
}

fn limit(text: &str) -> Result<Limit, String> {
    let (key, value) = text
        .split_once('=')
        .ok_or("expected KEY=VALUE, such as horizontal_rms_m=0.05")?;
    match value.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(Limit {
            key: key.to_owned(),
            value,
        }),
        _ => Err(format!("{value:?} is no number")),
    }
}

/// What became of one `--max`.
#[derive(Debug, PartialEq, Serialize)]
struct Checked {
    key: String,
    limit: f64,
    value: Option<f64>,
    passed: bool,
}

/// One comparison with its files.
#[derive(Debug, Serialize)]
struct Row {
    name: String,
    solution: PathBuf,
    reference: PathBuf,
    #[serde(flatten)]
    judged: Judged,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    max: Vec<Checked>,
}

impl Compare {
    pub(crate) fn run(&self, output: &Output) -> Result<u8, Failure> {
        if let (Some(from), Some(to)) = (self.from, self.to)
            && from >= to
        {
            return Err(Failure::usage(
                format!("--from {from} --to {to}: nothing lies between"),
                "give a begin before the end",
            ));
        }
        let rows = if self.solution.is_dir() && self.reference.is_dir() {
            let pairs = pairs(&self.solution, &self.reference)?;
            pairs
                .into_iter()
                .map(|(name, s, r)| self.one(name, s, r))
                .collect::<Result<Vec<_>, _>>()?
        } else {
            let name = name_of(&self.solution);
            vec![self.one(name, self.solution.clone(), self.reference.clone())?]
        };
        let failed: Vec<String> = rows
            .iter()
            .flat_map(|row| {
                row.max
                    .iter()
                    .filter(|c| !c.passed)
                    .map(|c| failure_line(row, c))
            })
            .collect();
        if self.solution.is_dir() {
            let orientations = rows
                .iter()
                .filter_map(|r| r.judged.comparison.orientation.as_ref());
            let mean = orientation_mean(orientations);
            let mut json = serde_json::json!({ "rows": rows });
            if mean.trials > 0 {
                json["mean"] = serde_json::json!(mean);
            }
            output.result(&json, || {
                let named: Vec<(String, Comparison)> = rows
                    .iter()
                    .map(|r| (r.name.clone(), r.judged.comparison.clone()))
                    .collect();
                text::tables(&named, &mean)
            });
        } else if let [row] = rows.as_slice() {
            output.result(row, || {
                text::comparison(
                    &row.solution.display().to_string(),
                    &row.reference.display().to_string(),
                    &row.judged.comparison,
                )
            });
        }
        let mut warned = false;
        for row in &rows {
            output.warnings(&row.judged.warnings);
            warned |= !row.judged.warnings.is_empty();
        }
        for line in &failed {
            output.note("failed", line);
        }
        Ok(match (failed.is_empty(), warned && self.strict) {
            (false, _) => FAILED,
            (true, true) => WARNED,
            (true, false) => 0,
        })
    }

    fn one(
        &self,
        name: String,
        solution_path: PathBuf,
        reference_path: PathBuf,
    ) -> Result<Row, Failure> {
        let solution = ComparedSolution::read(&solution_path, None)?;
        let reference = ComparedReference::read(&reference_path, &solution)?;
        let request = JudgeRequest {
            solution_name: solution_path.display().to_string(),
            reference_name: reference_path.display().to_string(),
            from_s: self.from,
            to_s: self.to,
            reference_on_imu_clock: self.reference_clock == ReferenceClock::Imu,
            remove_mounting: self.remove_mounting,
            align_earth: self.align_earth,
            course: self.course,
            among_others: self.solution.is_dir(),
        };
        let judged = judge(solution, reference, &request)?;
        let mut row = Row {
            name,
            solution: solution_path,
            reference: reference_path,
            judged,
            max: Vec::new(),
        };
        let json = serde_json::to_value(&row.judged.comparison)
            .expect("numbers and lists with string keys");
        row.max = self
            .max
            .iter()
            .map(|l| check(&json, l))
            .collect::<Result<_, _>>()?;
        Ok(row)
    }
}

fn failure_line(row: &Row, c: &Checked) -> String {
    match c.value {
        Some(value) => format!("{}: {} is {value:.6}, above {}", row.name, c.key, c.limit),
        None => format!(
            "{}: {} could not be computed: solution or reference lacks the quantity",
            row.name, c.key
        ),
    }
}

/// A key is a path in the JSON; without a class it is one of `all`.
fn check(json: &Value, limit: &Limit) -> Result<Checked, Failure> {
    let pointer = |key: &str| format!("/{}", key.replace('.', "/"));
    let found = json
        .pointer(&pointer(&limit.key))
        .or_else(|| json.pointer(&pointer(&format!("all.{}", limit.key))));
    match found {
        Some(v) if v.is_number() || v.is_null() => {
            let value = v.as_f64();
            // What cannot be computed is not known to be small enough.
            let passed = value.is_some_and(|v| v <= limit.value);
            Ok(Checked {
                key: limit.key.clone(),
                limit: limit.value,
                value,
                passed,
            })
        }
        _ => {
            let mut known = Vec::new();
            numbers(json, "", &mut known);
            Err(Failure::usage(
                format!("--max {}: there is no such number", limit.key),
                format!("known: {}", known.join(", ")),
            ))
        }
    }
}

fn numbers(json: &Value, at: &str, known: &mut Vec<String>) {
    match json {
        Value::Object(map) => {
            for (key, value) in map {
                // The four classes have the same keys: one of them is enough.
                if at.is_empty() && matches!(key.as_str(), "standing" | "moving" | "withheld") {
                    known.push(format!("{key}.…"));
                    continue;
                }
                let inner = if at.is_empty() {
                    key.clone()
                } else {
                    format!("{at}.{key}")
                };
                numbers(value, &inner, known);
            }
        }
        Value::Number(_) | Value::Null => {
            known.push(at.strip_prefix("all.").unwrap_or(at).to_owned())
        }
        _ => {}
    }
}

/// Name of a recording: the file's up to the first dot.
fn name_of(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.split('.').next().unwrap_or_default().to_owned()
}

/// Whether a file is named as `run` and `ahrs` name what they write.
fn is_solution_name(path: &Path) -> bool {
    Ending::is_output(&path.file_name().unwrap_or_default().to_string_lossy())
}

/// Solutions of one folder with their references in the other: `drive.insnav.mcap` goes with `drive.csv`, `drive.csv.gz`,
/// `drive.tum` or, in a folder `drive`, `truth`, `truth_quat` or else `gnss`.
fn pairs(solutions: &Path, references: &Path) -> Result<Vec<(String, PathBuf, PathBuf)>, Failure> {
    let list = |folder: &Path| -> Result<Vec<PathBuf>, Failure> {
        let entries = std::fs::read_dir(folder).map_err(|e| {
            Failure::new(
                "not_readable",
                format!("{}: {e}", folder.display()),
                "check the path",
            )
        })?;
        let mut paths: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).collect();
        paths.sort();
        Ok(paths)
    };
    let candidates = list(references)?;
    let mut found = Vec::new();
    for solution in list(solutions)?.into_iter().filter(|p| p.is_file()) {
        let name = name_of(&solution);
        let inside = |folder: &Path| {
            [
                "truth.csv.gz",
                "truth.csv",
                "truth_quat.csv.gz",
                "truth_quat.csv",
                "gnss.csv.gz",
                "gnss.csv",
            ]
            .iter()
            .map(|f| folder.join(f))
            .find(|p| p.is_file())
        };
        let reference = candidates
            .iter()
            .filter(|c| name_of(c) == name && **c != solution)
            .find_map(|c| {
                if c.is_dir() {
                    inside(c)
                } else {
                    Some(c.clone())
                }
            });
        if let Some(reference) = reference {
            found.push((name, solution, reference));
        }
    }
    // A recording beside its own solution is not judged.
    let solved: Vec<String> = found
        .iter()
        .filter(|(_, solution, _)| is_solution_name(solution))
        .map(|(name, ..)| name.clone())
        .collect();
    found.retain(|(name, solution, _)| {
        is_solution_name(solution)
            || !solved.contains(name)
            || solution.extension().is_none_or(|e| e != "mcap")
    });
    // Two solutions of one recording are told apart by the whole of their names.
    let names: Vec<String> = found.iter().map(|(name, ..)| name.clone()).collect();
    for (name, solution, _) in &mut found {
        if names.iter().filter(|other| *other == name).count() > 1 {
            *name = solution
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
        }
    }
    if found.is_empty() {
        return Err(Failure::new(
            "no_pairs",
            format!(
                "no file of {} has a reference of its name in {}",
                solutions.display(),
                references.display()
            ),
            "name them alike up to the first dot: drive.insnav.mcap and drive.csv.gz, or drive/truth.csv.gz",
        ));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits() {
        assert_eq!(
            limit("nees.position=1.5"),
            Ok(Limit {
                key: "nees.position".into(),
                value: 1.5
            })
        );
        assert!(limit("x").is_err() && limit("x=y").is_err() && limit("x=nan").is_err());
    }

    #[test]
    fn a_limit_is_looked_up_in_its_class_or_in_all() {
        let json = serde_json::to_value(Comparison::default()).unwrap();
        let mut json = json;
        json["all"]["horizontal_rms_m"] = 0.04.into();
        json["withheld"]["horizontal_rms_m"] = 0.06.into();
        let passed = |key: &str| {
            check(
                &json,
                &Limit {
                    key: key.into(),
                    value: 0.05,
                },
            )
            .map(|c| c.passed)
            .map_err(|f| f.exit)
        };
        assert_eq!(passed("horizontal_rms_m"), Ok(true));
        assert_eq!(passed("withheld.horizontal_rms_m"), Ok(false));
        assert_eq!(
            passed("height_rms_m"),
            Ok(false),
            "what is not known is not small"
        );
        assert_eq!(passed("horizontal_rms"), Err(crate::failure::USAGE));
    }

    #[test]
    fn names_end_at_the_first_dot() {
        assert_eq!(name_of(Path::new("/x/drive.insnav.mcap")), "drive");
        assert_eq!(name_of(Path::new("/x/drive")), "drive");
    }
}
