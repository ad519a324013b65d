//! The errors instant by instant, on their way to `insnav.Comparison`.

use crate::arrays::table;
use insnav_core::metrics::{ErrorInstant, Nees};
use insnav_core::time::Time;
use nalgebra::Vector3;
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// Its columns; NaN where there is nothing to compare.
pub(super) struct Series {
    /// Name, numbers and how many of them a row has; `None`: shape (n,).
    numbers: Vec<(&'static str, Vec<f64>, Option<usize>)>,
    standing: Vec<bool>,
}

impl Series {
    /// `origin`: from when seconds count.
    pub(super) fn of(series: &[ErrorInstant], origin: Time) -> Self {
        let mut numbers = Vec::new();
        let time = series.iter().map(|e| e.time.since(origin));
        numbers.push(("time_s", time.collect(), None));
        let mut vector = |name, get: fn(&ErrorInstant) -> Option<Vector3<f64>>| {
            let rows = series
                .iter()
                .flat_map(|e| get(e).map_or([f64::NAN; 3], Into::into));
            numbers.push((name, rows.collect(), Some(3)));
        };
        vector("position_error_n_m", |e| e.error.position_n);
        vector("velocity_error_n_m_per_s", |e| e.error.velocity_n);
        vector("attitude_error_n_deg", |e| {
            e.error.rotation_n.map(|r| r.map(f64::to_degrees))
        });
        vector("roll_pitch_heading_error_deg", |e| {
            e.error.angles.map(|a| a.map(f64::to_degrees))
        });
        vector("sigma_position_n_m", |e| e.position_sigma_n);
        vector("sigma_velocity_n_m_per_s", |e| e.velocity_sigma_n);
        vector("sigma_attitude_n_deg", |e| {
            e.attitude_sigma_n.map(|s| s.map(f64::to_degrees))
        });
        let mut nees = |name, get: fn(Nees) -> Option<f64>| {
            let values = series
                .iter()
                .map(|e| get(e.error.nees()).unwrap_or(f64::NAN));
            numbers.push((name, values.collect(), None));
        };
        nees("nees_position", |n| n.position);
        nees("nees_velocity", |n| n.velocity);
        nees("nees_attitude", |n| n.attitude);
        Series {
            numbers,
            standing: series.iter().map(|e| e.standing == Some(true)).collect(),
        }
    }

    /// As arrays, which take the numbers as they lie.
    pub(super) fn fields(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let fields = PyDict::new(py);
        for (name, values, width) in self.numbers {
            match width {
                None => fields.set_item(name, values.into_pyarray(py))?,
                Some(width) => fields.set_item(name, table(py, values, width)?)?,
            }
        }
        fields.set_item("standing", self.standing.into_pyarray(py))?;
        Ok(fields)
    }
}
