//! What the demonstration did, in about twenty lines.

use super::{entry, maybe, plural, short, span, way};
use crate::command::DemoReport;
use insnav_core::alignment::HeadingSource;
use insnav_core::metrics::ErrorStatistics;

/// The report of `demo`.
pub(crate) fn demo_report(d: &DemoReport) -> String {
    let (r, s) = (&d.run.report, &d.scenario);
    let mut text =
        String::from("insnav demo: a simulated drive, navigated and compared with the truth\n");
    let mut add = |label, line: String| text.push_str(&entry(label, &line));
    let outages: Vec<String> = s
        .gnss
        .outages
        .iter()
        .map(|o| format!("{:.0}–{:.0} s", o.begin_s, o.end_s))
        .collect();
    add(
        "simulated",
        format!(
            "{} by car, {} with {}; a consumer-grade IMU at {:.0} Hz, GNSS at {:.0} Hz\n\
             (position {} m, velocity {} m/s, {:.1} % outliers, none at all in {})",
            span(s.duration_s),
            way(r.distance_m),
            plural(d.comparison.stops.len(), "stop"),
            s.imu.rate_hz,
            s.gnss.position_rate_hz,
            short(s.gnss.position_sigma_m[0]),
            short(s.gnss.velocity_sigma_m_per_s[0]),
            100.0 * s.gnss.outlier_probability,
            outages.join(" and ")
        ),
    );
    if let Some(a) = &r.alignment {
        let from = match a.heading_source {
            HeadingSource::CourseVelocity | HeadingSource::CoursePosition => "the GNSS course",
            HeadingSource::Given => "the settings",
            HeadingSource::Gyrocompass => "the Earth's rate",
            HeadingSource::Antenna => "two antennas",
            HeadingSource::MovingBase => "the GNSS velocities",
            HeadingSource::Magnetic => "a magnetometer",
            HeadingSource::Unknown | HeadingSource::Relative => "nowhere: it was not found",
        };
        add(
            "start",
            format!(
                "level to {}°; heading {:.1}° ± {}° from {from}, {:.0} s into the drive",
                short(a.sigma_level_deg),
                a.heading_deg,
                short(a.sigma_heading_deg),
                a.heading_at_s
            ),
        );
    }
    let used: usize = r.aiding.iter().map(|a| a.used + a.inflated).sum();
    let rejected: usize = r.aiding.iter().map(|a| a.rejected).sum();
    add(
        "filter",
        format!(
            "{used} measurements used, {rejected} rejected; {} IMU samples in {:.2} s",
            r.imu_samples, r.elapsed_s
        ),
    );
    add(
        "errors",
        errors(
            &d.comparison.all,
            &d.comparison.standing,
            &d.comparison.withheld,
        ),
    );
    let nees = d.comparison.all.nees;
    add(
        "honesty",
        format!(
            "error²/stated variance (1 is right): position {}, velocity {}, attitude {}\n\
             position errors within 1, 2, 3 sigma: {} % (a Gaussian has 68, 95, 99.7)",
            maybe(nees.position),
            maybe(nees.velocity),
            maybe(nees.attitude),
            [
                d.comparison.all.coverage.one_sigma,
                d.comparison.all.coverage.two_sigma,
                d.comparison.all.coverage.three_sigma
            ]
            .map(|x| maybe(x.map(|x| 100.0 * x)))
            .join(", ")
        ),
    );
    add(
        "files",
        format!(
            "{}  the log\n{}  its settings\n{}  the truth\n{}  the solution, for Foxglove, RViz, rerun, PlotJuggler, evo\n\
             {:.0} MB together; to remove them: rm -r {}",
            d.log.display(),
            d.config.display(),
            d.truth.display(),
            d.run.output.display(),
            d.bytes as f64 / 1e6,
            d.dir.display()
        ),
    );
    add(
        "next",
        format!(
            "insnav info {}\ninsnav compare {} {}",
            d.log.display(),
            d.run.output.display(),
            d.truth.display()
        ),
    );
    text
}

fn errors(all: &ErrorStatistics, standing: &ErrorStatistics, outage: &ErrorStatistics) -> String {
    let mut text = format!(
        "{:<20}{:>10}{:>10}{:>12}\n",
        "rms", "all", "standing", "no GNSS"
    );
    let mut row = |label: &str, of: fn(&ErrorStatistics) -> Option<f64>| {
        text.push_str(&format!(
            "{label:<20}{:>10}{:>10}{:>12}\n",
            maybe(of(all)),
            maybe(of(standing)),
            maybe(of(outage))
        ));
    };
    row("horizontal, m", |s| s.horizontal_rms_m);
    row("height, m", |s| s.height_rms_m);
    row("velocity, m/s", |s| s.velocity_rms_m_per_s);
    row("roll, °", |s| s.roll_rms_deg);
    row("pitch, °", |s| s.pitch_rms_deg);
    row("heading, °", |s| s.heading_rms_deg);
    text.trim_end().to_owned()
}
