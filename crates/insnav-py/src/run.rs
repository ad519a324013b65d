//! `insnav.run`: the one loop, over arrays.

use crate::epochs::Epochs;
use crate::failure::Failure;
use crate::inputs;
use crate::settings;
use crate::solution::Solution;
use insnav_core::error::Error;
use insnav_core::imu::ImuGrade;
use insnav_core::navigator::Navigator;
use insnav_core::time::Time;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyMapping;

/// See the documentation in Python.
#[pyfunction]
#[pyo3(signature = (log, config=None))]
pub(crate) fn run(log: &Bound<'_, PyAny>, config: Option<&Bound<'_, PyAny>>) -> PyResult<Solution> {
    let py = log.py();
    let config = settings::config(config)?;
    let arrays = log.cast::<PyMapping>().map_err(|_| {
        PyTypeError::new_err(format!(
            "expected a mapping of arrays, not {}",
            log.get_type()
        ))
    })?;
    let samples = inputs::samples(arrays)?;
    let navigate = || -> Result<Epochs, Error> {
        let noise = config
            .noise
            .over(config.imu.grade.unwrap_or(ImuGrade::Consumer));
        let mut navigator = Navigator::new(&config, noise)?;
        let mut epochs = Epochs::at_rate(config.output.rate_hz);
        for sample in &samples {
            navigator.step(sample, &mut epochs)?;
        }
        navigator.finish(&mut epochs)?;
        Ok(epochs)
    };
    let epochs = py
        .detach(navigate)
        .map_err(|e| Failure::new("navigator", e.to_string(), "").into_py_err(py))?;
    Ok(Solution {
        rows: epochs.rows,
        origin: Time(0),
    })
}
