//! A measurement that the user makes: residual, derivatives by named blocks, noise.

use super::blocks::{range, with_block};
use super::measured::is_covariance;
use crate::arrays::{Argument, shape_text};
use crate::failure::{Failure, fail};
use insnav_core::filter::{Columns, Eskf, Gate, Layout, Linearized, Measurement, Nominal, Update};
use insnav_core::time::Time;
use nalgebra::{DMatrix, SMatrix, SVector};
use pyo3::prelude::*;
use pyo3::types::PyMapping;
use std::collections::BTreeSet;
use std::sync::Mutex;

struct LinearModel<const M: usize> {
    name: &'static str,
    residual: SVector<f64, M>,
    h: Columns<M>,
    r: SMatrix<f64, M, M>,
}

impl<const M: usize> Measurement<M> for LinearModel<M> {
    fn name(&self) -> &'static str {
        self.name
    }

    fn linearize(&self, _at: &Nominal, _layout: &Layout) -> Linearized<M> {
        Linearized {
            residual: self.residual,
            h: self.h,
            r: self.r,
        }
    }
}

/// What the user gives, read and checked: rows of each block.
pub(super) struct Linear {
    name: &'static str,
    residual: Vec<f64>,
    h: Vec<(String, DMatrix<f64>)>,
    r: DMatrix<f64>,
}

/// One allocation for each name there ever is: reports of updates keep names for good.
pub(super) fn interned(name: &str) -> &'static str {
    static NAMES: Mutex<BTreeSet<&'static str>> = Mutex::new(BTreeSet::new());
    let mut names = NAMES.lock().unwrap_or_else(|e| e.into_inner());
    match names.get(name) {
        Some(known) => known,
        None => {
            let name: &'static str = Box::leak(name.to_owned().into_boxed_str());
            names.insert(name);
            name
        }
    }
}

impl Linear {
    pub(super) fn read(
        filter: &Eskf,
        name: &str,
        residual: &Bound<'_, PyAny>,
        h: &Bound<'_, PyMapping>,
        r: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let fail = fail(h.py());
        let residual = small(&Argument::new("residual", residual), "(m,)").map_err(fail)?;
        let m = residual.len();
        if !(1..=3).contains(&m) {
            return Err(fail(Failure::argument(
                "wrong_shape",
                "residual",
                format!("shape ({m},)"),
                "(1,), (2,) or (3,)",
                "give more components in parts, one after the other, where their noises are independent",
            )));
        }
        let matrix = |argument: &Argument<'_>, n: usize| {
            let numbers = argument.numbers()?;
            let one_row = m == 1 && numbers.shape() == [n];
            let number = m == 1 && n == 1 && numbers.shape().is_empty();
            if numbers.shape() != [m, n] && !one_row && !number {
                return Err(Failure::argument(
                    "wrong_shape",
                    &argument.name,
                    format!("shape {}", shape_text(numbers.shape())),
                    format!("({m}, {n})"),
                    "one row for each component of the residual",
                ));
            }
            finite(&argument.name, numbers.values())?;
            Ok(DMatrix::from_row_slice(m, n, numbers.values()))
        };
        let mut blocks = Vec::new();
        for item in h.items()?.iter() {
            let (key, rows): (String, Bound<'_, PyAny>) = item.extract()?;
            let size = range(filter, "h", &key).map_err(fail)?.len();
            let rows = matrix(&Argument::new(&format!("h[{key:?}]"), &rows), size).map_err(fail)?;
            blocks.push((key, rows));
        }
        let r = matrix(&Argument::new("r", r), m).map_err(fail)?;
        is_covariance("r", &r).map_err(fail)?;
        Ok(Linear {
            name: interned(name),
            residual,
            h: blocks,
            r,
        })
    }

    pub(super) fn update(
        &self,
        filter: &mut Eskf,
        time: Time,
        gate: &mut Gate,
    ) -> insnav_core::error::Result<Update> {
        match self.residual.len() {
            1 => filter.update(&self.model::<1>(filter), time, gate),
            2 => filter.update(&self.model::<2>(filter), time, gate),
            _ => filter.update(&self.model::<3>(filter), time, gate),
        }
    }

    fn model<const M: usize>(&self, filter: &Eskf) -> LinearModel<M> {
        let layout = filter.covariance().layout();
        let mut h = Columns::default();
        for (name, rows) in &self.h {
            // That there is such a block was seen when it was read.
            let _ = with_block!(name.as_str(), block => {
                h.put(layout, block, &SMatrix::from_fn(|i, j| rows[(i, j)]));
            });
        }
        LinearModel {
            name: self.name,
            residual: SVector::from_fn(|i, _| self.residual[i]),
            h,
            r: SMatrix::from_fn(|i, j| self.r[(i, j)]),
        }
    }
}

/// A number alone, or a few in a row.
fn small(argument: &Argument<'_>, expected: &str) -> Result<Vec<f64>, Failure> {
    let numbers = argument.numbers()?;
    if numbers.shape().len() > 1 {
        return Err(Failure::argument(
            "wrong_shape",
            &argument.name,
            format!("shape {}", shape_text(numbers.shape())),
            expected,
            "",
        ));
    }
    finite(&argument.name, numbers.values())?;
    Ok(numbers.values().to_vec())
}

fn finite(name: &str, values: &[f64]) -> Result<(), Failure> {
    if values.iter().all(|x| x.is_finite()) {
        return Ok(());
    }
    let expected = "finite numbers";
    Err(Failure::argument(
        "bad_value",
        name,
        format!("{values:?}"),
        expected,
        "",
    ))
}
