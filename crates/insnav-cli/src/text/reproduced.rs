//! A published experiment beside ours, as tables.

use super::short;
use crate::reproduce::{Reproduced, Row};

/// What the signs of the table mean, of those that are in it.
fn legend(r: &Reproduced) -> String {
    let any = |of: &dyn Fn(&Row) -> bool| r.rows.iter().any(of);
    let mut parts = vec!["± is the standard error"];
    if any(&|row| row.published.is_some()) {
        parts.push("[in brackets] what was published");
    }
    if any(&|row| heading(row.quantity).contains("NEES ~")) {
        parts.push("NEES ~3: of honest sigmas 3");
    }
    if any(&|row| row.limit.is_some()) {
        parts.push("\nlimit: no linear estimate is better");
    }
    parts.join("; ").replace("; \n", ";\n")
}

/// The report of `reproduce`.
pub(crate) fn reproduced(r: &Reproduced) -> String {
    let mut text = format!(
        "{}, {} runs, seed {}\n{}\n",
        r.paper,
        r.runs,
        r.seed,
        legend(r)
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
        text.push_str(&wrapped(&format!("{:>3}  ", i + 1), note));
    }
    text.push_str("\nassumptions\n");
    for line in &r.assumptions {
        text.push_str(&wrapped("  ", line));
    }
    text
}

/// A page is so wide.
const WIDTH: usize = 120;

/// A sentence on lines no longer than [`WIDTH`], indented to what stands before it.
fn wrapped(before: &str, sentence: &str) -> String {
    let indent = " ".repeat(before.chars().count());
    let mut text = String::new();
    let mut line = before.to_owned();
    for word in sentence.split(' ') {
        let fits = line.chars().count() + 1 + word.chars().count() <= WIDTH;
        if !fits && !line.trim().is_empty() {
            text.push_str(line.trim_end());
            text.push('\n');
            line.clone_from(&indent);
        }
        line.push_str(word);
        line.push(' ');
    }
    text + line.trim_end() + "\n"
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

/// What is in a second table, where there is any of it.
const SECOND: [&str; 5] = ["heading", "gyro", "noise", "accepted", "lost"];

/// Tables that fit a page, motion and heading apart where there are both: variants down, quantities across.
fn table<'a>(case: &str, rows: &[&'a Row], notes: &mut Vec<&'a str>) -> String {
    let quantities = distinct(rows.iter().map(|row| row.quantity));
    let (heading, motion): (Vec<&str>, Vec<&str>) = quantities
        .iter()
        .partition(|q| SECOND.iter().any(|word| q.contains(word)));
    if heading.is_empty() {
        return lines(cells(case, rows, &motion, notes));
    }
    let [first, second] = if quantities.contains(&"pitch_std_deg") {
        ["roll and pitch", "heading and noise"]
    } else {
        ["motion", "heading"]
    };
    let mut text = lines(cells(&format!("{case}, {first}"), rows, &motion, notes));
    text.push_str(&lines(cells(
        &format!("{case}, {second}"),
        rows,
        &heading,
        notes,
    )));
    text
}

fn cells<'a>(
    title: &str,
    rows: &[&'a Row],
    quantities: &[&str],
    notes: &mut Vec<&'a str>,
) -> Vec<Vec<String>> {
    let line = |label: &str, of: &mut dyn FnMut(&str) -> Option<String>| {
        let cells = quantities.iter().map(|q| of(q).unwrap_or_default());
        core::iter::once(label.to_owned())
            .chain(cells)
            .collect::<Vec<String>>()
    };
    let mut table = vec![line(title, &mut |q| Some(heading(q).to_owned()))];
    for variant in distinct(rows.iter().map(|row| row.variant)) {
        let find = |quantity: &str| {
            let mut all = rows.iter().copied();
            all.find(|r| r.variant == variant && r.quantity == quantity)
        };
        table.push(line(variant, &mut |q| {
            let row = find(q)?;
            let mark = row.note.as_deref().map(|note| number(note, notes));
            Some(ours(row, mark))
        }));
        let published = |q: &str| Some(format!("[{}]", find(q)?.published?));
        if quantities.iter().any(|q| published(q).is_some()) {
            table.push(line("", &mut |q| published(q)));
        }
    }
    let limit = |q: &str| {
        let mut of = rows.iter().filter(|row| row.quantity == q);
        of.find_map(|row| row.limit).map(short)
    };
    if quantities.iter().any(|q| limit(q).is_some()) {
        table.push(line("limit", &mut |q| limit(q)));
    }
    table
}

/// Columns as wide as what is in them, the first to the left.
fn lines(table: Vec<Vec<String>>) -> String {
    let width = |column: usize| {
        let cells = table.iter().filter_map(|line| line.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..table.first().map_or(0, Vec::len)).map(width).collect();
    let mut text = String::from("\n");
    for line in &table {
        for (i, (cell, width)) in line.iter().zip(&widths).enumerate() {
            if i == 0 {
                text.push_str(&format!("{cell:<width$}"));
            } else {
                text.push_str(&format!("  {cell:>width$}"));
            }
        }
        text.truncate(text.trim_end().len());
        text.push('\n');
    }
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
        "heading_end_nees" => "NEES ~1",
        "heading_growth_rms_deg" => "growth °",
        "attitude_nees" => "att NEES ~3",
        "position_nees" => "pos NEES ~3",
        "gyro_bias_z_rms_deg_per_s" => "bias z °/s",
        "gyro_bias_nees" => "bias NEES ~3",
        "drift_error_percent" => "drift, %",
        "drift_error_right_percent" => "right",
        "drift_error_forward_percent" => "forward",
        "drift_error_up_percent" => "up",
        "azimuth_error_arcmin" | "azimuth_rms_arcmin" => "azimuth ′",
        "drift_rms_nrad_per_s" => "drift, nrad/s",
        "drift_vertical_rms_nrad_per_s" => "vertical",
        "horizontal_rms_first_leg_m" => "first leg, m",
        "horizontal_rms_last_leg_m" => "last leg, m",
        "horizontal_max_m" => "largest, m",
        "horizontal_nees_per_component" => "NEES ~1",
        "heading_rms_last_leg_arcmin" => "heading ′",
        "pitch_std_deg" => "pitch std °",
        "roll_std_deg" => "roll std °",
        "pitch_rms_deg" => "pitch rms °",
        "roll_rms_deg" => "roll rms °",
        "heading_rms_deg" => "heading rms °",
        "process_noise_ratio" => "Q / data sheet",
        "measured_noise_ratio" => "R / data sheet",
        "accepted_percent" => "accepted, %",
        "longest_lost_s" => "lost, s",
        "velocity_max_m_per_s" => "velocity after an hour, m/s",
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
            note: Some("held".into()),
        };
        let text = reproduced(&Reproduced {
            paper: "kozadaev2017",
            runs: 100,
            independent_runs: 100,
            seed: 1,
            assumptions: vec!["none".into(), "long words ".repeat(40)],
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
        assert_eq!(text.matches("words").count(), 40);
        assert!(text.lines().all(|line| line.chars().count() <= WIDTH));
    }
}
