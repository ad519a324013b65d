//! Fixes without a sigma, and velocities that are not there at all.

use super::{Facts, Finding, Severity};
use insnav_core::measurement::{UNSTATED_POSITION_SIGMA, UNSTATED_VELOCITY_SIGMA};

pub(super) fn find(facts: &Facts<'_>) -> Vec<Finding> {
    let survey = facts.survey;
    let mut found = Vec::new();
    let mut missing =
        |code, missing: usize, all: usize, what: &str, taken: String, remedy: &str| {
            if missing > 0 {
                found.push(
                    Finding::new(
                        code,
                        Severity::Note,
                        format!("{missing} of {all} {what} state no sigma"),
                        format!("{taken} is taken for each axis"),
                    )
                    .remedy(remedy),
                );
            }
        };
    missing(
        "position_sigma_missing",
        survey.positions_without_sigma(),
        survey.positions.len(),
        "positions",
        format!("{UNSTATED_POSITION_SIGMA} m"),
        "let the driver fill the covariance; `--set gnss.sigma_scale=…` makes it smaller or larger",
    );
    missing(
        "velocity_sigma_missing",
        survey.velocities_without_sigma(),
        survey.velocities.len(),
        "velocities",
        format!("{UNSTATED_VELOCITY_SIGMA} m/s"),
        "let the driver fill the covariance (TwistWithCovarianceStamped)",
    );
    if survey.velocities.is_empty() && !survey.positions.is_empty() {
        found.push(
            Finding::new(
                "no_gnss_velocity",
                Severity::Note,
                "there is no GNSS velocity",
                "heading is weaker, and stops are found from the inertial data and the filter's own velocity alone: fewer are",
            )
            .remedy("record the receiver's velocity as TwistWithCovarianceStamped"),
        );
    }
    found
}
