//! What the windows together show, as numbers that say what they are worth.

use super::regress::{ANGLE, BIAS, MEASURED};
use super::scales::{Scale, Scaled};
use super::turned::Turned;
use super::window::Window;
use super::{Known, NoiseReading, WindowNoise};
use crate::noise::LARGEST_CHI2_PER_DOF;
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

impl Known {
    pub(super) fn not(reason: String) -> Self {
        Known {
            value: f64::NAN,
            standard_error: f64::NAN,
            accepted: false,
            reason,
        }
    }

    pub(super) fn or(mut self, before: f64) -> Self {
        if !self.accepted {
            self.value = before;
        }
        self
    }

    pub(super) fn scaled(mut self, factor: f64) -> Self {
        self.value *= factor;
        self.standard_error *= factor;
        self
    }

    /// The root of a variance with its standard error, per root of `unit`.
    fn root(variance: f64, error: f64, unit: f64, reason: &str) -> Self {
        let value = (variance / unit).sqrt();
        Known {
            value,
            standard_error: 0.5 * error / unit / value,
            accepted: true,
            reason: reason.to_string(),
        }
    }
}

/// Gyro noise, angle noise, χ² and degrees of freedom.
pub(super) fn noises(scaled: &Scaled, what: &str) -> (Known, Known, f64, usize) {
    let block = scaled.scale.block;
    let nothing = |why: String| {
        let not = Known::not(why);
        (not.clone(), not, f64::NAN, 0)
    };
    let fitted = match &scaled.pooled {
        None => return nothing(why_none(&scaled.reasons)),
        Some(Err(refusal)) => return nothing(refusal.to_string()),
        Some(Ok(fitted)) => fitted,
    };
    let estimate = &fitted.estimate;
    let widening = scaled.widening(fitted);
    let told = |by: f64| {
        if by <= 1.0 {
            "fits".to_string()
        } else {
            format!(
                "fits (errors {by:.1} times those of one white noise: it changes between windows, or is not quite white)"
            )
        }
    };
    if !estimate.fits() {
        let not = Known::not(format!(
            "the windows do not fit together (χ²/dof {:.1}, at most {LARGEST_CHI2_PER_DOF}): the {what} noise is not white",
            estimate.chi2 / estimate.dof as f64
        ));
        return (not.clone(), not, estimate.chi2, estimate.dof);
    }
    let q = estimate.theta[ANGLE];
    let q_error = estimate.standard_errors[ANGLE] * widening[ANGLE];
    // The mean over a block: see `turned::average`.
    let r = estimate.theta[MEASURED] + q / 6.0;
    let r_error = estimate.standard_errors[MEASURED] * widening[MEASURED];
    let gyro = if q <= 0.0 {
        Known::not(format!(
            "the estimate is on its bound, zero (less than {:.1e} rad/√s cannot be seen beside this {what} noise): record longer",
            (2.0 * q_error / block).sqrt()
        ))
    } else if q_error >= q {
        Known::not(format!(
            "not identifiable (the standard error exceeds the value, less than {:.1e} rad/√s): record longer",
            ((q + 2.0 * q_error) / block).sqrt()
        ))
    } else {
        Known::root(q, q_error, block, &told(widening[ANGLE]))
    };
    let angle = if r > 0.0 && r_error < r {
        Known::root(r, r_error, 1.0 / block, &told(widening[MEASURED]))
    } else {
        Known::not(format!(
            "the {what} noise is not identifiable beside that of the gyros (the standard error exceeds the value)"
        ))
    };
    (gyro, angle, estimate.chi2, estimate.dof)
}

/// The wander of the bias as a free unknown, to say whether the record tells it.
pub(super) fn bias_noise(scaled: &Scaled) -> Known {
    let Some(Ok(fitted)) = &scaled.pooled else {
        return Known::not("no window can be used".to_string());
    };
    let Scale {
        channel,
        begin,
        block,
        ..
    } = &scaled.scale;
    let data: Vec<&Turned> = scaled.used().filter_map(|w| w.data.as_ref()).collect();
    let theta = &fitted.estimate.theta;
    let start = [
        theta[ANGLE].max(0.01 * begin[ANGLE]),
        begin[BIAS],
        theta[MEASURED].max(0.01 * begin[MEASURED]),
    ];
    match channel.estimate(&data, start, None) {
        Err(refusal) => Known::not(refusal.to_string()),
        Ok(free) => {
            let value = free.estimate.theta[BIAS];
            let error = free.estimate.standard_errors[BIAS] * scaled.widening(&free)[ANGLE];
            let limit = ((value + 2.0 * error) / block).sqrt();
            if value > 3.0 * error {
                Known::root(value, error, *block, "fits")
            } else {
                Known::not(format!(
                    "not identifiable from windows of this length (less than {limit:.1e} rad/s/√s)"
                ))
            }
        }
    }
}

/// Why no window is used: the commonest reason.
fn why_none(reasons: &[Option<String>]) -> String {
    let mut kinds: Vec<&str> = reasons
        .iter()
        .flatten()
        .map(|r| r.split(" (").next().unwrap_or(r))
        .collect();
    kinds.sort_unstable();
    let commonest = kinds
        .chunk_by(|a, b| a == b)
        .max_by_key(|c| c.len())
        .map_or("", |c| c[0]);
    format!(
        "none of {} windows can be used (mostly: {commonest}): let the unit rest, or turn it slowly by hand, for a minute, or look at such a part of the record alone",
        reasons.len()
    )
}

pub(super) fn describe(
    window: &Window,
    reason: &Option<String>,
    record: &[NoiseReading],
    block: f64,
) -> WindowNoise {
    let nothing = [f64::NAN; 2];
    let (gyro_white, tilt_white, chi2_per_dof) = match &window.fitted {
        None => (nothing, nothing, f64::NAN),
        Some(fitted) => {
            let estimate = &fitted.estimate;
            let pair = |known: Known| [known.value, known.standard_error];
            let q = estimate.theta[ANGLE];
            (
                pair(Known::root(q, estimate.standard_errors[ANGLE], block, "")),
                pair(Known::root(
                    estimate.theta[MEASURED] + q / 6.0,
                    estimate.standard_errors[MEASURED],
                    1.0 / block,
                    "",
                )),
                estimate.chi2 / estimate.dof as f64,
            )
        }
    };
    WindowNoise {
        begin: record[window.range.start].time,
        end: record[window.range.end - 1].time,
        gyro_white,
        tilt_white,
        chi2_per_dof,
        accepted: reason.is_none(),
        reason: reason.clone().unwrap_or_else(|| "fits".to_string()),
    }
}
