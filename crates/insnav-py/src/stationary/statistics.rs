//! Statistics of the four detectors over windows that slide by one sample, with their thresholds.

use crate::arrays::{Argument, scalars};
use crate::failure::{Failure, fail};
use crate::interrupt::{Stop, interruptible};
use crate::settings;
use insnav_core::imu::ImuGrade;
use insnav_core::stationary::quantile::of_squares;
use insnav_core::stationary::{Moments, RestNoise, are, glrt, mag, mv, sliding_moments};
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Quantile of a sum of squares with this mean and variance, as a scaled chi-square: what every threshold follows from.
///
/// Parameters
/// ----------
/// mean, variance : float
///     Of the sum; of a chi-square its degrees of freedom, and twice these.
/// normal_quantile : float
///     That of the normal distribution for the same probability: 3.090 for one in a thousand, 3.719 for 1e-4, 4.753 for 1e-6.
///
/// Returns
/// -------
/// float
///     [Satterthwaite46], by [Wilson31]: within 1.5 % from ten degrees of freedom on, within 4 % at three.
///
/// Examples
/// --------
/// >>> from insnav import stationary
/// >>> bool(abs(stationary.quantile_of_squares(100, 200, 3.090) / 149.449 - 1) < 0.015)  # as in tables
/// True
#[pyfunction]
pub(crate) fn quantile_of_squares(
    py: Python<'_>,
    mean: f64,
    variance: f64,
    normal_quantile: f64,
) -> PyResult<f64> {
    for (name, value, fits, expected) in [
        ("mean", mean, mean > 0.0, "finite and above 0"),
        ("variance", variance, variance > 0.0, "finite and above 0"),
        ("normal_quantile", normal_quantile, true, "finite"),
    ] {
        if !(fits && value.is_finite()) {
            let received = value.to_string();
            return Err(fail(py)(Failure::argument(
                "bad_value",
                name,
                received,
                expected,
                "",
            )));
        }
    }
    Ok(of_squares(mean, variance, normal_quantile))
}

/// One of the four detectors of [Skog10] over windows that slide by one sample.
///
/// Parameters
/// ----------
/// detector : {"mv", "mag", "are", "glrt"}
///     Acceleration moving variance, acceleration magnitude, angular rate energy, generalised likelihood ratio.
/// step_s : float
///     Step between samples, s.
/// gyro : (n, 3), or None where it is not looked at
///     Angular rate, body axes, rad/s.
/// accel : (n, 3), or None where it is not looked at
///     Specific force, body axes, m/s².
/// window_s : float
///     Length of the window.
/// config : mapping or path, optional
///     Settings as of :func:`insnav.run`: noise at rest is that of ``stationary``, else of ``noise`` and ``imu.grade``, else a consumer's.
/// stance : bool, default False
///     The window is that of a foot on the ground: noise at least what a foot that rolls on shows.
/// expected_rate_b_rad_per_s : (3,), optional
///     What the gyros measure at rest (bias and Earth rate); zero.
/// sigma_rate_rad_per_s : float, optional
///     Standard deviation of that on each axis; by default the bias of the unit.
/// normal_quantile : float, default 3.090
///     Of the threshold: that of one false alarm in a thousand windows.
///
/// Returns
/// -------
/// Statistic
///     Below its threshold it speaks for a stop.
#[pyfunction]
#[pyo3(signature = (
    detector, step_s, gyro, accel, *, window_s, config=None, stance=false, expected_rate_b_rad_per_s=None,
    sigma_rate_rad_per_s=None, normal_quantile=3.090
))]
// One argument each of the Python function.
#[allow(clippy::too_many_arguments)]
pub(crate) fn detector_statistic<'py>(
    py: Python<'py>,
    detector: &str,
    step_s: f64,
    gyro: Option<&Bound<'py, PyAny>>,
    accel: Option<&Bound<'py, PyAny>>,
    window_s: f64,
    config: Option<&Bound<'py, PyAny>>,
    stance: bool,
    expected_rate_b_rad_per_s: Option<&Bound<'py, PyAny>>,
    sigma_rate_rad_per_s: Option<f64>,
    normal_quantile: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let fail = fail(py);
    if !(step_s > 0.0 && step_s.is_finite()) {
        return Err(fail(Failure::argument(
            "bad_option",
            "step_s",
            format!("{step_s}"),
            "a positive step",
            "seconds between samples",
        )));
    }
    // Written so that NaN fails.
    if !(window_s >= 0.5 * step_s && window_s.is_finite()) {
        return Err(fail(Failure::argument(
            "bad_option",
            "window_s",
            format!("{window_s}"),
            format!("a sample of {step_s} s or more"),
            "",
        )));
    }
    let config = settings::config(config)?;
    let grade = config.imu.grade.unwrap_or(ImuGrade::Consumer);
    let noise = config.noise.over(grade);
    let rest = RestNoise::new(&config.stationary, stance, &noise);
    let expected = expected_rate_b_rad_per_s
        .map_or(Ok(Vector3::zeros()), |given| {
            Argument::new("expected_rate_b_rad_per_s", given).vector()
        })
        .map_err(fail)?;
    let sigma = sigma_rate_rad_per_s.unwrap_or(noise.gyro_bias_sigma);
    let variance = 3.0 * sigma * sigma;
    let rates = gyro
        .map(|a| Argument::new("gyro", a).finite_rows())
        .transpose()
        .map_err(fail)?;
    let forces = match (accel.map(|a| Argument::new("accel", a)), &rates) {
        (Some(accel), Some(rates)) => Some(accel.finite_vectors(rates.len())),
        (Some(accel), None) => Some(accel.finite_rows()),
        (None, _) => None,
    }
    .transpose()
    .map_err(fail)?;
    let n = rates.as_ref().or(forces.as_ref()).map_or(0, Vec::len);
    let nothing = || vec![Vector3::zeros(); n];
    let rates = rates.unwrap_or_else(nothing);
    let forces = forces.unwrap_or_else(nothing);
    let statistic: Box<dyn Fn(&Moments) -> f64 + Send> = match detector {
        "mv" => Box::new(move |m| mv::statistic(m, &rest)),
        "mag" => Box::new(move |m| mag::statistic(m, &rest)),
        "are" => Box::new(move |m| are::statistic(m, &expected, &rest)),
        "glrt" => Box::new(move |m| glrt::statistic(m, &expected, &rest)),
        other => {
            return Err(fail(Failure::unknown_word(
                "detector",
                other,
                "mv, mag, are, glrt",
            )));
        }
    };
    let window = (window_s / step_s).round().max(1.0) as usize;
    let name = detector.to_owned();
    let work = move |_: &Stop| {
        let moments = sliding_moments(step_s, &forces, &rates, window);
        // All windows have the same length, and a threshold looks at no more.
        let threshold = moments
            .first()
            .map_or(f64::NAN, |full| match name.as_str() {
                "mv" => mv::threshold(full, normal_quantile),
                "mag" => mag::threshold(full, &rest, normal_quantile),
                "are" => are::threshold(full, variance, &rest, normal_quantile),
                _ => glrt::threshold(full, variance, &rest, normal_quantile),
            });
        let before = std::iter::repeat_n(f64::NAN, n - moments.len());
        let values: Vec<f64> = before.chain(moments.iter().map(statistic)).collect();
        (values, threshold)
    };
    let (values, threshold) = interruptible(py, work)?;
    let fields = PyDict::new(py);
    fields.set_item("detector", detector)?;
    fields.set_item("value", scalars(py, values)?)?;
    fields.set_item("threshold", threshold)?;
    fields.set_item("window", window)?;
    py.import("insnav._stationary")?
        .getattr("Statistic")?
        .call((), Some(&fields))
}
