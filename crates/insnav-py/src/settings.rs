//! Settings from Python: a mapping with the keys of the TOML file, the path of one, or its text.

use crate::failure::Failure;
use insnav_core::config::Config;
use insnav_log::{LogSettings, load_config, parse_config};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyMapping, PyString, PyTuple};
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
    } else if let Some(text) = toml_text(given) {
        parse_config(&text, "config", &[])
    } else if let Ok(path) = given.extract::<PathBuf>() {
        load_config(Some(&path), &[])
    } else {
        return Err(PyTypeError::new_err(format!(
            "config: expected a mapping, the path of a TOML file or its text, not {}",
            given.get_type()
        )));
    };
    config.map_err(|e| Failure::from(e).into_py_err(py))
}

/// Text of TOML, as `summary["config"]` is: with a line's end in it, which no name of a file has.
fn toml_text(given: &Bound<'_, PyAny>) -> Option<String> {
    let text = given.cast::<PyString>().ok()?.to_str().ok()?;
    text.contains('\n').then(|| text.to_owned())
}

/// What the settings say to the reader of logs.
pub(crate) fn for_reading(given: Option<&Bound<'_, PyAny>>) -> PyResult<LogSettings> {
    let Some(given) = given else {
        return Ok(LogSettings::default());
    };
    let py = given.py();
    let settings = if let Ok(mapping) = given.cast::<PyMapping>() {
        LogSettings::parse(&table(mapping, "config")?.to_string(), "config", &[])
    } else if let Some(text) = toml_text(given) {
        LogSettings::parse(&text, "config", &[])
    } else if let Ok(path) = given.extract::<PathBuf>() {
        LogSettings::load(Some(&path), &[])
    } else {
        // What it is instead, `config` says.
        return Ok(LogSettings::default());
    };
    settings.map_err(|e| Failure::from(e).into_py_err(py))
}

/// The settings that are given, checked, as a mapping whatever they came as.
///
/// For whoever hands them on to other processes or computers: what is wrong is said once, and a file is read where it is.
#[pyfunction]
#[pyo3(signature = (config))]
pub(crate) fn given_settings<'py>(
    py: Python<'py>,
    config: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    for_reading(config)?;
    self::config(config)?;
    let Some(given) = config else {
        return Ok(PyDict::new(py).into_any());
    };
    let table = if let Ok(mapping) = given.cast::<PyMapping>() {
        table(mapping, "config")?
    } else {
        let (text, origin) = match toml_text(given) {
            Some(text) => (text, "config".to_owned()),
            None => {
                let path: PathBuf = given.extract()?;
                (std::fs::read_to_string(&path)?, path.display().to_string())
            }
        };
        // Both readers have taken it, so that this is for a file that changes meanwhile.
        text.parse().map_err(|e: toml::de::Error| {
            Failure::new(
                "config_syntax",
                format!("{origin}: {e}"),
                "see the documentation of TOML",
            )
            .into_py_err(py)
        })?
    };
    object(py, toml::Value::Table(table))
}

/// A value as Python has it.
pub(crate) fn object(py: Python<'_>, value: toml::Value) -> PyResult<Bound<'_, PyAny>> {
    Ok(match value {
        toml::Value::String(text) => text.into_pyobject(py)?.into_any(),
        toml::Value::Integer(number) => number.into_pyobject(py)?.into_any(),
        toml::Value::Float(number) => number.into_pyobject(py)?.into_any(),
        toml::Value::Boolean(truth) => truth.into_pyobject(py)?.to_owned().into_any(),
        // No setting is a date; as text it stays what it was.
        toml::Value::Datetime(date) => date.to_string().into_pyobject(py)?.into_any(),
        toml::Value::Array(items) => {
            let list = PyList::empty(py);
            for item in items {
                list.append(object(py, item)?)?;
            }
            list.into_any()
        }
        toml::Value::Table(table) => {
            let mapping = PyDict::new(py);
            for (key, item) in table {
                mapping.set_item(key, object(py, item)?)?;
            }
            mapping.into_any()
        }
    })
}

/// A mapping of that name as a table.
pub(crate) fn mapping(given: &Bound<'_, PyAny>, name: &str) -> PyResult<toml::Table> {
    let mapping = given.cast::<PyMapping>().map_err(|_| {
        PyTypeError::new_err(format!(
            "{name}: expected a mapping, not {}",
            given.get_type()
        ))
    })?;
    table(mapping, name)
}

/// A mapping as TOML; `path` is what errors call it.
pub(crate) fn table(mapping: &Bound<'_, PyMapping>, path: &str) -> PyResult<toml::Table> {
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
