//! What figures need beside the columns of a solution: standard deviations of roll, pitch and heading.

use crate::arrays::{Argument, rows};
use crate::failure::{Failure, fail};
use crate::interrupt::interruptible;
use insnav_core::attitude::Euler;
use nalgebra::Matrix3;
use pyo3::prelude::*;

/// Standard deviations of roll, pitch and heading, degrees, shape (n, 3).
///
/// Parameters
/// ----------
/// pitch_deg, heading_deg : (n,)
///     The angles, degrees.
/// attitude_covariance_n_rad2 : (n, 3, 3)
///     Covariance of the attitude as a small rotation about north, east and down, rad².
#[pyfunction]
#[pyo3(signature = (pitch_deg, heading_deg, attitude_covariance_n_rad2))]
pub(crate) fn angle_sigmas_deg<'py>(
    py: Python<'py>,
    pitch_deg: &Bound<'py, PyAny>,
    heading_deg: &Bound<'py, PyAny>,
    attitude_covariance_n_rad2: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let read = || {
        let pitch = Argument::new("pitch_deg", pitch_deg).column(None)?;
        let heading = Argument::new("heading_deg", heading_deg).column(Some(pitch.len()))?;
        let covariance = Argument::new("attitude_covariance_n_rad2", attitude_covariance_n_rad2)
            .square_stack(pitch.len(), 3)?;
        Ok::<_, Failure>((pitch, heading, covariance))
    };
    let (pitch, heading, covariance) = read().map_err(fail(py))?;
    let sigmas: Vec<[f64; 3]> = interruptible(py, move |_| {
        let angles = pitch.iter().zip(&heading);
        angles
            .zip(covariance.chunks_exact(9))
            .map(|((&pitch, &heading), p)| {
                let j = Euler::from_degrees(0.0, pitch, heading).by_rotation();
                let p = j * Matrix3::from_column_slice(p) * j.transpose();
                p.diagonal().map(|v| v.max(0.0).sqrt().to_degrees()).into()
            })
            .collect()
    })?;
    rows(py, sigmas.into_iter())
}
