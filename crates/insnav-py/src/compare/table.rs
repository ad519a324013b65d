//! A solution or a reference as the user has it: a file, or columns by name.

use super::columns::Columns;
use super::known;
use crate::arrays::Argument;
use crate::failure::{Failure, fail};
use crate::withheld::judged_apart;
use insnav_core::metrics::Withheld;
use insnav_core::time::Time;
use insnav_log::Withhold;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyMapping;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// One of the two, as the user has it.
pub(super) enum Given<'py> {
    File(PathBuf),
    Columns(Table<'py>),
}

impl<'py> Given<'py> {
    pub(super) fn new(object: &Bound<'py, PyAny>, name: &'static str) -> PyResult<Self> {
        if let Ok(path) = object.extract::<PathBuf>() {
            return Ok(Given::File(path));
        }
        let py = object.py();
        // Data frames and their like as mappings, columns as those of solutions.
        let mapping = py
            .import("insnav._compare")?
            .getattr("columns_of")?
            .call1((object,))?;
        let table = Table {
            mapping: mapping.cast::<PyMapping>().ok().cloned(),
            object: object.clone(),
            name,
        };
        if let Some(mapping) = &table.mapping {
            let names: PyResult<Vec<String>> = mapping
                .keys()?
                .iter()
                .map(|key| Ok(key.str()?.to_string()))
                .collect();
            known::check(py, name, &names?)?;
        }
        if table.mapping.is_none() && !object.hasattr("time_s")? {
            return Err(PyTypeError::new_err(format!(
                "{name}: expected a solution, a path or a mapping of columns, not {}",
                object.get_type()
            )));
        }
        Ok(Given::Columns(table))
    }

    pub(super) fn name(&self) -> String {
        match self {
            Given::File(path) => path.display().to_string(),
            Given::Columns(table) => table.name.to_owned(),
        }
    }
}

/// Columns by name: the keys of a mapping, or the attributes of a solution or a truth.
pub(super) struct Table<'py> {
    object: Bound<'py, PyAny>,
    mapping: Option<Bound<'py, PyMapping>>,
    name: &'static str,
}

impl<'py> Table<'py> {
    fn item(&self, key: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        let found = match &self.mapping {
            Some(mapping) if mapping.contains(key)? => mapping.get_item(key)?,
            None if self.object.hasattr(key)? => self.object.getattr(key)?,
            _ => return Ok(None),
        };
        Ok((!found.is_none()).then_some(found))
    }

    fn column(&self, key: &str) -> PyResult<Option<Argument<'py>>> {
        let name = match self.mapping {
            Some(_) => format!("{}[{key:?}]", self.name),
            None => format!("{}.{key}", self.name),
        };
        Ok(self.item(key)?.map(|object| Argument { name, object }))
    }

    /// Whether it has what only solutions have: a covariance.
    pub(super) fn is_solution(&self) -> PyResult<bool> {
        Ok(self.item("position_covariance_n_m2")?.is_some() && self.item("t0_ns")?.is_some())
    }

    fn fail(&self, failure: Failure) -> PyErr {
        fail(self.object.py())(failure)
    }

    fn numbers(&self, into: &mut Columns, key: &'static str, of_one: &[usize]) -> PyResult<bool> {
        let Some(column) = self.column(key)? else {
            return Ok(false);
        };
        let shape = [&[into.time.len()], of_one].concat();
        let values = column.shaped(&shape).map_err(|e| self.fail(e))?;
        into.numbers.insert(key, values);
        self.breathe()?;
        Ok(true)
    }

    fn vectors(&self, into: &mut Columns, key: &'static str) -> PyResult<bool> {
        let Some(column) = self.column(key)? else {
            return Ok(false);
        };
        let vectors = column
            .vectors_or_one(into.time.len())
            .map_err(|e| self.fail(e))?;
        into.vectors.insert(key, vectors);
        self.breathe()?;
        Ok(true)
    }

    /// Between columns, each of which is a copy of some milliseconds: signals, and other threads.
    fn breathe(&self) -> PyResult<()> {
        let py = self.object.py();
        py.detach(|| ());
        py.check_signals()
    }

    /// Angles, whichever of the three there are.
    fn angles(&self, into: &mut Columns) -> PyResult<bool> {
        let mut any = false;
        for key in ["roll_deg", "pitch_deg", "heading_deg"] {
            any |= self.numbers(into, key, &[])?;
        }
        Ok(any)
    }

    /// Stamps, and no columns yet.
    fn stamps(&self) -> PyResult<Columns> {
        let (time, absolute) = if let Some(column) = self.column("time_ns")? {
            let stamps = column.integers().map_err(|e| self.fail(e))?;
            (stamps.into_iter().map(Time).collect(), true)
        } else if let Some(column) = self.column("time_s")? {
            let absolute = column.is_dates().map_err(|e| self.fail(e))?;
            (column.times().map_err(|e| self.fail(e))?, absolute)
        } else {
            return Err(self.fail(Failure::new(
                "missing_column",
                format!("{}: there is no column `time_s`", self.name),
                "give the stamps, s or datetime64",
            )));
        };
        self.breathe()?;
        Ok(Columns {
            name: self.name,
            time,
            absolute,
            t0_ns: 0,
            numbers: BTreeMap::new(),
            vectors: BTreeMap::new(),
            told: BTreeMap::new(),
        })
    }

    /// What a solution is made of.
    pub(super) fn solution(&self) -> PyResult<Columns> {
        let mut columns = self.stamps()?;
        if let Some(t0) = self.item("t0_ns")? {
            columns.t0_ns = t0.extract()?;
        }
        for key in [
            "latitude_deg",
            "longitude_deg",
            "height_m",
            "standing",
            "standing_s",
        ] {
            self.numbers(&mut columns, key, &[])?;
        }
        for key in ["velocity_n_m_per_s", "rate_b_deg_per_s"] {
            self.vectors(&mut columns, key)?;
        }
        for (key, sigma_key) in [
            ("position_covariance_n_m2", "sigma_position_n_m"),
            (
                "velocity_covariance_n_m2_per_s2",
                "sigma_velocity_n_m_per_s",
            ),
            ("attitude_covariance_n_rad2", "sigma_attitude_n_deg"),
        ] {
            if !self.numbers(&mut columns, key, &[3, 3])? {
                self.vectors(&mut columns, sigma_key)?;
            }
        }
        if !self.numbers(&mut columns, "quaternion_nb_wxyz", &[4])? {
            self.angles(&mut columns)?;
        }
        for key in ["config", "withhold"] {
            if let Some(text) = self.told(key)? {
                columns.told.insert(key, text);
            }
        }
        Ok(columns)
    }

    /// What a reference is made of.
    pub(super) fn reference(&self) -> PyResult<Columns> {
        let mut columns = self.stamps()?;
        for key in ["latitude_deg", "longitude_deg", "height_m"] {
            self.numbers(&mut columns, key, &[])?;
        }
        for key in [
            "velocity_n_m_per_s",
            "sigma_position_n_m",
            "sigma_velocity_n_m_per_s",
        ] {
            self.vectors(&mut columns, key)?;
        }
        if !self.angles(&mut columns)? {
            self.numbers(&mut columns, "quaternion_nb_wxyz", &[4])?;
        }
        if !self.numbers(&mut columns, "moving", &[])? {
            self.numbers(&mut columns, "standing", &[])?;
        }
        Ok(columns)
    }

    /// What the summary of the run says under a key.
    fn told(&self, key: &str) -> PyResult<Option<String>> {
        let Some(summary) = self.item("summary")? else {
            return Ok(None);
        };
        let Ok(summary) = summary.cast_into::<PyMapping>() else {
            return Ok(None);
        };
        match summary.contains(key)? {
            true => Ok(summary.get_item(key)?.extract().ok()),
            false => Ok(None),
        }
    }

    /// Fixes that were withheld one in so many, as the run was told.
    pub(super) fn withheld_singly(&self) -> PyResult<Option<String>> {
        Ok(self
            .told("withhold")?
            .filter(|rule| matches!(rule.parse(), Ok(Withhold::Every(_)))))
    }

    /// Which they were, where the solution has kept them.
    pub(super) fn withheld_fixes(&self) -> PyResult<Option<Withheld>> {
        match self.item("withheld")? {
            Some(fixes) if fixes.hasattr("time_ns")? && fixes.len()? > 0 => {
                judged_apart(&fixes).map(Some)
            }
            _ => Ok(None),
        }
    }
}
