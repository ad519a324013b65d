//! `insnav.compare`: a solution judged by a reference, as the command does it.
//!
//! `table` reads what either is, `known` says which columns there are, `columns` is what was read, `series` what comes out.

mod columns;
mod known;
mod series;
mod table;

use self::columns::Columns;
use self::series::Series;
use self::table::Given;
use crate::failure::{Failure, fail, warn};
use crate::interrupt::{Stop, interruptible};
use crate::run::dictionary;
use insnav_log::{ComparedReference, ComparedSolution, JudgeRequest, Warning, judge};
use pyo3::prelude::*;
use std::path::PathBuf;

/// Judge a solution by a reference: errors by component, at stops and under way, and against the stated sigmas.
///
/// Does what the command ``insnav compare`` does. The solution is interpolated to the reference, never extrapolated, and not across
/// holes; for a reference of GNSS fixes it is moved to the antenna. Errors are solution minus reference. Other threads run meanwhile.
///
/// Parameters
/// ----------
/// solution : Solution, path, mapping or data frame
///     What :func:`insnav.run` returns; a file that the command reads as a solution (MCAP of ``run`` or ``ahrs``, CSV, TUM); or columns with
///     the names of those of :class:`Solution`: ``time_s`` and any of a position (``latitude_deg``, ``longitude_deg`` and ``height_m``),
///     ``velocity_n_m_per_s``, ``quaternion_nb_wxyz`` (or ``roll_deg``, ``pitch_deg``, ``heading_deg``), ``rate_b_deg_per_s``, ``standing``,
///     ``standing_s``, covariances or ``sigma_…``, and ``t0_ns``. Columns may be one number each, as :meth:`Solution.to_pandas` names them.
/// reference : insnav.sim.Truth, Solution, path, mapping or data frame
///     A truth, another solution, a file that the command reads as a reference (CSV, RTKLIB, NMEA, TUM, MCAP), or columns with
///     the same names, and ``sigma_position_n_m``, ``sigma_velocity_n_m_per_s``, ``moving``. NaN where there is nothing to compare with.
///     Seconds count from the solution's zero, ``t0_ns``; ``datetime64`` is absolute.
/// from_s, to_s : float, optional
///     Leave out what is before or after, s from the solution's zero.
/// reference_clock : {"gnss", "imu"}
///     Whose clock stamped the reference: solutions are on that of GNSS positions.
/// remove_mounting : bool, default False
///     Take the constant rotation between the body axes of both out of the attitude errors.
/// align_earth : bool, default False
///     Take the constant rotation between the earth frames out of orientation errors.
/// course : bool, default False
///     Compare the heading with the reference's course as well.
/// withheld : str, optional
///     Judge these stretches apart as ``summary["withheld"]``: intervals in seconds, such as ``"120:150,300:330"``. Absent: what
///     the run of the solution withheld.
/// reference_at_antenna : bool, optional
///     Of a mapping: whether its positions are of the GNSS antenna. Absent: they are where there is no attitude.
///
/// Returns
/// -------
/// Comparison
///     ``summary`` with the keys of ``insnav compare --format json``, and the errors instant by instant.
///
/// Raises
/// ------
/// ArgumentError
///     A column of the wrong shape, or of a name that no class of this package has (other columns of these classes are left out);
///     latitudes beyond 90 degrees; solution and reference without an instant or a quantity in common.
/// LogError
///     A file that cannot be read.
///
/// Warns
/// -----
/// InsnavWarning
///     Errors that make one doubt the comparison; all warnings are in ``summary["warnings"]`` too.
///
/// Notes
/// -----
/// NEES is the mean of eᵀP⁻¹e per component: 1 where the stated uncertainty is right [BarShalom01, section 5.4.2].
///
/// Examples
/// --------
/// >>> import insnav
/// >>> drive = insnav.sim.Scenario.car_drive(120.0).simulate(seed=1)
/// >>> solution = insnav.run(drive.arrays, start=drive.start)
/// >>> c = insnav.compare(solution, drive.truth, from_s=10.0)
/// >>> c.position_error_n_m.shape == (len(c), 3) and bool(abs(c.position_error_n_m).max() < 10.0)
/// True
#[pyfunction]
#[pyo3(signature = (
    solution, reference, *, from_s=None, to_s=None, reference_clock="gnss", remove_mounting=false, align_earth=false,
    course=false, withheld=None, reference_at_antenna=None
))]
// One argument each of the Python function.
#[allow(clippy::too_many_arguments)]
pub(crate) fn compare<'py>(
    solution: &Bound<'py, PyAny>,
    reference: &Bound<'py, PyAny>,
    from_s: Option<f64>,
    to_s: Option<f64>,
    reference_clock: &str,
    remove_mounting: bool,
    align_earth: bool,
    course: bool,
    withheld: Option<String>,
    reference_at_antenna: Option<bool>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = solution.py();
    let fail = fail(py);
    let reference_on_imu_clock = match reference_clock {
        "gnss" => false,
        "imu" => true,
        other => {
            return Err(fail(Failure::unknown_word(
                "reference_clock",
                other,
                "gnss, imu",
            )));
        }
    };
    let solution_given = Given::new(solution, "solution")?;
    let reference_given = Given::new(reference, "reference")?;
    let request = JudgeRequest {
        solution_name: solution_given.name(),
        reference_name: reference_given.name(),
        from_s,
        to_s,
        reference_on_imu_clock,
        remove_mounting,
        align_earth,
        course,
        among_others: false,
    };
    // Numbers are copied here, where Python has them; all that is made of them needs no interpreter.
    let mut fixes = None;
    let solution = match &solution_given {
        Given::File(path) => Read::File(path.clone()),
        Given::Columns(columns) => {
            if let Some(rule) = columns.withheld_singly()?.filter(|_| withheld.is_none()) {
                match columns.withheld_fixes()? {
                    Some(known) => fixes = Some(known),
                    None => warn(
                        py,
                        &Warning {
                            code: "withheld_unknown",
                            message: format!(
                                "the fixes withheld by {rule} are not judged apart: they are not with these columns"
                            ),
                            remedy: "compare the solution that `run` returned, or the file that `run(..., output=...)` writes".into(),
                        },
                    )?,
                }
            }
            Read::Solution(columns.solution()?)
        }
    };
    let reference = match &reference_given {
        Given::File(path) => Read::File(path.clone()),
        Given::Columns(columns) if columns.is_solution()? => Read::Solution(columns.solution()?),
        Given::Columns(columns) => Read::Reference(columns.reference()?),
    };
    let work = move |_: &Stop| -> Result<_, Failure> {
        let mut is = match solution {
            Read::File(path) => ComparedSolution::read(&path, None)?,
            Read::Solution(columns) | Read::Reference(columns) => columns.solution()?,
        };
        if let Some(fixes) = fixes {
            is.withheld = fixes;
        }
        if let Some(rule) = &withheld {
            is.set_withheld(rule).map_err(|e| {
                Failure::new(
                    "bad_option",
                    format!("withheld: {e}"),
                    "intervals as \"120:150,300:330\"",
                )
            })?;
        }
        let should = match reference {
            Read::File(path) => ComparedReference::read(&path, &is)?,
            Read::Solution(columns) => ComparedReference::of(&columns.solution()?),
            Read::Reference(columns) => columns.reference(is.origin, reference_at_antenna)?,
        };
        let origin = is.origin;
        let judged = judge(is, should, &request).map_err(|problem| {
            let code = match &*problem.code {
                "no_overlap" => "no_overlap",
                "nothing_to_compare" => "nothing_to_compare",
                _ => "bad_option",
            };
            Failure::new(code, problem.message, problem.remedy)
        })?;
        let series = Series::of(&judged.series, origin);
        Ok((series, serde_json::to_string(&judged), judged.warnings))
    };
    let (series, summary, warnings) = interruptible(py, work)?.map_err(fail)?;
    for warning in &warnings {
        warn(py, warning)?;
    }
    let fields = series.fields(py)?;
    fields.set_item("summary", dictionary(py, summary)?)?;
    py.import("insnav._compare")?
        .getattr("Comparison")?
        .call((), Some(&fields))
}

/// One of the two, as it goes to the thread that compares.
enum Read {
    File(PathBuf),
    Solution(Columns),
    Reference(Columns),
}
