//! A solution judged by a reference, whoever asks: the comparison, and what makes one doubt it.

use super::{ComparedReference, ComparedSolution};
use crate::Problem;
use crate::run::Warning;
use insnav_core::metrics::{
    AttitudeReference, CompareOptions, Comparison, ErrorInstant, PointError, compare, error_series,
};
use nalgebra::Vector3;
use serde::Serialize;

/// What to compare, and under which names to tell of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JudgeRequest {
    /// Name of the solution in messages: that of its file.
    pub solution_name: String,
    /// Name of the reference.
    pub reference_name: String,
    /// Leave out what is before, s from the solution's origin.
    pub from_s: Option<f64>,
    /// Leave out what is after.
    pub to_s: Option<f64>,
    /// Whether the reference was stamped by the IMU's clock: the time offset that the run used is added to it.
    pub reference_on_imu_clock: bool,
    /// See [`CompareOptions::remove_mounting`].
    pub remove_mounting: bool,
    /// See [`CompareOptions::align_earth`].
    pub align_earth: bool,
    /// See [`CompareOptions::course`].
    pub course: bool,
    /// One of many: where there is nothing to compare, that is a warning, and the others are compared.
    pub among_others: bool,
}

/// What came of it, with the keys of the command's JSON.
#[derive(Clone, Debug, Serialize)]
pub struct Judged {
    /// Whether the reference is of the antenna, to which the solution was moved.
    pub reference_at_antenna: bool,
    /// The comparison.
    #[serde(flatten)]
    pub comparison: Comparison,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// The errors instant by instant.
    #[serde(skip)]
    pub series: Vec<ErrorInstant>,
}

/// Compare. Without an instant in common, or a quantity (of one alone), this is a [`Problem`] that tells what both have.
pub fn judge(
    solution: ComparedSolution,
    reference: ComparedReference,
    request: &JudgeRequest,
) -> Result<Judged, Problem> {
    if let (Some(from), Some(to)) = (request.from_s, request.to_s)
        && from >= to
    {
        return Err(Problem::new(
            "usage",
            format!("from {from} s to {to} s: nothing lies between"),
            "give a begin before the end",
        ));
    }
    let reference = if request.reference_on_imu_clock {
        reference.delayed(solution.time_offset)
    } else {
        reference
    };
    let options = CompareOptions {
        origin: solution.origin,
        from: request.from_s.map(|s| solution.origin.plus(s)),
        to: request.to_s.map(|s| solution.origin.plus(s)),
        lever_arm_b: solution.lever_arm_b,
        reference_at_antenna: reference.at_antenna,
        velocity_lag: if reference.at_antenna {
            solution.velocity_lag
        } else {
            0.0
        },
        remove_mounting: request.remove_mounting,
        align_earth: request.align_earth,
        course: request.course,
        withheld: solution.withheld,
    };
    let comparison = compare(&solution.track, &reference.points, &options);
    if comparison.all.count == 0 {
        let cut = if request.from_s.is_some() || request.to_s.is_some() {
            " in the part that is asked for"
        } else {
            ""
        };
        let solution_s = solution
            .track
            .points()
            .iter()
            .map(|p| p.time.since(options.origin));
        let reference_s = reference
            .points
            .iter()
            .map(|p| p.time.since(options.origin));
        return Err(Problem::new(
            "no_overlap",
            format!(
                "{} and {} have no instant in common{cut}: {}, {}",
                request.solution_name,
                request.reference_name,
                extent("solution", solution_s),
                extent("reference", reference_s),
            ),
            "check that both count seconds from the same origin (`convert --t0`), and the part that is asked for",
        ));
    }
    let series = error_series(&solution.track, &reference.points, &options);
    let mut empty = None;
    if !series.iter().any(|instant| has_an_error(&instant.error)) {
        let points = solution.track.points();
        let of_solution = quantities([
            points.iter().any(|p| p.position.is_some()),
            points.iter().any(|p| p.velocity_n.is_some()),
            points.iter().any(|p| p.q_nb.is_some()),
        ]);
        let points = &reference.points;
        let of_reference = quantities([
            points.iter().any(|p| p.position.is_some()),
            points.iter().any(|p| p.velocity_n.is_some()),
            points.iter().any(|p| p.attitude != AttitudeReference::None),
        ]);
        empty = Some(Warning {
            code: "nothing_to_compare",
            message: format!(
                "nothing that {} has is in {}, at any of the {} instants that they have in common: the solution has {of_solution}, \
                 the reference {of_reference}",
                request.solution_name, request.reference_name, comparison.all.count,
            ),
            remedy: "give the reference a quantity that the solution has: a whole position, a velocity or an attitude".into(),
        });
    }
    let empty = match empty {
        Some(told) if !request.among_others => {
            return Err(Problem::new(told.code, told.message, told.remedy));
        }
        empty => empty,
    };
    let doubts = doubts(&request.solution_name, &comparison);
    Ok(Judged {
        reference_at_antenna: reference.at_antenna,
        warnings: (reference.warnings.into_iter())
            .chain(doubts)
            .chain(empty)
            .collect(),
        comparison,
        series,
    })
}

/// Whether anything was compared at an instant.
fn has_an_error(error: &PointError) -> bool {
    let any = |v: Option<Vector3<f64>>| v.is_some_and(|v| v.iter().any(|x| x.is_finite()));
    any(error.position_n) || any(error.velocity_n) || any(error.angles) || error.rotation.is_some()
}

/// Those of position, velocity and attitude that there are.
fn quantities(has: [bool; 3]) -> String {
    let names = ["position", "velocity", "attitude"];
    let there: Vec<&str> = names
        .into_iter()
        .zip(has)
        .filter_map(|(name, has)| has.then_some(name))
        .collect();
    match there.is_empty() {
        true => "no position, velocity or attitude".into(),
        false => there.join(", "),
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
