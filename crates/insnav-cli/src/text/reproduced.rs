//! A published experiment beside ours, as tables.

use super::short;
use crate::reproduce::{Reproduced, Row};

/// Width of a column.
const WIDTH: usize = 17;

/// The report of `reproduce`.
pub(crate) fn reproduced(r: &Reproduced) -> String {
    let mut text = format!(
        "{}, {} runs, seed {}\n± is the standard error, [in brackets] what was published, limit the Cramér–Rao bound\n",
        r.paper, r.runs, r.seed
    );
    let mut notes: Vec<&str> = Vec::new();
    for case in distinct(r.rows.iter().map(|row| row.case)) {
        let rows: Vec<&Row> = r.rows.iter().filter(|row| row.case == case).collect();
        text.push_str(&table(case, &rows, &mut notes));
    }
    if !notes.is_empty() {
        text.push_str("\nnotes\n");
    }
    for (i, note) in notes.iter().enumerate() {
        text.push_str(&format!("  {}  {note}\n", i + 1));
    }
    text.push_str("\nassumptions\n");
    for line in &r.assumptions {
        text.push_str(&format!("  {line}\n"));
    }
    text
}

fn distinct<'a>(all: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut list = Vec::new();
    for one in all {
        if !list.contains(&one) {
            list.push(one);
        }
    }
    list
}

/// Variants down, quantities across.
fn table<'a>(case: &str, rows: &[&'a Row], notes: &mut Vec<&'a str>) -> String {
    let quantities = distinct(rows.iter().map(|row| row.quantity));
    let variants = distinct(rows.iter().map(|row| row.variant));
    let name = variants.iter().map(|v| v.len()).max().unwrap_or(0) + 2;
    let mut text = format!("\n{case:<name$}");
    for quantity in &quantities {
        text.push_str(&format!("{:>WIDTH$}", heading(quantity)));
    }
    text.push('\n');
    for variant in variants {
        let of = |quantity: &&str| {
            let found = rows
                .iter()
                .find(|r| r.variant == variant && r.quantity == *quantity);
            found.copied()
        };
        let found: Vec<Option<&Row>> = quantities.iter().map(of).collect();
        text.push_str(&format!("{variant:<name$}"));
        for row in found.iter().flatten() {
            let mark = row.note.map(|note| number(note, notes));
            text.push_str(&format!("{:>WIDTH$}", ours(row, mark)));
        }
        text.push('\n');
        if found.iter().flatten().any(|row| row.published.is_some()) {
            let published = |row: &Row| row.published.map_or(String::new(), |p| format!("[{p}]"));
            text.push_str(&line("", name, &found, published));
        }
    }
    let first: Vec<Option<&Row>> = quantities
        .iter()
        .map(|q| rows.iter().find(|r| r.quantity == *q).copied())
        .collect();
    let limit = |row: &Row| row.limit.map_or(String::new(), short);
    text.push_str(&line("limit", name, &first, limit));
    text
}

fn line(label: &str, name: usize, rows: &[Option<&Row>], of: impl Fn(&Row) -> String) -> String {
    let mut text = format!("{label:<name$}");
    for row in rows {
        text.push_str(&format!("{:>WIDTH$}", row.map_or(String::new(), &of)));
    }
    text.truncate(text.trim_end().len());
    text.push('\n');
    text
}

fn ours(row: &Row, mark: Option<usize>) -> String {
    let mark = mark.map_or(String::new(), |n| format!(" ({n})"));
    let Some(value) = row.ours else {
        return format!("–{mark}");
    };
    match row.standard_error {
        Some(error) if error > 0.0 => format!("{}±{}{mark}", short(value), brief(error)),
        _ => format!("{}{mark}", short(value)),
    }
}

/// Two digits are enough of an error.
fn brief(x: f64) -> String {
    let decimals = (1.0 - x.abs().log10().floor()).clamp(0.0, 5.0) as usize;
    let text = format!("{x:.decimals$}");
    text.strip_prefix('0').unwrap_or(&text).to_owned()
}

/// The number of a note, one for equal ones.
fn number<'a>(note: &'a str, notes: &mut Vec<&'a str>) -> usize {
    let at = notes.iter().position(|n| *n == note).unwrap_or_else(|| {
        notes.push(note);
        notes.len() - 1
    });
    at + 1
}

/// Quantities in short.
fn heading(quantity: &str) -> &str {
    match quantity {
        "horizontal_rms_m" => "horiz m",
        "height_rms_m" => "height m",
        "velocity_rms_m_per_s" => "vel m/s",
        "roll_pitch_rms_deg" => "roll/pitch °",
        "heading_end_rms_deg" => "heading °",
        "heading_end_sigma_deg" => "its sigma °",
        "heading_end_nees" => "its NEES (1)",
        "heading_growth_rms_deg" => "growth °",
        "attitude_nees" => "att NEES (3)",
        "position_nees" => "pos NEES (3)",
        "gyro_bias_z_rms_deg_per_s" => "bias z °/s",
        "gyro_bias_nees" => "bias NEES (3)",
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_has_its_error_what_was_published_its_limit_and_its_note() {
        let row = |variant, ours, published| Row {
            case: "stop_300s",
            variant,
            quantity: "heading_end_rms_deg",
            published,
            ours,
            standard_error: Some(0.0341),
            stated: None,
            limit: Some(0.5),
            note: Some("held"),
        };
        let text = reproduced(&Reproduced {
            paper: "kozadaev2017",
            runs: 100,
            seed: 1,
            assumptions: vec!["none".into()],
            rows: vec![
                row("paper_exact", Some(0.475), Some(0.51)),
                row("basic", None, None),
            ],
        });
        for part in [
            "0.475±.034 (1)",
            "[0.51]",
            "limit",
            "0.500",
            "1  held",
            "– (1)",
            "none",
        ] {
            assert!(text.contains(part), "{part} in {text}");
        }
        assert_eq!(text.matches("held").count(), 1);
    }
}
