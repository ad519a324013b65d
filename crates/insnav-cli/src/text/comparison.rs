//! A comparison as a table of classes, and several as a table of recordings.

use super::{maybe, short};
use insnav_core::metrics::{Comparison, ErrorStatistics, OrientationMean};

/// One comparison.
pub(crate) fn comparison(solution: &str, reference: &str, c: &Comparison) -> String {
    let classes = [
        ("all", &c.all),
        ("moving", &c.moving),
        ("standing", &c.standing),
        ("withheld", &c.withheld),
    ];
    let classes: Vec<_> = classes
        .into_iter()
        .filter(|(name, s)| *name == "all" || s.count > 0)
        .collect();
    let mut text = format!("{solution} against {reference}\n");
    text.push_str(&format!("  {:<34}", ""));
    for (name, _) in &classes {
        text.push_str(&format!("{name:>11}"));
    }
    text.push('\n');
    let mut row = |label: &str, of: &dyn Fn(&ErrorStatistics) -> Option<f64>| {
        if classes.iter().all(|(_, s)| of(s).is_none()) {
            return;
        }
        text.push_str(&format!("  {label:<34}"));
        for (_, s) in &classes {
            text.push_str(&format!("{:>11}", maybe(of(s))));
        }
        text.push('\n');
    };
    row("points", &|s| Some(s.count as f64));
    row("horizontal rms, m", &|s| s.horizontal_rms_m);
    row("horizontal 95 %, m", &|s| s.horizontal_p95_m);
    row("horizontal max, m", &|s| s.horizontal_max_m);
    row("height rms, m", &|s| s.height_rms_m);
    row("velocity rms, m/s", &|s| s.velocity_rms_m_per_s);
    row("roll rms, °", &|s| s.roll_rms_deg);
    row("pitch rms, °", &|s| s.pitch_rms_deg);
    row("heading rms, °", &|s| s.heading_rms_deg);
    row("constant part: roll, °", &|s| s.mounting_deg[0]);
    row("constant part: pitch, °", &|s| s.mounting_deg[1]);
    row("constant part: heading, °", &|s| s.mounting_deg[2]);
    row("NEES/dof position (1 is right)", &|s| s.nees.position);
    row("NEES/dof velocity", &|s| s.nees.velocity);
    row("NEES/dof attitude", &|s| s.nees.attitude);
    row("within 1 sigma, % (68.3)", &|s| {
        s.coverage.one_sigma.map(|x| 100.0 * x)
    });
    row("within 2 sigma, % (95.4)", &|s| {
        s.coverage.two_sigma.map(|x| 100.0 * x)
    });
    row("within 3 sigma, % (99.7)", &|s| {
        s.coverage.three_sigma.map(|x| 100.0 * x)
    });
    if let Some(course) = &c.course {
        text.push_str(&format!(
            "  heading minus course: std {}°, mean {}°, {} medians of 20 s\n",
            maybe(course.heading_minus_course_std_deg),
            maybe(course.mean_deg),
            course.count
        ));
    }
    if let Some(o) = &c.orientation {
        text.push_str(&format!(
            "  orientation rmse: total {}°, heading {}°, inclination {}°; inside the 95 % ellipsoid {} %\n",
            maybe(o.total_rmse_deg),
            maybe(o.heading_rmse_deg),
            maybe(o.inclination_rmse_deg),
            maybe(o.coverage_95.map(|x| 100.0 * x))
        ));
    }
    if let Some(angle) = c.earth_rotation_deg {
        text.push_str(&format!(
            "  of it a constant turn between the earth frames by {}° is taken out\n",
            short(angle)
        ));
    }
    for s in &c.stops {
        let seen = s
            .delay_s
            .map_or("not seen by the solution".to_owned(), |d| {
                format!("seen after {} s", short(d))
            });
        text.push_str(&format!("  stop at {:.1} s: {seen}\n", s.reference_begin_s));
    }
    if let Some(wrong) = c.false_standing_s.filter(|s| *s > 0.0) {
        text.push_str(&format!(
            "  {} s of standing while the reference moves\n",
            short(wrong)
        ));
    }
    if c.outside > 0 {
        text.push_str(&format!(
            "  {} points of the reference lie outside the solution and were not compared\n",
            c.outside
        ));
    }
    text
}

/// Several comparisons: those of orientations with their mean, the others as drives.
pub(crate) fn tables(rows: &[(String, Comparison)], mean: &OrientationMean) -> String {
    let drive = |c: &Comparison| c.orientation.is_none() && c.all.horizontal_rms_m.is_some();
    let (drives, trials): (Vec<_>, Vec<_>) =
        rows.iter().partition(|(_, c)| mean.trials == 0 || drive(c));
    let mut text = String::new();
    if !drives.is_empty() {
        text.push_str(&table(&drives));
    }
    if !trials.is_empty() {
        text.push_str(&orientations(&trials, mean));
    }
    text
}

fn width(rows: &[&(String, Comparison)]) -> usize {
    let names = rows.iter().map(|(name, _)| name.chars().count());
    names.max().unwrap_or(0).max(9)
}

/// Orientation errors as a benchmark counts them, one line a trial.
fn orientations(rows: &[&(String, Comparison)], mean: &OrientationMean) -> String {
    let width = width(rows);
    let mut text = format!(
        "{:<width$}{:>8}{:>10}{:>10}{:>10}{:>10}\n",
        "trial", "points", "total °", "head °", "incl °", "in 95 %"
    );
    let mut line = |name: &str, points: &str, numbers: [Option<f64>; 4]| {
        text.push_str(&format!("{name:<width$}{points:>8}"));
        let [total, heading, inclination, coverage] = numbers;
        for x in [total, heading, inclination, coverage.map(|x| 100.0 * x)] {
            text.push_str(&format!("{:>10}", maybe(x)));
        }
        text.push('\n');
    };
    for (name, c) in rows {
        let o = c.orientation.unwrap_or_default();
        line(
            name,
            &o.count.to_string(),
            [
                o.total_rmse_deg,
                o.heading_rmse_deg,
                o.inclination_rmse_deg,
                o.coverage_95,
            ],
        );
    }
    line(
        "mean",
        "",
        [
            mean.total_rmse_deg,
            mean.heading_rmse_deg,
            mean.inclination_rmse_deg,
            mean.pooled_coverage_95,
        ],
    );
    text
}

/// Several comparisons, one line each.
fn table(rows: &[&(String, Comparison)]) -> String {
    let width = width(rows);
    let mut text = format!(
        "{:<width$}{:>8}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}{:>10}\n",
        "recording",
        "points",
        "horiz m",
        "95 % m",
        "max m",
        "height m",
        "vel m/s",
        "head °",
        "NEES pos",
        "withheld"
    );
    for (name, c) in rows {
        let a = &c.all;
        let numbers = [
            a.horizontal_rms_m,
            a.horizontal_p95_m,
            a.horizontal_max_m,
            a.height_rms_m,
            a.velocity_rms_m_per_s,
            a.heading_rms_deg,
            a.nees.position,
            c.withheld.horizontal_rms_m,
        ];
        text.push_str(&format!("{name:<width$}{:>8}", a.count));
        for x in numbers {
            text.push_str(&format!("{:>10}", maybe(x)));
        }
        text.push('\n');
    }
    text
}
