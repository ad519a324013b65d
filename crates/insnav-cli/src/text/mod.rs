//! Reports as text that a person understands.

mod aligned;
mod comparison;
mod demo_report;
mod log_report;
mod noise_report;
mod oriented;
mod reproduced;
mod run_summary;
mod simulated;

pub(crate) use aligned::aligned;
pub(crate) use comparison::{comparison, tables};
pub(crate) use demo_report::demo_report;
pub(crate) use log_report::log_report;
pub(crate) use noise_report::noise_report;
pub(crate) use oriented::oriented;
pub(crate) use reproduced::reproduced;
pub(crate) use run_summary::run_summary;
pub(crate) use simulated::simulated;

/// `label` in a column, then the text; further lines of the text are indented to it.
fn entry(label: &str, text: &str) -> String {
    let indent = " ".repeat(14);
    format!(
        "  {label:<12}{}\n",
        text.replace('\n', &format!("\n{indent}"))
    )
}

/// A number with about three significant digits, in ordinary notation.
pub(crate) fn short(x: f64) -> String {
    if !x.is_finite() {
        return "–".into();
    }
    let size = x.abs();
    let decimals = match size {
        s if s == 0.0 || s >= 100.0 => 0,
        s if s >= 10.0 => 1,
        s if s >= 1.0 => 2,
        s if s >= 0.1 => 3,
        _ => 4,
    };
    format!("{x:.decimals$}")
}

/// As [`short`], with a dash where there is nothing.
pub(crate) fn maybe(x: Option<f64>) -> String {
    x.map_or_else(|| "–".into(), short)
}

/// A length in metres or kilometres.
fn way(metres: f64) -> String {
    if metres >= 1000.0 {
        format!("{:.2} km", metres / 1000.0)
    } else {
        format!("{metres:.0} m")
    }
}

/// A span of time as minutes and seconds.
fn span(seconds: f64) -> String {
    if seconds >= 60.0 {
        format!(
            "{:.0} min {:02.0} s",
            (seconds / 60.0).floor(),
            (seconds % 60.0).floor()
        )
    } else {
        format!("{seconds:.1} s")
    }
}

/// A count with its name behind a comma, if there is anything to count.
fn some(count: usize, what: &str) -> String {
    if count == 0 {
        String::new()
    } else {
        format!(", {count} {what}")
    }
}

fn plural(n: usize, one: &str) -> String {
    format!("{n} {one}{}", if n == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_about_three_digits() {
        let got: Vec<String> = [
            0.0,
            0.012_34,
            0.456_7,
            1.234,
            12.34,
            4054.2,
            -0.21,
            f64::NAN,
        ]
        .map(short)
        .into();
        assert_eq!(
            got,
            [
                "0", "0.0123", "0.457", "1.23", "12.3", "4054", "-0.210", "–"
            ]
        );
        assert_eq!(
            (way(4054.0).as_str(), way(12.0).as_str()),
            ("4.05 km", "12 m")
        );
        assert_eq!(
            (span(59.96).as_str(), span(548.7).as_str()),
            ("60.0 s", "9 min 08 s")
        );
        assert_eq!(
            (plural(1, "stop"), plural(0, "stop")),
            ("1 stop".into(), "0 stops".into())
        );
    }
}
