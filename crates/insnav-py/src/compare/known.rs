//! Which columns a comparison knows: one that it does not know is a mistake, not something to leave out.

use crate::failure::Failure;
use insnav_log::nearest;
use pyo3::prelude::*;

/// Refuse a name that no solution, truth or reference has.
pub(super) fn check(py: Python<'_>, argument: &str, names: &[String]) -> PyResult<()> {
    let known: Vec<String> = py.import("insnav._compare")?.getattr("KNOWN")?.extract()?;
    let known: Vec<&str> = known.iter().map(String::as_str).collect();
    let Some(name) = names.iter().find(|name| !known.contains(&name.as_str())) else {
        return Ok(());
    };
    let meant = abbreviated(name, &known).or_else(|| nearest(name, &known));
    let remedy = match meant {
        Some(meant) => format!("did you mean `{meant}`?"),
        None => "columns are named as those of insnav.Solution and insnav.sim.Truth".into(),
    };
    Err(Failure::new(
        "unknown_column",
        format!("{argument}: unknown column `{name}`"),
        remedy,
    )
    .about(
        argument,
        name.clone(),
        "columns named as those of insnav.Solution",
    )
    .into_py_err(py))
}

/// The first known name of which this one is short: each of its words begins a word, in the same order.
fn abbreviated<'a>(name: &str, known: &[&'a str]) -> Option<&'a str> {
    let is_short = |known: &str| {
        let mut words = known.split('_');
        let begins = |part: &str| !part.is_empty() && words.any(|word| word.starts_with(part));
        name.split('_').all(begins)
    };
    known.iter().copied().find(|known| is_short(known))
}
