//! Fixes that the navigator did not get → `insnav.Withheld`, and back as what a comparison judges apart.

use crate::arrays::{Argument, rows, scalars};
use crate::failure::Failure;
use insnav_core::earth::Geodetic;
use insnav_core::metrics::{ReferencePoint, Withheld};
use insnav_core::sample::GnssPosition;
use insnav_core::time::Time;
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// One row a fix; seconds count from `origin`.
pub(crate) fn withheld<'py>(
    py: Python<'py>,
    fixes: &[GnssPosition],
    origin: Time,
) -> PyResult<Bound<'py, PyAny>> {
    let columns = PyDict::new(py);
    let scalar = |name: &str, get: fn(&GnssPosition) -> f64| {
        columns.set_item(name, scalars(py, fixes.iter().map(get))?)
    };
    let seconds = fixes.iter().map(|f| f.time.since(origin));
    columns.set_item("time_s", scalars(py, seconds)?)?;
    columns.set_item("time_ns", scalars(py, fixes.iter().map(|f| f.time.0))?)?;
    scalar("latitude_deg", |f| f.position.latitude_deg())?;
    scalar("longitude_deg", |f| f.position.longitude_deg())?;
    scalar("height_m", |f| f.position.height)?;
    let sigmas = fixes.iter().map(|f| {
        let sigma = f.covariance_n.map(|p| p.diagonal().map(f64::sqrt));
        sigma.map_or([f64::NAN; 3], Into::into)
    });
    columns.set_item("sigma_position_n_m", rows(py, sigmas)?)?;
    py.import("insnav._solution")?
        .getattr("Withheld")?
        .call((), Some(&columns))
}

/// What to judge apart: the same fixes as those that a file tells.
pub(crate) fn judged_apart(given: &Bound<'_, PyAny>) -> PyResult<Withheld> {
    let py = given.py();
    let column = |name: &str| {
        let object = given.getattr(name)?;
        Ok::<_, PyErr>(Argument::new(&format!("solution.withheld.{name}"), &object))
    };
    let fail = |e: Failure| e.into_py_err(py);
    let times = column("time_ns")?.integers().map_err(fail)?;
    let n = times.len();
    let numbers = |name: &str| column(name)?.column(Some(n)).map_err(fail);
    let latitude = numbers("latitude_deg")?;
    let longitude = numbers("longitude_deg")?;
    let height = numbers("height_m")?;
    let sigmas = column("sigma_position_n_m")?.vectors(n).map_err(fail)?;
    // What states no sigma has none of its own.
    let known = |s: &Vector3<f64>| s.map(|s| if s.is_finite() { s } else { 0.0 });
    Ok(Withheld::Fixes(
        (0..n)
            .map(|i| ReferencePoint {
                time: Time(times[i]),
                position: Some(Geodetic::from_degrees(latitude[i], longitude[i], height[i])),
                position_sigma_n: known(&sigmas[i]),
                ..ReferencePoint::default()
            })
            .collect(),
    ))
}
