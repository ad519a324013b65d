//! `insnav compare`: a solution against a reference.

use super::run_inputs::Ending;
use crate::failure::{FAILED, Failure, WARNED};
use crate::output::Output;
use crate::text;
use clap::Args;
use insnav_core::metrics::{CompareOptions, Comparison, compare, orientation_mean};
use insnav_log::{ComparedReference, ComparedSolution, Warning};
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
    reference_at_antenna: bool,
    #[serde(flatten)]
    comparison: Comparison,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    max: Vec<Checked>,
    warnings: Vec<Warning>,
}

/// Errors of so many of their stated sigmas, squared, are no bad luck.
const ABSURD_NEES: f64 = 25.0;
/// Nor are sigmas of ten times the errors good luck over a whole drive.
const IDLE_NEES: f64 = 0.01;
/// Further away than this on average is another place, m.
const ELSEWHERE_M: f64 = 1000.0;

/// What makes one doubt that solution and reference belong together, or that either is what it says.
fn doubts(name: &str, c: &Comparison) -> Vec<Warning> {
    let mut found = Vec::new();
    let mut warn = |code, message: String, remedy: &str| {
        found.push(Warning {
            code,
            message: format!("{name}: {message}"),
            remedy: remedy.into(),
        });
    };
    if let Some(rms) = c.all.horizontal_rms_m.filter(|rms| *rms > ELSEWHERE_M) {
        warn(
            "reference_elsewhere",
            format!("solution and reference are {rms:.0} m apart on average"),
            "check that both are of the same drive, and that the reference has latitude and longitude in their columns",
        );
    }
    let nees = &c.all.nees;
    let of = [
        ("position", nees.position),
        ("velocity", nees.velocity),
        ("attitude", nees.attitude),
    ];
    for (what, value) in of {
        let Some(value) = value else { continue };
        if value > ABSURD_NEES {
            warn(
                "nees_absurd",
                format!(
                    "the {what} errors are {:.0} times what the solution states (NEES {value:.0}, and 1 is right)",
                    value.sqrt()
                ),
                "check clock, lever arm and mounting (`insnav info`, --reference-clock, --remove-mounting), and that the reference \
                 itself is better than the stated sigmas",
            );
        } else if value < IDLE_NEES {
            warn(
                "nees_idle",
                format!(
                    "the {what} errors are far smaller than what the solution states (NEES {value:.4}, and 1 is right)"
                ),
                "the stated noise is too large, or the reference was made of the solution itself",
            );
        }
    }
    found
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
                .filter_map(|r| r.comparison.orientation.as_ref());
            let mean = orientation_mean(orientations);
            let mut json = serde_json::json!({ "rows": rows });
            if mean.trials > 0 {
                json["mean"] = serde_json::json!(mean);
            }
            output.result(&json, || {
                let named: Vec<(String, Comparison)> = rows
                    .iter()
                    .map(|r| (r.name.clone(), r.comparison.clone()))
                    .collect();
                text::tables(&named, &mean)
            });
        } else if let [row] = rows.as_slice() {
            output.result(row, || {
                text::comparison(
                    &row.solution.display().to_string(),
                    &row.reference.display().to_string(),
                    &row.comparison,
                )
            });
        }
        let mut warned = false;
        for row in &rows {
            output.warnings(&row.warnings);
            warned |= !row.warnings.is_empty();
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
        let reference = match self.reference_clock {
            ReferenceClock::Gnss => reference,
            ReferenceClock::Imu => reference.delayed(solution.time_offset),
        };
        let options = CompareOptions {
            origin: solution.origin,
            from: self.from.map(|s| solution.origin.plus(s)),
            to: self.to.map(|s| solution.origin.plus(s)),
            lever_arm_b: solution.lever_arm_b,
            reference_at_antenna: reference.at_antenna,
            velocity_lag: if reference.at_antenna {
                solution.velocity_lag
            } else {
                0.0
            },
            remove_mounting: self.remove_mounting,
            align_earth: self.align_earth,
            course: self.course,
            withheld: solution.withheld,
        };
        let comparison = compare(&solution.track, &reference.points, &options);
        if comparison.all.count == 0 {
            return Err(Failure::new(
                "no_overlap",
                format!(
                    "{} and {} have no instant in common{}: {}, {}",
                    solution_path.display(),
                    reference_path.display(),
                    if self.from.is_some() || self.to.is_some() {
                        " between --from and --to"
                    } else {
                        ""
                    },
                    extent(
                        "solution",
                        solution
                            .track
                            .points()
                            .iter()
                            .map(|p| p.time.since(options.origin))
                    ),
                    extent(
                        "reference",
                        reference
                            .points
                            .iter()
                            .map(|p| p.time.since(options.origin))
                    ),
                ),
                "check that both count seconds from the same origin (`convert --t0`), and --from and --to",
            ));
        }
        let solution_name = solution_path.display().to_string();
        let mut row = Row {
            name,
            solution: solution_path,
            reference: reference_path,
            reference_at_antenna: reference.at_antenna,
            warnings: reference
                .warnings
                .into_iter()
                .chain(doubts(&solution_name, &comparison))
                .collect(),
            comparison,
            max: Vec::new(),
        };
        let json =
            serde_json::to_value(&row.comparison).expect("numbers and lists with string keys");
        row.max = self
            .max
            .iter()
            .map(|l| check(&json, l))
            .collect::<Result<_, _>>()?;
        Ok(row)
    }
}

fn extent(what: &str, seconds: impl Iterator<Item = f64>) -> String {
    let (low, high) = seconds.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), t| {
        (l.min(t), h.max(t))
    });
    if low > high {
        format!("the {what} is empty")
    } else {
        format!("{what} from {low:.1} to {high:.1} s")
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
    fn absurd_numbers_are_doubted() {
        let codes = |change: fn(&mut Comparison)| {
            let mut c = Comparison::default();
            change(&mut c);
            let codes: Vec<&str> = doubts("x", &c).iter().map(|w| w.code).collect();
            codes.join(" ")
        };
        assert_eq!(codes(|_| ()), "");
        assert_eq!(codes(|c| c.all.nees.position = Some(3.0)), "");
        assert_eq!(codes(|c| c.all.nees.velocity = Some(30.0)), "nees_absurd");
        assert_eq!(codes(|c| c.all.nees.attitude = Some(0.0)), "nees_idle");
        let elsewhere = codes(|c| c.all.horizontal_rms_m = Some(5e6));
        assert_eq!(elsewhere, "reference_elsewhere");
    }

    #[test]
    fn names_end_at_the_first_dot() {
        assert_eq!(name_of(Path::new("/x/drive.insnav.mcap")), "drive");
        assert_eq!(name_of(Path::new("/x/drive")), "drive");
    }
}
