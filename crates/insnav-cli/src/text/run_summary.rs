//! What a run did, on one screen.

use super::{entry, maybe, plural, short, some, span, way};
use crate::command::Outcome;
use insnav_core::alignment::HeadingSource;
use insnav_core::stationary::StopEnd;
use insnav_log::{
    AdaptedReport, AlignmentReport, Estimate, ImuOnlyReport, RunReport, ScaleReport, StopReport,
};

/// The summary of a run.
pub(crate) fn run_summary(outcome: &Outcome) -> String {
    let r = &outcome.report;
    let mut text = format!(
        "{} → {}\n",
        outcome.input.display(),
        outcome.output.display()
    );
    for path in &outcome.also {
        text.push_str(&format!("  also → {}\n", path.display()));
    }
    let mut add = |label, line: String| text.push_str(&entry(label, &line));
    add("drive", drive(r));
    add("imu", imu(r));
    if !r.noise_adaptation.is_empty() {
        add("adapted", adapted(&r.noise_adaptation));
    }
    if let Some(only) = &r.imu_only {
        add("no gnss", imu_only(only));
    } else {
        add("clocks", clocks(r));
    }
    if let Some(a) = &r.alignment {
        add("start", alignment(a));
    }
    if !r.stops.is_empty() {
        add("stops", stops(&r.stops));
    }
    let width = r.aiding.iter().map(|a| a.name.len()).max().unwrap_or(0);
    for (i, a) in r.aiding.iter().enumerate() {
        let line = format!(
            "{:<width$}  {:>6} used, {} inflated, {} rejected{}{}; NIS/dof {}{}",
            a.name,
            a.used,
            a.inflated,
            a.rejected,
            some(a.frozen, "frozen"),
            some(a.reset, "taken over"),
            maybe(a.nis_mean),
            if i == 0 {
                " (1 when the stated noise is right)"
            } else {
                ""
            }
        );
        add(if i == 0 { "aiding" } else { "" }, line);
    }
    if r.imu_only.is_none() {
        add("gnss sigmas", sigma_scales(r));
    }
    if r.withheld > 0 {
        add(
            "withheld",
            format!(
                "{} kept from the filter, in the output for `insnav compare`",
                plural(r.withheld, "position")
            ),
        );
    }
    if let Some(l) = &r.last {
        add(
            "at the end",
            format!(
                "{:.7}°, {:.7}°, {:.2} m; roll {:.2}°, pitch {:.2}°, heading {:.2}°\n\
                 sigmas: position {} m horizontal, {} m vertical; velocity {} m/s; level {}°, heading {}°\n\
                 gyro bias {} °/h, accelerometer bias {} mg",
                l.latitude_deg,
                l.longitude_deg,
                l.height_m,
                l.roll_deg,
                l.pitch_deg,
                l.heading_deg,
                short(l.sigma_horizontal_m),
                short(l.sigma_height_m),
                short(l.sigma_velocity_m_per_s),
                short(l.sigma_level_deg),
                short(l.sigma_heading_deg),
                with_sigmas(&l.gyro_bias_deg_per_hour, &l.sigma_gyro_bias_deg_per_hour),
                with_sigmas(&l.accel_bias_mg, &l.sigma_accel_bias_mg),
            ),
        );
    }
    if let Some(l) = &r.last
        && let (Some(horizontal), Some(height)) = (l.closure_horizontal_m, l.closure_height_m)
    {
        add(
            "closure",
            format!("{horizontal:.2} m from the start, {height:+.2} m in height"),
        );
    }
    add(
        "warnings",
        if r.warnings.is_empty() {
            "none".into()
        } else {
            format!("{}, on standard error", r.warnings.len())
        },
    );
    text
}

/// So many stops are listed.
const MOST_STOPS: usize = 20;

/// A line a stop.
fn stops(stops: &[StopReport]) -> String {
    let mut text = format!(
        "{:>9} {:>7} {:>9} {:>8} {:>7} {:>13} {:>16}  ended by",
        "begin s", "for s", "heading °", "change °", "± °", "growth held °", "bias z °/h"
    );
    for s in stops.iter().take(MOST_STOPS) {
        let bias = format!(
            "{} ± {}",
            short(s.gyro_bias_deg_per_hour[2]),
            short(s.sigma_gyro_bias_deg_per_hour[2])
        );
        text.push_str(&format!(
            "\n{:>9.1} {:>7.1} {:>9.2} {:>8} {:>7} {:>13} {bias:>16}  {}",
            s.begin_s,
            s.end_s - s.begin_s,
            s.heading_before_deg,
            unsigned_zero(s.heading_change_deg(), 3),
            short(s.sigma_heading_deg),
            unsigned_zero(s.heading_growth_deg, 4),
            match s.ended_by {
                StopEnd::Motion => "motion",
                StopEnd::Withdrawn => "who declared it",
                StopEnd::Contradicted => "contradiction",
                StopEnd::Gap => "gap",
                StopEnd::End => "end of data",
            }
        ));
        if s.pieces > 1 {
            text.push_str(&format!(", in {} pieces", s.pieces));
        }
    }
    if stops.len() > MOST_STOPS {
        let more = stops.len() - MOST_STOPS;
        text.push_str(&format!("\nand {more} more, in `--format json`"));
    }
    text
}

/// With so many decimals, and no sign before a zero.
fn unsigned_zero(x: f64, decimals: usize) -> String {
    let text = format!("{x:.decimals$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.chars().all(|c| matches!(c, '0' | '.')) => zero.to_owned(),
        _ => text,
    }
}

/// What a run without GNSS counts from.
fn imu_only(only: &ImuOnlyReport) -> String {
    let told = if only.latitude_assumed {
        "assumed: `--latitude-deg` tells it"
    } else {
        "as given"
    };
    let mut text = format!(
        "positions and their sigmas count from the start; latitude {}° ({told})",
        short(only.latitude_deg)
    );
    if !only.gnss_left_out.is_empty() {
        text.push_str(&format!("\nnot used: {}", only.gnss_left_out.join(", ")));
    }
    text
}

/// What was done about stated sigmas.
fn sigma_scales(r: &RunReport) -> String {
    let part = |what: &str, s: &ScaleReport| {
        let how = if s.learnt { "learnt" } else { "as set" };
        let (h, v) = (short(s.horizontal), short(s.vertical));
        if s.horizontal == s.vertical {
            format!("{what} as stated × {h} ({how})")
        } else {
            format!("{what} as stated × {h} horizontal, {v} vertical ({how})")
        }
    };
    format!(
        "{}; {}",
        part("position", &r.gnss_sigma_scale),
        part("velocity", &r.gnss_velocity_sigma_scale)
    )
}

fn drive(r: &RunReport) -> String {
    let standing: f64 = r.stops.iter().map(|s| s.end_s - s.begin_s).sum();
    let stops = if r.stops.is_empty() {
        "no stop".to_owned()
    } else {
        format!(
            "{} ({standing:.0} s together)",
            plural(r.stops.len(), "stop")
        )
    };
    let stances = r
        .stances
        .map_or(String::new(), |n| format!(", {}", plural(n, "stance")));
    let speed = r.duration_s / r.elapsed_s.max(1e-9);
    format!(
        "{}, {}, {stops}{stances}; {} IMU samples in {:.2} s ({speed:.0} × real time)",
        span(r.duration_s),
        way(r.distance_m),
        r.imu_samples,
        r.elapsed_s
    )
}

fn imu(r: &RunReport) -> String {
    let grade = r.imu_grade.name();
    let [x, y, z] = r.lever_arm_b_m;
    let arm = format!(
        "antenna at ({}, {}, {}) m forward, right, down of the IMU",
        short(x),
        short(y),
        short(z)
    );
    let arm = match (&r.imu_mounting, &r.imu_only) {
        (Some(mounting), None) => format!("\n{mounting}\n{arm}"),
        (Some(mounting), Some(_)) => format!("\n{mounting}"),
        (None, None) => format!("\n{arm}"),
        (None, Some(_)) => String::new(),
    };
    let (gyro, accel) = (
        short(r.gyro_arw_deg_per_sqrt_hour),
        short(r.accel_vrw_m_per_s_per_sqrt_hour),
    );
    let noise = format!("white noise {gyro} °/√h and {accel} m/s/√h");
    let at_rest = match (
        r.rest_gyro_arw_deg_per_sqrt_hour,
        r.rest_accel_vrw_m_per_s_per_sqrt_hour,
    ) {
        (Some(gyro), Some(accel)) => [gyro, accel],
        _ => [
            r.gyro_arw_deg_per_sqrt_hour,
            r.accel_vrw_m_per_s_per_sqrt_hour,
        ],
    };
    if !r.imu_grade_picked {
        return format!(
            "{grade} grade, as set; {noise}, at rest {} and {}{arm}",
            short(at_rest[0]),
            short(at_rest[1])
        );
    }
    let source = if r.imu_noise.is_some() {
        "picked from the log's own noise"
    } else {
        "assumed, since the log is too short to tell"
    };
    // All that follows is TOML, to be copied as it stands.
    let arm = arm.replace('\n', "\n# ");
    format!(
        "{grade} grade, {source}; to state it:\n[imu]\ngrade = \"{grade}\"\n[noise]\n\
         gyro_arw_deg_per_sqrt_hour = {:.3}\naccel_vrw_m_per_s_per_sqrt_hour = {:.3}\n\
         [stationary]\ngyro_arw_deg_per_sqrt_hour = {:.3}\naccel_vrw_m_per_s_per_sqrt_hour = {:.3}{arm}",
        r.gyro_arw_deg_per_sqrt_hour, r.accel_vrw_m_per_s_per_sqrt_hour, at_rest[0], at_rest[1]
    )
}

/// Noises that were to be adapted, and the test of fit that is common to all.
fn adapted(numbers: &[AdaptedReport]) -> String {
    let same = |n: &AdaptedReport| n.reason.is_some() && n.reason == numbers[0].reason;
    let common = numbers.len() > 1 && numbers.iter().all(same);
    let line = |n: &AdaptedReport| {
        let estimate = match (n.estimate, n.standard_error) {
            (Some(x), Some(sigma)) => format!("{} ± {}", short(x), short(sigma)),
            _ => "no estimate".into(),
        };
        let why = match &n.reason {
            Some(reason) if !common => format!(": {reason}"),
            _ => String::new(),
        };
        let (name, prior, verdict) = (n.name, short(n.prior), n.verdict);
        format!("{name} {prior} → {estimate}, {verdict}{why}\n")
    };
    let mut text: String = numbers.iter().map(line).collect();
    let first = &numbers[0];
    text += &match &first.reason {
        Some(reason) if common => reason.clone(),
        _ => format!("chi2/dof {:.1}", first.chi2 / first.dof.max(1) as f64),
    };
    text
}

fn clocks(r: &RunReport) -> String {
    let part = |what: &str, used: &Estimate, found: &Option<Estimate>| {
        let sigma = |e: &Estimate| {
            e.sigma
                .map_or(String::new(), |s| format!(" ± {}", short(s)))
        };
        let found = found.map_or(String::new(), |f| {
            format!(" (the data say {}{}; not used)", short(f.value), sigma(&f))
        });
        format!("{what} {}{} s{found}", short(used.value), sigma(used))
    };
    format!(
        "{}; {}",
        part(
            "added to IMU stamps",
            &r.time_offset_s,
            &r.time_offset_found_s
        ),
        part(
            "GNSS velocity behind its position",
            &r.gnss_velocity_lag_s,
            &r.gnss_velocity_lag_found_s
        )
    )
}

fn alignment(a: &AlignmentReport) -> String {
    let level = if a.standing_s > 0.0 {
        format!("{:.1} s of standing", a.standing_s)
    } else {
        "motion".into()
    };
    let source = match a.heading_source {
        HeadingSource::CourseVelocity => format!(
            "from the course of GNSS velocity at {:.1} s",
            a.heading_at_s
        ),
        HeadingSource::CoursePosition => format!(
            "from the course of GNSS positions at {:.1} s",
            a.heading_at_s
        ),
        HeadingSource::Given => "as given".into(),
        HeadingSource::Gyrocompass => "from the Earth's rate, before the stop refines it".into(),
        HeadingSource::Antenna => format!("from the antennas at {:.1} s", a.heading_at_s),
        HeadingSource::MovingBase => format!(
            "from GNSS velocities and specific force up to {:.1} s",
            a.heading_at_s
        ),
        HeadingSource::Magnetic => "from the magnetometer".into(),
        HeadingSource::Unknown => "not known".into(),
        HeadingSource::Relative => {
            "by definition: the map's north is where the nose pointed".into()
        }
    };
    format!(
        "roll {:.2}°, pitch {:.2}° ± {}° from {level}; heading {:.1}° ± {}° {source}",
        a.roll_deg,
        a.pitch_deg,
        short(a.sigma_level_deg),
        a.heading_deg,
        short(a.sigma_heading_deg)
    )
}

fn with_sigmas(values: &[f64; 3], sigmas: &[f64; 3]) -> String {
    let parts: Vec<String> = values
        .iter()
        .zip(sigmas)
        .map(|(v, s)| format!("{} ± {}", short(*v), short(*s)))
        .collect();
    format!("({})", parts.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zero_has_no_sign() {
        let got = [-0.00001, 0.0, -0.25].map(|x| unsigned_zero(x, 4));
        assert_eq!(got, ["0.0000", "0.0000", "-0.2500"]);
    }
}
