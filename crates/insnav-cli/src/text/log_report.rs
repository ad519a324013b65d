//! What a log holds, on one screen.

use super::{entry, plural, short, some, span};
use crate::command::{LogReport, RunPreview, SeenBy, TopicReport};
use insnav_log::{Estimate, NoiseReport, Severity};

/// The report of `info`.
pub(crate) fn log_report(r: &LogReport) -> String {
    let mut text = format!(
        "{}: {}, written by {}{}{}{}\n",
        r.input.display(),
        if r.profile.is_empty() {
            "no profile"
        } else {
            &r.profile
        },
        if r.library.is_empty() {
            "an unnamed library"
        } else {
            &r.library
        },
        r.duration_s
            .map_or(String::new(), |s| format!(", {}", span(s))),
        if r.indexed {
            ""
        } else {
            "; no index, read as a stream"
        },
        match r.checksums {
            "none" => "; no checksums, damage to messages would go unnoticed",
            "some" => "; checksums for some of the messages only",
            _ => "",
        }
    );
    text.push_str(&findings(r));
    let width = |of: fn(&TopicReport) -> usize| r.topics.iter().map(of).max().unwrap_or(0);
    let (name, schema) = (width(|t| t.name.len()), width(|t| t.schema.len()));
    for t in &r.topics {
        let rate = t.rate_hz.map_or("–".to_owned(), |hz| format!("{hz:.1} Hz"));
        text.push_str(&format!(
            "  {:<13} {:<name$}  {:<schema$}  {:>8}  {rate:>9}{}\n",
            t.role.unwrap_or(""),
            t.name,
            t.schema,
            t.count,
            irregularities(t)
        ));
    }
    text.push_str(&format!(
        "seconds count from {:.3} s Unix time, {}\n",
        r.zero_unix_s,
        if r.zero_stated {
            "as the log's metadata state (t0_ns)"
        } else {
            "its first IMU stamp"
        }
    ));
    match (&r.run, &r.problem) {
        (Some(run), _) => text.push_str(&preview(run)),
        (None, Some(problem)) => {
            text.push_str(&format!(
                "run would fail: {}\n  remedy: {}\n",
                problem.message, problem.remedy
            ));
        }
        (None, None) => {}
    }
    text
}

/// What is wrong, before all else.
fn findings(r: &LogReport) -> String {
    if r.findings.is_empty() {
        return match r.run {
            Some(_) => "nothing looks wrong\n".into(),
            None => String::new(),
        };
    }
    let mut text = format!("{}\n", plural(r.findings.len(), "finding"));
    for f in &r.findings {
        let severity = match f.severity {
            Severity::Fatal => "FATAL",
            Severity::Warning => "warning",
            Severity::Note => "note",
        };
        text.push_str(&entry(
            severity,
            &format!(
                "{}: {}\n→ {}\nremedy: {}",
                f.code, f.evidence, f.consequence, f.remedy
            ),
        ));
    }
    text
}

fn irregularities(t: &TopicReport) -> String {
    let mut parts = Vec::new();
    if let Some(jitter) = t.jitter_s.filter(|_| t.role.is_some()) {
        parts.push(format!("jitter {} ms", short(1e3 * jitter)));
    }
    if !t.gaps.is_empty() {
        let longest = t
            .gaps
            .iter()
            .map(|g| g.end_s - g.begin_s)
            .fold(0.0, f64::max);
        parts.push(format!(
            "{}, longest {} s",
            plural(t.gaps.len(), "gap"),
            short(longest)
        ));
    }
    for (count, what) in [
        (t.duplicates, "duplicate stamps"),
        (t.backward_steps, "backward steps"),
        (t.unstamped, "without stamp"),
        (t.not_finite, "not finite"),
        (t.no_fix, "without fix"),
        (t.zero_position, "at (0, 0)"),
    ] {
        if count > 0 {
            parts.push(format!("{count} {what}"));
        }
    }
    if let Some(h) = t
        .header_minus_log_s
        .as_ref()
        .filter(|h| h.min.abs().max(h.max.abs()) > 0.001 && t.role.is_some())
    {
        parts.push(format!(
            "header − log time {} s ({} to {})",
            short(h.mean),
            short(h.min),
            short(h.max)
        ));
    }
    if parts.is_empty() {
        String::new()
    } else {
        format!("  {}", parts.join("; "))
    }
}

fn preview(run: &RunPreview) -> String {
    let mut text = String::from("run would use\n");
    let mut add = |label, line: String| text.push_str(&entry(label, &line));
    add(
        "samples",
        format!(
            "{} inertial, {} positions, {} velocities{}{}",
            run.imu_samples,
            run.gnss_positions,
            run.gnss_velocities,
            some(run.standstills, "declarations of standing"),
            some(run.wheel_speeds, "speeds of wheels")
        ),
    );
    let estimate = |e: &Option<Estimate>| match e {
        Some(Estimate {
            value,
            sigma: Some(sigma),
        }) => format!("{value:.4} ± {sigma:.4} s"),
        _ => "not observable".to_owned(),
    };
    add(
        "clocks",
        format!(
            "by the data, to be added to IMU stamps: {}; GNSS velocity behind its position: {}",
            estimate(&run.time_offset_s),
            estimate(&run.gnss_velocity_lag_s)
        ),
    );
    if let Some(n) = &run.imu_noise {
        add("noise", noise(n));
    }
    add("stops", stops(run));
    let source = match (run.imu_grade_picked, &run.imu_noise) {
        (false, _) => "as set",
        (true, Some(_)) => "picked from that noise",
        (true, None) => "assumed: the log is too short to tell",
    };
    add("imu", format!("{} grade, {source}", run.imu_grade));
    if let Some(mounting) = &run.imu_mounting {
        add("mounting", mounting.to_string());
    }
    add(
        "altitude",
        format!(
            "taken as above {}; a receiver that gives sea level looks the same here: `--altitude msl=N` adds the geoid's N metres",
            run.altitude_above
        ),
    );
    if !run.lever_arm_known {
        add(
            "lever arm",
            "not known, zero is taken; measured, it goes under [gnss] as lever_arm_b_m = [forward, right, down]".into(),
        );
    }
    add(
        "settings",
        format!("as follows (a file for -c)\n{}", run.config.trim_end()),
    );
    text
}

/// So many stops of a kind are listed.
const MOST_STOPS: usize = 20;

/// A line for each witness.
fn stops(run: &RunPreview) -> String {
    let kinds = [
        (SeenBy::Detector, "found by the detector"),
        (SeenBy::Topic, "declared by the topic"),
        (SeenBy::Interval, "declared by the settings"),
        (
            SeenBy::GnssVelocity,
            "by GNSS velocity alone, nothing is made of them",
        ),
    ];
    let listed = |(kind, what): (SeenBy, &str)| {
        let those = run.stops.iter().filter(|s| s.seen_by == kind);
        let count = those.clone().count();
        let spans: Vec<String> = those
            .take(MOST_STOPS)
            .map(|s| format!("{:.1}–{:.1} s", s.span.begin_s, s.span.end_s))
            .collect();
        let more = match count.saturating_sub(MOST_STOPS) {
            0 => String::new(),
            n => format!(", and {n} more"),
        };
        (count > 0).then(|| format!("{what}: {}{more}", spans.join(", ")))
    };
    let mut lines: Vec<String> = kinds.into_iter().filter_map(listed).collect();
    if let Some(stances) = run.stances.filter(|n| *n > 0) {
        lines.push(plural(stances, "stance"));
    }
    if lines.is_empty() {
        return "none".into();
    }
    lines.join("\n")
}

fn noise(n: &NoiseReport) -> String {
    let three = |v: &[f64; 3]| v.map(short).join(", ");
    let mut text = format!(
        "gyro ({}) °/√h when quiet, {} under way; accelerometer ({}) m/s/√h when quiet, {} under way\n\
         when quiet: mean rate ({}) °/h, size of the specific force {:.3} m/s²",
        three(&n.gyro_quiet_deg_per_sqrt_hour),
        short(n.gyro_under_way_deg_per_sqrt_hour),
        three(&n.accel_quiet_m_per_s_per_sqrt_hour),
        short(n.accel_under_way_m_per_s_per_sqrt_hour),
        three(&n.gyro_mean_deg_per_hour),
        n.force_m_per_s2
    );
    if n.gyro_step_deg_per_s
        .iter()
        .chain(&n.accel_step_m_per_s2)
        .any(|s| *s > 0.0)
    {
        text.push_str(&format!(
            "\nvalues come in steps of ({}) °/s and ({}) m/s²",
            three(&n.gyro_step_deg_per_s),
            three(&n.accel_step_m_per_s2)
        ));
    }
    text
}
