//! What the measurements themselves say about their noise and about the run.

use super::report::{AidingReport, ResetReport, ScaleReport, Warning};
use insnav_core::error::Error;
use serde::{Deserialize, Serialize};

/// Fewer measurements than this say nothing about their kind.
const ENOUGH: usize = 30;
/// Above this share of measurements that were refused or widened the user is told: the gate refuses one in ten thousand good
/// ones.
const MANY: f64 = 0.05;
/// Mean NIS per component of accepted measurements when stated sigmas are half of what they should be: 4, less what the gate
/// cuts off.
const TOO_HIGH: f64 = 2.8;
/// The same when they are twice what they should be.
const TOO_LOW: f64 = 0.25;

/// Samples that the navigator could not use; it goes on without them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Unusable {
    pub(super) count: usize,
    first: Option<String>,
}

impl Unusable {
    pub(super) fn push(&mut self, error: &Error) {
        self.count += 1;
        self.first.get_or_insert_with(|| error.to_string());
    }

    pub(super) fn warning(&self) -> Option<Warning> {
        let first = self.first.as_ref()?;
        let plural = if self.count == 1 { "" } else { "s" };
        Some(Warning {
            code: "unusable_samples",
            message: format!(
                "{} sample{plural} could not be used; the first: {first}",
                self.count
            ),
            remedy: "the run went on without them; check the driver that gives them".into(),
        })
    }
}

/// What to do about measurements of a kind that do not fit.
fn remedy_of_refused(name: &str, scale_key: &str) -> String {
    match name {
        "gnss_position" | "gnss_velocity" => format!(
            "check lever arm and clocks with `insnav info`; if they scatter by more than they state, give `--set {scale_key}=auto` or a \
             factor"
        ),
        "heading" => "check unit, zero and sigma of the topic that gives it, or leave it out (`--topic heading=none`)".into(),
        "nonholonomic" => {
            "the vehicle slips, or moves where it does not point: leave the constraint out (`--set vehicle.nonholonomic=off`)".into()
        }
        // All others are told while the body is held to stand.
        _ => "the body moves in what is taken for a stop: check what declares it (`--stop`, the topic of standing), make the detector \
              stricter (`--set stationary.threshold_scale=1`), or use no stops (`--stationary off`)"
            .into(),
    }
}

/// Refusals, wrong sigmas, and positions that the filter went over to.
pub(super) fn doubts(
    aiding: &[AidingReport],
    resets: &[ResetReport],
    scales: &[ScaleReport; 2],
) -> Vec<Warning> {
    let mut found = Vec::new();
    let mut warn = |code, message: String, remedy: String| {
        found.push(Warning {
            code,
            message,
            remedy,
        })
    };
    for aid in aiding {
        let all = aid.count();
        let (key, scale) = match aid.name.as_str() {
            "gnss_position" => ("gnss.sigma_scale", Some(&scales[0])),
            "gnss_velocity" => ("gnss.velocity_sigma_scale", Some(&scales[1])),
            _ => ("", None),
        };
        let share = |n: usize| n as f64 > MANY * all as f64;
        let enough = all >= ENOUGH;
        if enough && share(aid.rejected + aid.inflated) {
            warn(
                "many_rejected",
                format!(
                    "of {all} {} measurements {} were refused and {} used with a widened covariance",
                    aid.name, aid.rejected, aid.inflated
                ),
                remedy_of_refused(&aid.name, key),
            );
        }
        if let Some(row) = &aid.misfit {
            warn(
                "diverged",
                format!(
                    "from {:.1} to {:.1} s the solution and {} measurements cannot both be true: {} in a row with NIS/dof of 20 or more",
                    row.begin_s, row.end_s, aid.name, row.count
                ),
                format!(
                    "do not use the solution there without knowing which is wrong: {}",
                    remedy_of_refused(&aid.name, key)
                ),
            );
        }
        if enough && share(aid.frozen) {
            warn(
                "frozen_position",
                format!(
                    "{} of {all} positions repeat the one before to the last digit while the vehicle moves, and were not used",
                    aid.frozen
                ),
                "let the driver publish new fixes only".into(),
            );
        }
        let (Some(nis), Some(scale), true) = (aid.nis_mean, scale, enough) else {
            continue;
        };
        // A learnt scale says what was found; the mean over the run has its learning in it.
        let factor = nis.sqrt();
        let off = if nis > TOO_HIGH {
            "too small"
        } else if nis < TOO_LOW && aid.name == "gnss_position" {
            // Of velocities it does no harm.
            "too large"
        } else {
            continue;
        };
        if !scale.learnt {
            warn(
                "wrong_sigmas",
                format!(
                    "the sigmas of {} are {off}: their residuals have NIS/dof {nis:.2} where 1 is expected",
                    aid.name
                ),
                format!(
                    "give `--set {key}=auto`, or the factor itself, about {:.2}",
                    factor * scale.horizontal
                ),
            );
        }
    }
    if let Some(first) = resets.first() {
        let [n, e, d] = first.offset_ned_m;
        let size = n.hypot(e).hypot(d);
        let times: Vec<String> = resets
            .iter()
            .take(10)
            .map(|r| format!("{:.1}", r.time_s))
            .collect();
        let more = if resets.len() > 10 { " …" } else { "" };
        warn(
            "position_reset",
            format!(
                "the filter had drifted from the positions, or they from it, and went over to them {} (at {}{more} s; the first time by {size:.1} m)",
                super::execute::times(resets.len()),
                times.join(", ")
            ),
            "look at the track there; check clocks and lever arm with `insnav info`, and the grade of the unit (`--set imu.grade=…`)".into(),
        );
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::report::MisfitReport;

    fn aid(used: usize, rejected: usize, nis: f64) -> AidingReport {
        AidingReport {
            name: "gnss_position".into(),
            dof: 3,
            used,
            rejected,
            inflated: 0,
            reset: 0,
            frozen: 0,
            nis_mean: Some(nis),
            misfit: None,
        }
    }

    fn codes(aid: AidingReport, learnt: bool) -> Vec<&'static str> {
        let scale = ScaleReport {
            horizontal: 1.0,
            vertical: 1.0,
            learnt,
        };
        doubts(&[aid], &[], &[scale; 2])
            .iter()
            .map(|w| w.code)
            .collect()
    }

    #[test]
    fn good_measurements_give_no_warning() {
        assert_eq!(codes(aid(1000, 1, 1.0), false), [""; 0]);
        assert_eq!(codes(aid(1000, 40, 2.0), false), [""; 0]);
        assert_eq!(codes(aid(10, 10, 9.0), false), [""; 0], "too few to tell");
    }

    #[test]
    fn refusals_and_wrong_sigmas_are_told_with_the_flag() {
        assert_eq!(codes(aid(1000, 100, 1.0), false), ["many_rejected"]);
        assert_eq!(codes(aid(1000, 0, 3.0), false), ["wrong_sigmas"]);
        assert_eq!(codes(aid(1000, 0, 0.01), false), ["wrong_sigmas"]);
        assert_eq!(codes(aid(1000, 0, 0.01), true), [""; 0]);
        let scale = ScaleReport {
            horizontal: 2.0,
            vertical: 2.0,
            learnt: false,
        };
        let told = doubts(&[aid(1000, 0, 0.01)], &[], &[scale; 2]);
        assert!(
            told[0].remedy.contains("gnss.sigma_scale=auto") && told[0].remedy.contains("0.20")
        );
    }

    #[test]
    fn measurements_with_a_widened_covariance_count_as_those_that_do_not_fit() {
        let widened = AidingReport {
            inflated: 60,
            ..aid(1000, 0, 1.0)
        };
        assert_eq!(codes(widened, false), ["many_rejected"]);
    }

    #[test]
    fn a_remedy_names_what_the_kind_of_measurement_depends_on() {
        let scale = ScaleReport {
            horizontal: 1.0,
            vertical: 1.0,
            learnt: true,
        };
        let remedy = |name: &str| {
            let refused = AidingReport {
                name: name.into(),
                ..aid(100, 100, 1.0)
            };
            let told = doubts(&[refused], &[], &[scale; 2]);
            assert_eq!(told.len(), 1, "{told:?}");
            told[0].remedy.clone()
        };
        assert!(remedy("gnss_velocity").contains("gnss.velocity_sigma_scale"));
        for (name, flag) in [
            ("heading", "--topic heading=none"),
            ("nonholonomic", "vehicle.nonholonomic=off"),
            ("zero_velocity", "--stationary off"),
            ("standing_rate", "--stationary off"),
        ] {
            let remedy = remedy(name);
            assert!(
                remedy.contains(flag) && !remedy.contains("lever arm"),
                "{name}: {remedy}"
            );
        }
    }

    #[test]
    fn a_row_that_cannot_be_is_told_with_its_ends() {
        let mut long = aid(10, 12, 1.0);
        long.misfit = Some(MisfitReport {
            begin_s: 12.0,
            end_s: 24.04,
            count: 12,
        });
        let scale = ScaleReport {
            horizontal: 1.0,
            vertical: 1.0,
            learnt: true,
        };
        let told = doubts(&[long], &[], &[scale; 2]);
        assert_eq!(told[0].code, "diverged");
        for part in ["12.0 to 24.0 s", "gnss_position", "12 in a row"] {
            assert!(
                told[0].message.contains(part),
                "{part}: {}",
                told[0].message
            );
        }
    }

    #[test]
    fn resets_are_told_with_their_times() {
        let reset = |time_s| ResetReport {
            time_s,
            offset_ned_m: [9.0, 12.0, 0.0],
        };
        let scale = ScaleReport {
            horizontal: 1.0,
            vertical: 1.0,
            learnt: true,
        };
        let told = doubts(&[], &[reset(12.34), reset(80.0)], &[scale; 2]);
        assert_eq!(told[0].code, "position_reset");
        assert!(
            told[0]
                .message
                .contains("2 times (at 12.3, 80.0 s; the first time by 15.0 m)")
        );
    }

    #[test]
    fn unusable_samples_are_counted_with_the_first_reason() {
        let mut unusable = Unusable::default();
        assert_eq!(unusable.warning(), None);
        unusable.push(&Error::NotStarted {
            missing: "a reason",
        });
        unusable.push(&Error::NotStarted { missing: "another" });
        let text = unusable.warning().expect("two of them").message;
        assert!(
            text.starts_with("2 samples") && text.contains("a reason"),
            "{text}"
        );
    }
}
