//! `[noise]` for the settings, each number with where it comes from.

use super::noise::fits_well;
use insnav_core::config::NoiseConfig;
use insnav_core::imu::{ImuNoise, STANDARD_GRAVITY};
use insnav_core::noise::{AxisStability, Known, RecordNoise, RestStability};
use std::fmt::Write as _;

/// Two estimates further apart than this many sigmas do not agree.
const AGREE: f64 = 3.0;
/// The averaging time at which a random walk of the bias stands for flicker noise, s.
const WANDER_TAU: f64 = 100.0;
/// Correlation times of a bias that make sense, s.
const SHORTEST_TAU: f64 = 100.0;
const LONGEST_TAU: f64 = 1e6;

/// What goes into the block.
pub(super) struct Told<'a> {
    pub(super) prior: &'a ImuNoise,
    pub(super) grade: &'static str,
    /// What the settings say already.
    pub(super) stated: NoiseConfig,
    pub(super) rest: Option<&'a RestStability>,
    pub(super) found: &'a RecordNoise,
}

/// One kind of estimate of a density.
struct Estimate {
    value: f64,
    error: f64,
}

/// The block, comments included.
pub(super) fn block(told: &Told<'_>) -> String {
    let mut text = String::from("[noise]\n");
    let tilt = &told.found.tilt;
    let gyro = told.rest.map(|r| &r.gyro);
    let accel = told.rest.map(|r| &r.accel);
    let stated = told.stated;
    density(
        &mut text,
        &Density {
            key: "gyro_arw_deg_per_sqrt_hour",
            what: "gyro white noise",
            unit: 60.0_f64.to_degrees(),
            prior: told.prior.gyro_white,
            before: before(told, stated.gyro_arw_deg_per_sqrt_hour),
            allan: gyro.map(|axes| white(axes, tilt.axes_seen)),
            als: &tilt.gyro_white,
        },
    );
    density(
        &mut text,
        &Density {
            key: "accel_vrw_m_per_s_per_sqrt_hour",
            what: "accelerometer white noise",
            unit: 60.0,
            prior: told.prior.accel_white,
            before: before(told, stated.accel_vrw_m_per_s_per_sqrt_hour),
            allan: accel.map(|axes| white(axes, tilt.axes_seen)),
            als: &tilt.accel_white,
        },
    );
    let bias_before = before(told, stated.gyro_bias_deg_per_hour);
    let _ = writeln!(
        text,
        "# gyro bias at power-on: no record tells it; {bias_before}"
    );
    let sigma = told.prior.gyro_bias_sigma;
    line(
        &mut text,
        "gyro_bias_deg_per_hour",
        sigma.to_degrees() * 3600.0,
    );
    tau(
        &mut text,
        &Tau {
            key: "gyro_bias_tau_s",
            sigma,
            prior: told.prior.gyro_bias_tau,
            before: before(told, stated.gyro_bias_tau_s),
            axes: gyro,
            unit: 1.0_f64.to_degrees() * 3600.0,
            name: "°/h",
            als: Some(&told.found.gyro_bias.wander),
        },
    );
    let bias_before = before(told, stated.accel_bias_mg);
    let _ = writeln!(
        text,
        "# accelerometer bias: no record in one position tells it; {bias_before}"
    );
    let sigma = told.prior.accel_bias_sigma;
    line(&mut text, "accel_bias_mg", sigma / STANDARD_GRAVITY * 1e3);
    tau(
        &mut text,
        &Tau {
            key: "accel_bias_tau_s",
            sigma,
            prior: told.prior.accel_bias_tau,
            before: before(told, stated.accel_bias_tau_s),
            axes: accel,
            unit: 1e3 / STANDARD_GRAVITY,
            name: "mg",
            als: None,
        },
    );
    if let Some(heading) = &told.found.heading {
        let noise = &heading.magnetometer;
        if noise.accepted {
            let _ = writeln!(
                text,
                "# magnetometer, one sample: {} µT by least squares over {} windows; for attitude filters, a run does not use it",
                with_error(noise.value * 1e6, noise.standard_error * 1e6),
                heading.windows
            );
            line(&mut text, "magnetometer_microtesla", noise.value * 1e6);
        } else {
            let _ = writeln!(text, "# magnetometer: {}", gist(&noise.reason));
        }
    }
    text
}

fn before(told: &Told<'_>, stated: Option<f64>) -> String {
    match stated {
        Some(_) => "kept as the settings have it".into(),
        None => format!("kept as of the class {}", told.grade),
    }
}

/// Allan's densities: of all axes, and of those that least squares saw.
struct Both {
    all: Estimate,
    seen: Estimate,
}

/// One density of several axes: the root of the mean square, if all axes fit.
fn white(axes: &[AxisStability; 3], seen: [f64; 3]) -> Option<Both> {
    if !axes.iter().all(fits_well) || axes.iter().any(|a| a.fit.white.value <= 0.0) {
        return None;
    }
    let mean = |weights: [f64; 3]| {
        let total: f64 = weights.iter().sum();
        let pairs = axes
            .iter()
            .zip(weights)
            .map(|(a, w)| (a.fit.white, w / total));
        let square: f64 = pairs.clone().map(|(n, w)| w * n.value.powi(2)).sum();
        let value = square.sqrt();
        let error: f64 = pairs
            .map(|(n, w)| (w * n.value * n.standard_error).powi(2))
            .sum();
        Estimate {
            value,
            error: error.sqrt() / value,
        }
    };
    let any = seen.iter().sum::<f64>() > 0.0;
    Some(Both {
        all: mean([1.0; 3]),
        seen: mean(if any { seen } else { [1.0; 3] }),
    })
}

/// The gist of a reason.
fn gist(reason: &str) -> &str {
    reason.split(" (").next().unwrap_or(reason)
}

struct Density<'a> {
    key: &'static str,
    what: &'static str,
    /// Factor to the unit of the key.
    unit: f64,
    prior: f64,
    before: String,
    /// `Some(None)`: an Allan deviation that is not of the three kinds of noise.
    allan: Option<Option<Both>>,
    als: &'a Known,
}

fn density(text: &mut String, d: &Density<'_>) {
    let show = |e: &Estimate| {
        format!(
            "{} ± {}",
            digits(e.value * d.unit),
            digits(e.error * d.unit)
        )
    };
    let als = d.als.accepted.then_some(Estimate {
        value: d.als.value,
        error: d.als.standard_error,
    });
    let (value, why) = match (&d.allan, als) {
        (Some(Some(Both { all, seen })), Some(als)) => {
            let same = (all.value - seen.value).abs() <= 0.005 * all.value;
            let of_seen = if same {
                String::new()
            } else {
                format!(" ({} of the axes that were level)", show(seen))
            };
            let both = format!(
                "{}{of_seen} by Allan deviation, {} by least squares",
                show(all),
                show(&als)
            );
            if (seen.value - als.value).abs() <= AGREE * seen.error.hypot(als.error) {
                // What Allan's has of the other axes goes with either.
                if seen.error <= als.error {
                    (
                        all.value,
                        format!("{both}: they agree, Allan's is the surer one"),
                    )
                } else {
                    (
                        als.value * all.value / seen.value,
                        format!("{both}: they agree, that of least squares is the surer one"),
                    )
                }
            } else if all.value >= als.value {
                (
                    all.value,
                    format!(
                        "{both}: they differ, the larger one, since a filter that trusts too much is worse"
                    ),
                )
            } else {
                (
                    als.value,
                    format!(
                        "{both}: they differ, the larger one, which a filter sees at its own time constant"
                    ),
                )
            }
        }
        (Some(Some(Both { all, .. })), None) => (
            all.value,
            format!(
                "{} by Allan deviation; least squares: {}",
                show(all),
                gist(&d.als.reason)
            ),
        ),
        (Some(None), Some(als)) => (
            als.value,
            format!(
                "{} by least squares; the Allan deviation is not that of white noise, flicker noise and random walk",
                show(&als)
            ),
        ),
        (None, Some(als)) => (
            als.value,
            format!(
                "{} by least squares; no Allan deviation without a long rest",
                show(&als)
            ),
        ),
        (_, None) => (
            d.prior,
            format!("{}; least squares: {}", d.before, gist(&d.als.reason)),
        ),
    };
    let _ = writeln!(text, "# {}: {why}", d.what);
    line(text, d.key, value * d.unit);
}

struct Tau<'a> {
    key: &'static str,
    sigma: f64,
    prior: f64,
    before: String,
    axes: Option<&'a [AxisStability; 3]>,
    /// Factor of the bias to the unit that is shown.
    unit: f64,
    name: &'static str,
    als: Option<&'a Known>,
}

/// Correlation time with which a bias of this sigma wanders as the Allan deviation shows: K, and B as the random walk that has its
/// deviation at 100 s.
fn tau(text: &mut String, t: &Tau<'_>) {
    let seen = |axis: &AxisStability| {
        let term = |value: f64, error: f64| if value > 2.0 * error { value } else { 0.0 };
        let b = term(axis.fit.flicker.value, axis.fit.flicker.standard_error);
        let k = term(
            axis.fit.random_walk.value,
            axis.fit.random_walk.standard_error,
        );
        let flicker = 2.0 * std::f64::consts::LN_2 / std::f64::consts::PI * b * b;
        (b, k, k * k + 3.0 * flicker / WANDER_TAU)
    };
    let mut of_als = String::new();
    if let Some(known) = t.als
        && !known.accepted
    {
        of_als = "; least squares do not tell it".into();
    }
    let mean = t.axes.and_then(|axes| {
        let all: Vec<(f64, f64, f64)> = axes.iter().filter(|a| fits_well(a)).map(seen).collect();
        let wander = all.iter().map(|a| a.2).sum::<f64>() / all.len().max(1) as f64;
        let rms = |of: &dyn Fn(&(f64, f64, f64)) -> f64| {
            (all.iter().map(|a| of(a).powi(2)).sum::<f64>() / all.len().max(1) as f64).sqrt()
        };
        (wander > 0.0).then(|| (rms(&|a| a.0), rms(&|a| a.1), wander))
    });
    match mean {
        Some((b, k, wander)) => {
            let tau = (2.0 * t.sigma * t.sigma / wander).clamp(SHORTEST_TAU, LONGEST_TAU);
            let _ = writeln!(
                text,
                "# its wander as a correlation time for this sigma, by Allan deviation: flicker noise B {} {name}, random walk K {} {name}/√s{of_als}",
                significant(b * t.unit),
                significant(k * t.unit),
                name = t.name
            );
            line(text, t.key, tau);
        }
        None => {
            let why = match t.axes {
                None => "no long rest shows it",
                Some(_) => "the Allan deviation does not show it",
            };
            let _ = writeln!(text, "# its wander: {why}{of_als}; {}", t.before);
            line(text, t.key, t.prior);
        }
    }
}

fn line(text: &mut String, key: &str, value: f64) {
    let _ = writeln!(text, "{key} = {}", digits(value));
}

/// A value and its error, both to the second digit of the error.
fn with_error(value: f64, error: f64) -> String {
    let decimals = (1.0 - error.abs().max(1e-12).log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{value:.decimals$} ± {error:.decimals$}")
}

/// Three significant digits.
fn significant(value: f64) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let decimals = (2.0 - value.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{value:.decimals$}")
}

/// Four significant digits, as TOML reads them.
fn digits(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return "0.0".into();
    }
    let digits = 3.0 - value.abs().log10().floor();
    if digits < 0.0 {
        let unit = 10f64.powf(-digits);
        return format!("{:.1}", (value / unit).round() * unit);
    }
    let decimals = digits.clamp(1.0, 15.0) as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits_and_a_point() {
        let got: Vec<String> = [2.517_8, 0.000_123_456, 20_283.0, 150.04, 0.0]
            .map(digits)
            .into();
        assert_eq!(got, ["2.518", "0.0001235", "20280.0", "150.0", "0.0"]);
    }
}
