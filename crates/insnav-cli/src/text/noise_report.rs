//! The noise of a log, for people.

use super::{plural, span};
use insnav_log::{Als, Fits, Identified, LogNoise, WithError};
use std::fmt::Write as _;
use std::path::Path;

/// rad/√s in °/√h, rad/s in °/h, m/s² in µg.
const ARW: f64 = 60.0 * 180.0 / std::f64::consts::PI;
const PER_HOUR: f64 = 3600.0 * 180.0 / std::f64::consts::PI;
const MICRO_G: f64 = 1e6 / 9.806_65;
/// Averaging times of the table, s.
const SHOWN: [f64; 5] = [0.1, 1.0, 10.0, 100.0, 1000.0];

/// The report of `noise`.
pub(crate) fn noise_report(log: &Path, r: &LogNoise, windows: bool) -> String {
    let mut text = format!(
        "{}: {} inertial samples at {:.1} Hz\n",
        log.display(),
        r.samples,
        1.0 / r.step_s
    );
    allan(&mut text, r);
    als(&mut text, r, windows);
    let _ = write!(
        text,
        "\nFor the settings (`insnav run -c FILE`):\n\n{}",
        r.config
    );
    text
}

fn allan(text: &mut String, r: &LogNoise) {
    text.push_str("\nAllan deviation at rest");
    if let (Some(begin), Some(end)) = (r.allan.begin_s, r.allan.end_s) {
        let _ = write!(
            text,
            ", from {begin:.1} to {end:.1} s ({})",
            span(end - begin)
        );
    }
    text.push('\n');
    if let Some(missing) = &r.allan.missing {
        let _ = writeln!(text, "  missing: {missing}");
    }
    let Some(fit) = &r.fit else { return };
    let _ = writeln!(
        text,
        "  {:>9}  {:>26}  {:>26}",
        "averaged", "gyro x, y, z (°/h)", "accelerometer (µg)"
    );
    let nearest = |tau: f64| {
        let off = |i: &usize| (r.allan.gyro[*i].tau_s / tau).ln().abs();
        (0..r.allan.gyro.len())
            .min_by(|a, b| off(a).total_cmp(&off(b)))
            .filter(|i| off(i) < 0.3)
    };
    for i in SHOWN.into_iter().filter_map(nearest) {
        let (gyro, accel) = (&r.allan.gyro[i], &r.allan.accel[i]);
        let _ = writeln!(
            text,
            "  {:>7} s  {:>26}  {:>26}",
            significant(gyro.tau_s),
            three(gyro.deviation_rad_per_s.map(|d| d * PER_HOUR)),
            three(accel.deviation_m_per_s2.map(|d| d * MICRO_G)),
        );
    }
    fits(text, fit);
}

fn fits(text: &mut String, fit: &Fits) {
    let _ = writeln!(text, "  fit ± one sigma{:>10}{:>22}{:>22}", "x", "y", "z");
    let mut row = |name: &str, values: [WithError; 3], unit: f64| {
        let part = |v: WithError| {
            if v.value > 0.0 {
                let (value, error) = pair(v.value * unit, v.standard_error * unit);
                format!("{value} ± {error}")
            } else {
                format!("not seen, < {}", significant(2.0 * v.standard_error * unit))
            }
        };
        let [x, y, z] = values.map(part);
        let _ = writeln!(text, "  {name:<24}{x:>20}  {y:>20}  {z:>20}");
    };
    let gyro = |of: fn(&insnav_log::GyroFit) -> WithError| -> [WithError; 3] {
        std::array::from_fn(|k| of(&fit.gyro[k]))
    };
    let accel = |of: fn(&insnav_log::AccelFit) -> WithError| -> [WithError; 3] {
        std::array::from_fn(|k| of(&fit.accel[k]))
    };
    row("gyro N, °/√h", gyro(|g| g.white_rad_per_sqrt_s), ARW);
    row("gyro B, °/h", gyro(|g| g.flicker_rad_per_s), PER_HOUR);
    row(
        "gyro K, °/h/√s",
        gyro(|g| g.random_walk_rad_per_s_per_sqrt_s),
        PER_HOUR,
    );
    row(
        "accel N, m/s/√h",
        accel(|a| a.white_m_per_s_per_sqrt_s),
        60.0,
    );
    row("accel B, µg", accel(|a| a.flicker_m_per_s2), MICRO_G);
    row(
        "accel K, µg/√s",
        accel(|a| a.random_walk_m_per_s2_per_sqrt_s),
        MICRO_G,
    );
    let chi2 = |pairs: Vec<(f64, usize)>| -> String {
        let parts: Vec<String> = pairs
            .into_iter()
            .map(|(chi2, dof)| format!("{:.1}", chi2 / dof.max(1) as f64))
            .collect();
        parts.join(", ")
    };
    let _ = writeln!(
        text,
        "  χ²/dof of the fits: gyro {}; accelerometer {} (above 3: not of these three kinds of noise)",
        chi2(fit.gyro.iter().map(|g| (g.chi2, g.dof)).collect()),
        chi2(fit.accel.iter().map(|a| (a.chi2, a.dof)).collect()),
    );
}

fn als(text: &mut String, r: &LogNoise, windows: bool) {
    let als = &r.als;
    let used = als.windows.iter().filter(|w| w.accepted).count();
    let _ = writeln!(
        text,
        "\nAutocovariance least squares: {used} of {} of about {} used{}",
        plural(als.windows.len(), "window"),
        span(als.window_s),
        if als.averaged > 1 {
            format!(" ({} samples averaged into one)", als.averaged)
        } else {
            String::new()
        }
    );
    let common = als
        .windows
        .iter()
        .all(|w| !w.accepted)
        .then_some(als.reason.as_str());
    if let Some(reason) = common {
        let _ = writeln!(text, "  nothing told: {reason}");
    }
    let mut line = |name: &str, what: &Identified, unit: f64, name_of_unit: &str| {
        let value = match what.standard_error {
            Some(error) if what.accepted => {
                let (value, error) = pair(what.value * unit, error * unit);
                format!("{value} ± {error} {name_of_unit}")
            }
            _ if !what.value.is_finite() => what.reason.clone(),
            _ => {
                let kept = format!(
                    "kept at {} {name_of_unit} as it was known",
                    significant(what.value * unit)
                );
                match common {
                    Some(_) => kept,
                    None => format!("{kept}: {}", what.reason),
                }
            }
        };
        let _ = writeln!(text, "  {name:<24}{value}");
    };
    line(
        "gyro white noise",
        &als.gyro_white_rad_per_sqrt_s,
        ARW,
        "°/√h",
    );
    line(
        "accelerometer",
        &als.accel_white_m_per_s_per_sqrt_s,
        60.0,
        "m/s/√h",
    );
    line(
        "as tilt of one sample",
        &als.tilt_white_rad_sqrt_s,
        (als.r / als.tilt_white_rad_sqrt_s.value.powi(2))
            .sqrt()
            .to_degrees(),
        "°",
    );
    if let Some(heading) = &als.heading {
        line(
            "magnetometer, a sample",
            &heading.magnetometer_microtesla,
            1.0,
            "µT",
        );
    }
    line(
        "gyro bias, random walk",
        &als.gyro_bias_walk_rad_per_s_per_sqrt_s,
        PER_HOUR,
        "°/h/√s",
    );
    if let Some(chi2) = als.chi2 {
        let _ = writeln!(
            text,
            "  {:<24}χ²/dof {:.2} over {} lags of {:.3} s, all windows together (at most 3 fits)",
            "test of the model",
            chi2 / als.dof.max(1) as f64,
            als.lags,
            als.averaged as f64 * r.step_s,
        );
    }
    if !als.tones_hz.is_empty() {
        let tones: Vec<String> = als.tones_hz.iter().map(|f| significant(*f)).collect();
        let _ = writeln!(
            text,
            "  {:<24}{} Hz in the accelerometers, no noise of theirs (machines, mains, aliases of them)",
            "tones taken out",
            tones.join(", ")
        );
    }
    let intervals: Vec<String> = als
        .accepted_intervals_s
        .iter()
        .map(|[begin, end]| format!("{begin:.1} to {end:.1}"))
        .collect();
    if !intervals.is_empty() {
        let shown = intervals.len().min(8);
        let more = intervals.len() - shown;
        let _ = writeln!(
            text,
            "  {:<24}{} s{}",
            "used",
            intervals[..shown].join(", "),
            if more > 0 {
                format!(" and {more} more")
            } else {
                String::new()
            }
        );
    }
    if windows {
        for w in &als.windows {
            let number =
                |x: Option<f64>, unit: f64| x.map_or_else(|| "–".into(), |x| significant(x * unit));
            let _ = writeln!(
                text,
                "  {:>8.1} to {:>8.1} s  {:>8} °/√h  χ²/dof {:>6}  {}",
                w.begin_s,
                w.end_s,
                number(w.gyro_white_rad_per_sqrt_s, ARW),
                w.chi2_per_dof
                    .map_or_else(|| "–".into(), |x| format!("{x:.2}")),
                if w.accepted { "used" } else { &w.reason }
            );
        }
    } else {
        left_out(text, als);
    }
}

/// Why windows are left out, by kind.
fn left_out(text: &mut String, als: &Als) {
    let mut kinds: Vec<&str> = als
        .windows
        .iter()
        .filter(|w| !w.accepted)
        .map(|w| {
            let general = w.reason.split(" (").next().unwrap_or(&w.reason);
            if general.starts_with("shows ") {
                "more gyro noise than the quietest windows: slow acceleration or motion that passes for it"
            } else if general.starts_with("the mean specific force") {
                "the mean specific force is not gravity"
            } else {
                general
            }
        })
        .collect();
    kinds.sort_unstable();
    for kind in kinds.chunk_by(|a, b| a == b) {
        let _ = writeln!(text, "  {:<24}{}: {}", "left out", kind.len(), kind[0]);
    }
}

fn three(values: [f64; 3]) -> String {
    values.map(significant).join(", ")
}

/// Three significant digits in ordinary notation.
fn significant(x: f64) -> String {
    if !x.is_finite() || x == 0.0 {
        return if x == 0.0 { "0".into() } else { "–".into() };
    }
    let decimals = (2.0 - x.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    format!("{x:.decimals$}")
}

/// A value and its error, both to the second digit of the error.
fn pair(value: f64, error: f64) -> (String, String) {
    if !(error > 0.0 && error.is_finite()) {
        return (significant(value), "–".into());
    }
    let decimals = (1.0 - error.log10().floor()).clamp(0.0, 12.0) as usize;
    (format!("{value:.decimals$}"), format!("{error:.decimals$}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_the_digits_of_their_errors() {
        assert_eq!(pair(2.518_3, 0.012_4), ("2.518".into(), "0.012".into()));
        assert_eq!(pair(25.3, 11.0), ("25".into(), "11".into()));
        assert_eq!(significant(0.000_123_4), "0.000123");
        assert_eq!(significant(147.3), "147");
    }
}
