//! An alignment, for people.

use insnav_log::{AlignReport, AlignedStop, LatitudeSource};
use std::fmt::Write as _;
use std::path::Path;

/// The report of `align`.
pub(crate) fn aligned(log: &Path, r: &AlignReport) -> String {
    let source = match r.latitude_source {
        LatitudeSource::Given => "given",
        LatitudeSource::Settings => "output.origin",
        LatitudeSource::Fixes => "median of the fixes",
    };
    let mut text = format!(
        "{}: aligned by {} ({}), latitude {:.4}° ({source}), from {}\n",
        log.display(),
        r.method.replace('_', " "),
        r.reason,
        r.latitude_deg,
        r.input,
    );
    let mut line = |name: &str, what: String| {
        let _ = writeln!(text, "  {name:<12} {what}");
    };
    line("at", format!("{:.3} s", r.at_s));
    line("roll", angle(r.roll_deg, r.sigma_roll_deg));
    line("pitch", angle(r.pitch_deg, r.sigma_pitch_deg));
    line(
        "heading",
        match r.heading_deg {
            Some(heading) => angle(heading, r.sigma_heading_deg),
            None if r.sigma_heading_deg < 180.0 => format!(
                "not found: with this unit and these stops it would have ± {:.1}°",
                r.sigma_heading_deg
            ),
            None => "not found: with this unit and these stops it could be any".to_owned(),
        },
    );
    if let (Some(azimuth), Some(begin)) = (r.azimuth_deg, r.azimuth_at_s) {
        line("azimuth", format!("{azimuth:.4}° at {begin:.3} s"));
    }
    let gyro = |x: f64| x.to_degrees() * 3600.0;
    let accel = |x: f64| x / 9.806_65e-6;
    line(
        "gyro drift",
        biases(
            "°/h",
            r.gyro_bias_rad_per_s.map(gyro),
            r.sigma_gyro_bias_rad_per_s.map(gyro),
            r.observable.gyro_bias,
        ),
    );
    line(
        "accel bias",
        biases(
            "µg",
            r.accel_bias_m_per_s2.map(accel),
            r.sigma_accel_bias_m_per_s2.map(accel),
            r.observable.accel_bias,
        ),
    );
    let seen = r
        .observable
        .gyro_bias
        .iter()
        .chain(&r.observable.accel_bias);
    if seen.into_iter().any(|seen| !seen) {
        line(
            "(not seen)",
            "the stops say no more of it than was known of the unit beforehand".to_owned(),
        );
    }
    if r.heading_deg.is_some() {
        let w = r.weakest_direction;
        line(
            "weakest",
            format!(
                "azimuth {:+.2}, drift north {:+.2} east {:+.2} down {:+.2}: told {:.2} as well as by far-apart positions",
                w.azimuth, w.drift_ned[0], w.drift_ned[1], w.drift_ned[2], r.geometry_ratio
            ),
        );
    }
    if let Some([value, sigma]) = r.norm_residual {
        line(
            "earth rate",
            format!(
                "horizontal part {value:+.1e} ± {sigma:.1e} of itself off that of the latitude"
            ),
        );
    }
    line(
        "noise",
        format!(
            "{:.4} °/√h, {:.4} m/s/√h; biases beforehand ± {} °/h, ± {} mg ({})",
            r.noise.gyro_arw_deg_per_sqrt_hour,
            r.noise.accel_vrw_m_per_s_per_sqrt_hour,
            r.noise.gyro_bias_deg_per_hour,
            r.noise.accel_bias_mg,
            r.noise.grade
        ),
    );
    for stop in &r.stops {
        line("stop", one(stop));
    }
    if r.stops_proposed {
        let flags: Vec<String> = r
            .stops
            .iter()
            .map(|s| format!("--stop {:.2}:{:.2}", s.begin_s, s.end_s))
            .collect();
        line("to state it", flags.join(" "));
    }
    text.truncate(text.trim_end().len());
    text
}

fn angle(value: f64, sigma: f64) -> String {
    // As many digits as the sigma has.
    let decimals = (1.0 - sigma.abs().max(1e-7).log10().floor()).clamp(2.0, 7.0) as usize;
    format!("{value:.decimals$}° ± {sigma:.decimals$}")
}

fn biases(unit: &str, values: [f64; 3], sigmas: [f64; 3], observable: [bool; 3]) -> String {
    let part = |i: usize| {
        let decimals = (1.0 - sigmas[i].abs().max(1e-7).log10().floor()).clamp(0.0, 7.0) as usize;
        let seen = if observable[i] { "" } else { " (not seen)" };
        format!("{:.decimals$} ± {:.decimals$}{seen}", values[i], sigmas[i])
    };
    format!("{}, {}, {} {unit}", part(0), part(1), part(2))
}

fn one(stop: &AlignedStop) -> String {
    let length = stop.end_s - stop.begin_s;
    let span = format!("{:.2} to {:.2} s ({length:.1} s)", stop.begin_s, stop.end_s);
    let Some(seen) = &stop.seen else { return span };
    let rocking = seen.rocking_rms_deg.into_iter().fold(0.0, f64::max);
    let period = seen
        .rocking_period_s
        .map_or(String::new(), |p| format!(" at {p:.1} s"));
    format!(
        "{span}: rocks {rocking:.4}° rms{period}, velocity {:.2e} m/s rms, halves differ {:.1} sigmas, weights {}",
        seen.velocity_rms_m_per_s,
        seen.half_disagreement_sigma,
        seen.taper.replace('_', " ")
    )
}
