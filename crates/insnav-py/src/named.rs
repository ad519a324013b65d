//! Arguments that give things by name: mappings of any class.

use crate::inputs::type_name;
use pyo3::conversion::FromPyObjectOwned;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyMapping;
use std::collections::BTreeMap;

/// A mapping of names, where a `BTreeMap` itself would take a `dict` alone.
pub(crate) struct Named<T>(pub(crate) BTreeMap<String, T>);

impl<'py, T: FromPyObjectOwned<'py>> FromPyObject<'_, 'py> for Named<T> {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let mapping = object.cast::<PyMapping>().map_err(|_| {
            PyTypeError::new_err(format!("expected a mapping, not {}", type_name(&object)))
        })?;
        let mut named = BTreeMap::new();
        for item in mapping.items()?.iter() {
            let (name, value): (String, Bound<'py, PyAny>) = item.extract()?;
            named.insert(name, value.extract().map_err(Into::into)?);
        }
        Ok(Named(named))
    }
}
