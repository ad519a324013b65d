//! A heading or an attitude that is held while the body stands, and the measurement that it is still the same.

use super::super::measured::positive;
use super::{Any, Eskf, Given, GivenGate, word};
use crate::failure::{Failure, fail, refused};
use insnav_core::config::{Bookkeeping, HeadingRow};
use insnav_core::filter::{HELD_ATTITUDE, HELD_HEADING};
use insnav_core::measurement::{HeldAttitudeModel, HeldHeadingModel};
use insnav_core::time::Time;
use pyo3::prelude::*;

#[pymethods]
impl Eskf {
    /// Hold the heading that there is now: its error becomes a constant of its own ([Kozadaev17]).
    ///
    /// Parameters
    /// ----------
    /// bookkeeping : {"exact", "variance_only"}
    ///     Move all covariances, or the variance alone, as the paper has it.
    #[pyo3(signature = (bookkeeping="exact"))]
    fn hold_heading(&mut self, py: Python<'_>, bookkeeping: &str) -> PyResult<()> {
        let bookkeeping = self::bookkeeping(bookkeeping).map_err(fail(py))?;
        self.0
            .hold_heading(bookkeeping)
            .map_err(refused(py, Time(0)))
    }

    /// Hold the heading no longer: both parts are one error again.
    ///
    /// Parameters
    /// ----------
    /// bookkeeping : {"exact", "variance_only"}
    ///     That with which it was held.
    #[pyo3(signature = (bookkeeping="exact"))]
    fn release_heading(&mut self, py: Python<'_>, bookkeeping: &str) -> PyResult<()> {
        let bookkeeping = self::bookkeeping(bookkeeping).map_err(fail(py))?;
        self.is_held(py, true)?;
        self.0.release_heading(bookkeeping);
        Ok(())
    }

    /// The heading is what it was when :meth:`hold_heading` was called.
    ///
    /// Parameters
    /// ----------
    /// sigma : float
    ///     Standard deviation, rad.
    /// row : {"down", "euler"}
    ///     ``"down"`` is exact at any pitch, ``"euler"`` singular at ±90° ([Kozadaev17] eq. 13 to 15).
    /// time_s, gate
    ///     As of :meth:`update_gnss_position`.
    ///
    /// Returns
    /// -------
    /// Update
    ///     Residual, its standard deviation, NIS and verdict.
    #[pyo3(signature = (*, sigma, row="down", time_s=None, gate=None))]
    fn update_held_heading<'py>(
        &mut self,
        py: Python<'py>,
        sigma: f64,
        row: &str,
        time_s: Given<'_, 'py>,
        gate: GivenGate<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        self.is_held(py, true)?;
        let known = [("down", HeadingRow::Down), ("euler", HeadingRow::Euler)];
        let model = HeldHeadingModel {
            row: word("row", row, &known).map_err(fail(py))?,
            sigma: positive("sigma", sigma).map_err(fail(py))?,
        };
        self.weigh(py, &model, time_s, gate)
    }

    /// Hold the whole attitude that there is now.
    fn hold_attitude(&mut self, py: Python<'_>) -> PyResult<()> {
        self.0.hold_attitude().map_err(refused(py, Time(0)))
    }

    /// Hold the attitude no longer.
    fn release_attitude(&mut self, py: Python<'_>) -> PyResult<()> {
        self.is_held(py, false)?;
        self.0.release_attitude();
        Ok(())
    }

    /// The attitude is what it was when :meth:`hold_attitude` was called.
    ///
    /// Parameters
    /// ----------
    /// sigma : float
    ///     Standard deviation about each axis, rad.
    /// time_s, gate
    ///     As of :meth:`update_gnss_position`.
    ///
    /// Returns
    /// -------
    /// Update
    ///     Residual, its standard deviations, NIS and verdict.
    #[pyo3(signature = (*, sigma, time_s=None, gate=None))]
    fn update_held_attitude<'py>(
        &mut self,
        py: Python<'py>,
        sigma: f64,
        time_s: Given<'_, 'py>,
        gate: GivenGate<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        self.is_held(py, false)?;
        let sigma = positive("sigma", sigma).map_err(fail(py))?;
        self.weigh(py, &HeldAttitudeModel { sigma }, time_s, gate)
    }
}

impl Eskf {
    fn is_held(&self, py: Python<'_>, heading: bool) -> PyResult<()> {
        let layout = self.0.covariance().layout();
        let (held, how) = if heading {
            (layout.has(HELD_HEADING), "hold_heading")
        } else {
            (layout.has(HELD_ATTITUDE), "hold_attitude")
        };
        if held {
            return Ok(());
        }
        Err(fail(py)(Failure::new(
            "not_held",
            "nothing is held that could be compared with",
            format!("call {how}() first"),
        )))
    }
}

fn bookkeeping(given: &str) -> Result<Bookkeeping, Failure> {
    let known = [
        ("exact", Bookkeeping::Exact),
        ("variance_only", Bookkeeping::VarianceOnly),
    ];
    word("bookkeeping", given, &known)
}
