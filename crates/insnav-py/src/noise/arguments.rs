//! What the functions of `insnav.noise` take in common.

use super::refusal::refused;
use crate::arrays::Argument;
use crate::failure::{Failure, fail};
use crate::named::Named;
use insnav_core::noise::{Basis, Block, Constraint, LinearModel, Shape, SolveOptions, Weight};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyMapping, PyString};
use std::collections::BTreeMap;

/// More lags than any record has use for, before memory is asked for them.
const MOST_LAGS: usize = 1_000_000;
/// More rounds than anything takes that comes to an end.
const MOST_ROUNDS: usize = 10_000;
/// More sums than any machine has use for.
pub(super) const MOST_SUMS: usize = 100_000_000;

/// F (n, n), G (n, g) and H (p, n).
pub(super) fn model(
    f: &Bound<'_, PyAny>,
    g: &Bound<'_, PyAny>,
    h: &Bound<'_, PyAny>,
) -> Result<LinearModel, Failure> {
    let f = Argument::new("F", f).square()?;
    let n = f.nrows();
    Ok(LinearModel {
        f,
        g: Argument::new("G", g).matrix(Some(n), None)?,
        h: Argument::new("H", h).matrix(None, Some(n))?,
    })
}

/// `"diagonal"`, `"symmetric"`, or a mapping that says for Q and R one of these, groups of components that share a variance, or
/// matrices of shape (k, m, m).
pub(super) fn basis(
    given: Option<&Bound<'_, PyAny>>,
    process: usize,
    measurement: usize,
) -> PyResult<Basis> {
    let Some(given) = given else {
        return Ok(Basis::diagonal(process, measurement));
    };
    let py = given.py();
    let fail = fail(py);
    if given.cast::<PyString>().is_ok() {
        let of_q = shape_of("basis", given)?;
        return Basis::new(process, measurement)
            .with(Block::Process, of_q.clone())
            .and_then(|basis| basis.with(Block::Measurement, of_q))
            .map_err(|e| fail(refused(e)));
    }
    let mapping = given.cast::<PyMapping>().map_err(|_| {
        PyTypeError::new_err(
            "basis: expected \"diagonal\", \"symmetric\" or a mapping with Q and R",
        )
    })?;
    for key in mapping.keys()?.iter() {
        if !matches!(key.str()?.to_str()?, "Q" | "R") {
            return Err(fail(
                Failure::new(
                    "bad_option",
                    format!("basis: unknown key {key:?}"),
                    "known: \"Q\", \"R\"",
                )
                .about("basis", key.to_string(), "\"Q\" and \"R\""),
            ));
        }
    }
    let mut basis = Basis::new(process, measurement);
    for (key, block) in [("Q", Block::Process), ("R", Block::Measurement)] {
        if !mapping.contains(key)? {
            continue;
        }
        let (form, name) = (mapping.get_item(key)?, format!("basis[{key:?}]"));
        if form.is_none() {
            continue;
        }
        if form.cast::<PyString>().is_ok() {
            basis = basis
                .with(block, shape_of(&name, &form)?)
                .map_err(|e| fail(refused(e)))?;
        } else if let Ok(groups) = form.extract::<Vec<Vec<usize>>>() {
            basis = basis
                .with(block, Shape::Isotropic(groups))
                .map_err(|e| fail(refused(e)))?;
        } else {
            let size = basis.size(block);
            let stack = Argument::new(&name, &form)
                .stack(size, size)
                .map_err(fail)?;
            for (i, matrix) in stack.iter().enumerate() {
                basis = basis
                    .with_custom(block, matrix, &format!("{key}:{i}"))
                    .map_err(|e| fail(refused(e)))?;
            }
        }
    }
    Ok(basis)
}

fn shape_of(name: &str, form: &Bound<'_, PyAny>) -> PyResult<Shape> {
    match form.extract::<&str>()? {
        "diagonal" => Ok(Shape::Diagonal),
        "symmetric" => Ok(Shape::Symmetric),
        other => Err(Failure::new(
            "bad_option",
            format!("{name}: {other:?} is not known"),
            "\"diagonal\", \"symmetric\", groups of components, or matrices of shape (k, m, m)",
        )
        .about(
            name,
            format!("{other:?}"),
            "\"diagonal\", \"symmetric\", groups of components, or matrices of shape (k, m, m)",
        )
        .into_py_err(form.py())),
    }
}

/// Values by the names of unknowns, in the order of the basis.
pub(super) fn known(given: Option<Named<f64>>, basis: &Basis) -> Result<Vec<Option<f64>>, Failure> {
    let mut values = vec![None; basis.len()];
    for (name, value) in given.map_or_else(BTreeMap::new, |known| known.0) {
        let names: Vec<&str> = basis.unknowns().iter().map(|u| u.name.as_str()).collect();
        let Some(at) = names.iter().position(|n| *n == name) else {
            return Err(Failure::new(
                "bad_option",
                format!("known: no unknown is called {name:?}"),
                format!("there are {}", names.join(", ")),
            )
            .about("known", name, format!("one of {}", names.join(", "))));
        };
        if !value.is_finite() {
            return Err(Failure::new(
                "not_finite",
                format!("known: {name} is {value}"),
                "give finite numbers",
            )
            .about("known", format!("{name} = {value}"), "finite numbers"));
        }
        values[at] = Some(value);
    }
    Ok(values)
}

/// How to solve, as Python says it.
pub(super) struct Solving<'a> {
    pub(super) weight: &'a str,
    pub(super) constraint: &'a str,
    pub(super) known: Option<Named<f64>>,
    pub(super) reweights: usize,
    pub(super) least_independent: f64,
    pub(super) trace_penalty: f64,
}

impl Solving<'_> {
    pub(super) fn options(self, basis: &Basis) -> Result<SolveOptions, Failure> {
        for (name, value) in [
            ("least_independent", self.least_independent),
            ("trace_penalty", self.trace_penalty),
        ] {
            // Written so that NaN fails.
            if !(value >= 0.0 && value.is_finite()) {
                return Err(Failure::new(
                    "bad_option",
                    format!("{name} = {value}: must be zero or positive, and finite"),
                    "",
                )
                .about(name, value.to_string(), "zero or positive, and finite"));
            }
        }
        Ok(SolveOptions {
            weight: match self.weight {
                "bartlett" => Weight::Bartlett,
                "identity" => Weight::Identity,
                other => return Err(Failure::unknown_word("weight", other, "bartlett, identity")),
            },
            constraint: match self.constraint {
                "none" => Constraint::None,
                "nonnegative" => Constraint::NonNegative,
                "psd" => Constraint::Semidefinite,
                other => {
                    return Err(Failure::unknown_word(
                        "constraint",
                        other,
                        "nonnegative, psd, none",
                    ));
                }
            },
            known: known(self.known, basis)?,
            reweights: rounds("reweights", self.reweights)?,
            least_independent: self.least_independent,
            trace_penalty: self.trace_penalty,
        })
    }
}

/// The runs of a record with so many channels; without `runs` all of it is one.
pub(super) fn runs(
    record: Vec<f64>,
    channels: usize,
    runs: Option<&Bound<'_, PyAny>>,
) -> Result<Runs, Failure> {
    let rows = record.len() / channels;
    let spans = match runs {
        None => vec![[0, rows]],
        Some(runs) => Argument::new("runs", runs).spans(rows)?,
    };
    Ok(Runs {
        record,
        channels,
        spans,
    })
}

/// A record and where its runs begin and end: owned, so that the work on it may outlast the call that began it.
pub(super) struct Runs {
    record: Vec<f64>,
    channels: usize,
    spans: Vec<[usize; 2]>,
}

impl Runs {
    pub(super) fn pieces(&self) -> Vec<&[f64]> {
        let row = |at: usize| at * self.channels;
        self.spans
            .iter()
            .map(|[begin, end]| &self.record[row(*begin)..row(*end)])
            .collect()
    }
}

/// Refuses a number of lags that is one or the other kind of absurd.
pub(super) fn lags(lags: usize) -> Result<usize, Failure> {
    if (1..=MOST_LAGS).contains(&lags) {
        return Ok(lags);
    }
    Err(Failure::new(
        "bad_option",
        format!("lags = {lags}: must be between 1 and {MOST_LAGS}"),
        "a few tens to hundreds are enough: as many as the filter takes to forget",
    )
    .about("lags", lags.to_string(), format!("1 to {MOST_LAGS}")))
}

/// Refuses a number of rounds that is absurd: memory is asked for each of them beforehand.
pub(super) fn rounds(name: &str, rounds: usize) -> Result<usize, Failure> {
    if rounds <= MOST_ROUNDS {
        return Ok(rounds);
    }
    Err(Failure::argument(
        "bad_option",
        name,
        rounds.to_string(),
        format!("at most {MOST_ROUNDS}"),
        "a few are enough: what has not settled by then does not",
    ))
}
