//! Settings from Python: a mapping with the keys of the TOML file, or the path of one.

use crate::failure::Failure;
use insnav_core::config::Config;
use insnav_log::{LogSettings, load_config, parse_config};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyFloat, PyInt, PyList, PyMapping, PyString, PyTuple};
use std::path::PathBuf;

/// The settings, defaults where nothing is said.
pub(crate) fn config(given: Option<&Bound<'_, PyAny>>) -> PyResult<Config> {
    let Some(given) = given else {
        return Ok(Config::default());
    };
    let py = given.py();
    let config = if let Ok(mapping) = given.cast::<PyMapping>() {
        let table = table(mapping, "config")?;
        parse_config(&table.to_string(), "config", &[])
    } else if let Ok(path) = given.extract::<PathBuf>() {
        load_config(Some(&path), &[])
    } else {
        return Err(PyTypeError::new_err(format!(
            "config: expected a mapping or the path of a TOML file, not {}",
            given.get_type()
        )));
    };
    config.map_err(|e| Failure::from(e).into_py_err(py))
}

/// What the settings say to the reader of logs.
pub(crate) fn for_reading(given: Option<&Bound<'_, PyAny>>) -> PyResult<LogSettings> {
    let Some(given) = given else {
        return Ok(LogSettings::default());
    };
    let py = given.py();
    let settings = if let Ok(mapping) = given.cast::<PyMapping>() {
        LogSettings::parse(&table(mapping, "config")?.to_string(), "config", &[])
    } else if let Ok(path) = given.extract::<PathBuf>() {
        LogSettings::load(Some(&path), &[])
    } else {
        // What it is instead, `config` says.
        return Ok(LogSettings::default());
    };
    settings.map_err(|e| Failure::from(e).into_py_err(py))
}

fn table(mapping: &Bound<'_, PyMapping>, path: &str) -> PyResult<toml::Table> {
    let mut table = toml::Table::new();
    for item in mapping.items()?.iter() {
        let (key, object): (Bound<'_, PyAny>, Bound<'_, PyAny>) = item.extract()?;
        let key = key.cast::<PyString>().map_err(|_| {
            PyTypeError::new_err(format!("{path}: keys are strings, not {}", key.get_type()))
        })?;
        // None is how Python says "not given", for which TOML has no word.
        if !object.is_none() {
            let path = format!("{path}[{:?}]", key.to_str()?);
            table.insert(key.to_str()?.to_owned(), value(&object, &path)?);
        }
    }
    Ok(table)
}

fn value(object: &Bound<'_, PyAny>, path: &str) -> PyResult<toml::Value> {
    // A bool is an int to Python, so it goes first.
    if let Ok(b) = object.cast::<PyBool>() {
        return Ok(toml::Value::Boolean(b.is_true()));
    }
    if object.is_instance_of::<PyInt>() {
        return Ok(toml::Value::Integer(object.extract()?));
    }
    if object.is_instance_of::<PyFloat>() {
        return Ok(toml::Value::Float(object.extract()?));
    }
    if let Ok(text) = object.cast::<PyString>() {
        return Ok(toml::Value::String(text.to_str()?.to_owned()));
    }
    if let Ok(mapping) = object.cast::<PyMapping>() {
        return table(mapping, path).map(toml::Value::Table);
    }
    if object.is_instance_of::<PyList>() || object.is_instance_of::<PyTuple>() {
        let items = object.try_iter()?.enumerate();
        let values: PyResult<Vec<_>> = items
            .map(|(i, item)| value(&item?, &format!("{path}[{i}]")))
            .collect();
        return values.map(toml::Value::Array);
    }
    // Arrays and scalars of numpy.
    if let Ok(plain) = object.call_method0("tolist")
        && !plain.is(object)
    {
        return value(&plain, path);
    }
    Err(PyTypeError::new_err(format!(
        "{path}: {} is no number, text, list or mapping",
        object.get_type()
    )))
}
