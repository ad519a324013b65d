//! What looks wrong in the data without making a run impossible, each with what mends it.

use super::RunError;
use super::report::Warning;
use super::survey::Survey;
use crate::{Log, Role};
use insnav_core::measurement::{UNSTATED_POSITION_SIGMA, UNSTATED_VELOCITY_SIGMA};

fn warning(code: &'static str, message: String, remedy: &str) -> Warning {
    Warning {
        code,
        message,
        remedy: remedy.into(),
    }
}

pub(super) fn lever_arm_unknown() -> Warning {
    warning(
        "lever_arm_unknown",
        "the lever arm from IMU to antenna is not known and taken as zero".into(),
        "measure it and put it into the config: [gnss] lever_arm_b_m = [forward, right, down]",
    )
}

impl Log {
    /// That the log was damaged, and what is left of it; `None` when it is whole or was read without recovery.
    pub fn recovery_warning(&self) -> Option<Warning> {
        let recovery = self.recovery().filter(|recovery| !recovery.is_clean())?;
        let begin = self.time_range().map(|(first, _)| first);
        let zero = self.t0().ok().flatten().or(begin).unwrap_or_default();
        let message = format!(
            "{}: damaged, recovered: {}",
            self.path().display(),
            recovery.account(zero)
        );
        Some(warning(
            "recovered",
            message,
            "copy the file again from its origin; what is lost is bridged like any other gap",
        ))
    }
}

/// By the messages of a log: what is dropped on the way to samples, and stamps that are not in order.
pub(super) fn oddities_of_log(log: &Log) -> Result<Vec<Warning>, RunError> {
    let mut found: Vec<Warning> = log.recovery_warning().into_iter().collect();
    let statistics = log.statistics()?;
    for role in [Role::Imu, Role::GnssPosition, Role::GnssVelocity] {
        let Some(s) = log.selected().topic(role).and_then(|i| statistics.get(i)) else {
            continue;
        };
        let mut warn = |code, count: u64, what: &str, remedy: &str| {
            if count > 0 {
                found.push(warning(
                    code,
                    format!("{}: {count} of {} messages {what}", s.topic, s.count),
                    remedy,
                ));
            }
        };
        warn(
            "no_fix",
            s.no_fix,
            "say that the receiver has no fix and were dropped",
            "nothing, if the sky was obstructed there",
        );
        warn(
            "zero_position",
            s.zero_position,
            "have latitude and longitude zero and were dropped",
            "mark them as no fix in the driver",
        );
        if role != Role::Imu {
            // The navigator itself tells of inertial samples that are not finite.
            warn(
                "not_finite",
                s.not_finite,
                "have NaN or infinity in them and were dropped",
                "mark them as no fix in the driver",
            );
        }
        warn(
            "unstamped",
            s.unstamped,
            "have no stamp; their log time is taken",
            "let the driver stamp its messages, or take all times from the recorder with `--time log`",
        );
        warn(
            "backward_steps",
            s.backward_steps,
            "have an earlier stamp than the one before and were put into their place",
            "check the driver's clock and the recorder's queue",
        );
    }
    Ok(found)
}

/// By the samples: units, axes and gravity of the IMU, sigmas of the receiver.
pub(super) fn looks_wrong(survey: &Survey) -> Vec<Warning> {
    let mut found = Vec::new();
    let mut warn = |code, message: String, remedy: &str| found.push(warning(code, message, remedy));
    if let (Some(mean), Some(length)) = (survey.mean_force_b, survey.mean_force_length) {
        if (0.7..1.5).contains(&length) {
            warn(
                "imu_in_g",
                format!(
                    "the mean specific force is {length:.2}: the IMU seems to give g instead of m/s²"
                ),
                "multiply the accelerations by 9.80665 in the driver",
            );
        } else if length < 5.0 {
            warn(
                "gravity_removed",
                format!(
                    "the mean specific force is {length:.2} m/s²: gravity seems to be taken out"
                ),
                "let the driver publish the raw acceleration, with gravity",
            );
        } else if mean.z > 5.0 {
            warn(
                "imu_upside_down",
                format!(
                    "the mean specific force along the body's down axis is {:.1} m/s², where −9.8 is expected",
                    mean.z
                ),
                "take the other axes with `--imu-axes frd` (or flu), or give the mounting: `--imu-mounting-deg roll=180`",
            );
        } else if mean.z > -5.0 {
            warn(
                "imu_tilted",
                format!(
                    "the mean specific force is ({:.1}, {:.1}, {:.1}) m/s² forward, right, down: the IMU is not mounted level",
                    mean.x, mean.y, mean.z
                ),
                "give the mounting: `--imu-mounting-deg roll=…,pitch=…,yaw=…`",
            );
        }
    }
    let mut sigma = |code, missing: usize, all: usize, what: &str, taken: String, remedy: &str| {
        if missing > 0 {
            warn(
                code,
                format!("{missing} of {all} {what} state no sigma: {taken} is taken for each axis"),
                remedy,
            );
        }
    };
    sigma(
        "position_sigma_missing",
        survey.positions_without_sigma(),
        survey.positions.len(),
        "positions",
        format!("{UNSTATED_POSITION_SIGMA} m"),
        "let the driver fill the covariance; gnss.sigma_scale makes it smaller or larger",
    );
    sigma(
        "velocity_sigma_missing",
        survey.velocities_without_sigma(),
        survey.velocities.len(),
        "velocities",
        format!("{UNSTATED_VELOCITY_SIGMA} m/s"),
        "let the driver fill the covariance (TwistWithCovarianceStamped)",
    );
    if survey.velocities.is_empty() {
        warn(
            "no_gnss_velocity",
            "there is no GNSS velocity: heading is weaker, and stops are not seen".into(),
            "record the receiver's velocity as TwistWithCovarianceStamped",
        );
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn codes(force: [f64; 3]) -> Vec<&'static str> {
        let force = Vector3::from(force);
        let survey = Survey {
            mean_force_b: Some(force),
            mean_force_length: Some(force.norm()),
            ..Survey::default()
        };
        looks_wrong(&survey)
            .iter()
            .map(|w| w.code)
            .filter(|c| *c != "no_gnss_velocity")
            .collect()
    }

    #[test]
    fn forces_tell_units_and_axes() {
        assert_eq!(codes([1.1, 0.0, -9.7]), [""; 0]);
        assert_eq!(codes([0.0, 0.0, -1.0]), ["imu_in_g"]);
        assert_eq!(codes([0.0, 0.0, 9.8]), ["imu_upside_down"]);
        assert_eq!(codes([9.8, 0.0, 0.3]), ["imu_tilted"]);
        assert_eq!(codes([0.1, 0.1, 0.1]), ["gravity_removed"]);
    }
}
