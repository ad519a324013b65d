//! A filter made, looked at, moved by hand and kept.

use super::super::blocks::{dense, range};
use super::super::measured::sigmas;
use super::super::noise::{imu_noise, told as told_noise};
use super::super::told;
use super::{Any, Eskf, Given, vector_or_zero};
use crate::arrays::Argument;
use crate::failure::{Failure, fail};
use crate::geometry::nav_state::NavState;
use crate::geometry::rows::shaped;
use crate::pickle;
use insnav_core::filter::{self, CAPACITY, InitialSigma};
use insnav_core::imu::ImuErrors;
use insnav_core::time::Time;
use nalgebra::Vector3;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PySlice, PyTuple};

#[pymethods]
impl Eskf {
    #[new]
    #[pyo3(signature = (start, noise, *, position_sigma, velocity_sigma, attitude_sigma, gyro_bias=None, accel_bias=None,
        gyro_bias_sigma=None, accel_bias_sigma=None, gyro_scale=None, accel_scale=None),
        text_signature = "(start, noise, *, position_sigma, velocity_sigma, attitude_sigma, gyro_bias=(0.0, 0.0, 0.0), accel_bias=(0.0, 0.0, 0.0), gyro_bias_sigma=None, accel_bias_sigma=None, gyro_scale=(0.0, 0.0, 0.0), accel_scale=(0.0, 0.0, 0.0))")]
    // One argument each of the Python function.
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        start: &Bound<'_, NavState>,
        noise: &Any<'_>,
        position_sigma: &Any<'_>,
        velocity_sigma: &Any<'_>,
        attitude_sigma: &Any<'_>,
        gyro_bias: Given<'_, '_>,
        accel_bias: Given<'_, '_>,
        gyro_bias_sigma: Given<'_, '_>,
        accel_bias_sigma: Given<'_, '_>,
        gyro_scale: Given<'_, '_>,
        accel_scale: Given<'_, '_>,
    ) -> PyResult<Self> {
        let noise = imu_noise("noise", noise)?;
        let make = || {
            let bias_sigma = |name: &str, given: Given<'_, '_>, class: f64| {
                given.map_or(Ok(Vector3::repeat(class)), |s| sigmas(name, s, true))
            };
            let sigma = InitialSigma {
                position: sigmas("position_sigma", position_sigma, true)?,
                velocity: sigmas("velocity_sigma", velocity_sigma, true)?,
                attitude: sigmas("attitude_sigma", attitude_sigma, true)?,
                gyro_bias: bias_sigma("gyro_bias_sigma", gyro_bias_sigma, noise.gyro_bias_sigma)?,
                accel_bias: bias_sigma(
                    "accel_bias_sigma",
                    accel_bias_sigma,
                    noise.accel_bias_sigma,
                )?,
            };
            let errors = ImuErrors {
                gyro_bias: vector_or_zero("gyro_bias", gyro_bias)?,
                accel_bias: vector_or_zero("accel_bias", accel_bias)?,
                gyro_scale: vector_or_zero("gyro_scale", gyro_scale)?,
                accel_scale: vector_or_zero("accel_scale", accel_scale)?,
            };
            Ok(Eskf(filter::Eskf::new(
                start.get().0,
                errors,
                &sigma,
                noise,
            )))
        };
        make().map_err(fail(py))
    }

    /// The estimate (:class:`insnav.filter.Nominal`): state, sensor errors, calibration.
    #[getter]
    fn nominal<'py>(&self, py: Python<'py>) -> PyResult<Any<'py>> {
        told::nominal(py, self.0.nominal())
    }

    /// Position, velocity and attitude as estimated (:class:`insnav.mechanization.NavState`).
    #[getter]
    fn state(&self) -> NavState {
        NavState(self.0.nominal().nav)
    }

    /// Instant of the estimate, s.
    #[getter]
    fn time_s(&self) -> f64 {
        self.0.nominal().nav.time.since(Time(0))
    }

    /// Noise of the inertial unit (:class:`insnav.filter.ImuNoise`).
    #[getter]
    fn noise<'py>(&self, py: Python<'py>) -> PyResult<Any<'py>> {
        told_noise(py, self.0.noise())
    }

    /// Covariance of all open states, shape (n, n).
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Any<'py>> {
        let n = self.0.covariance().layout().len();
        self.square_of(py, 0..n, 0..n)
    }

    /// Covariance of the base states, shape (15, 15), with the whole attitude error where part of it is held.
    #[getter]
    fn base_covariance<'py>(&self, py: Python<'py>) -> PyResult<Any<'py>> {
        let p = self.0.base_covariance();
        shaped(py, p.transpose().as_slice().to_vec(), &[], &[15, 15])
    }

    /// Where each open block stands among the states: a dictionary of slices, in the order of the states.
    #[getter]
    fn blocks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let blocks = PyDict::new(py);
        for (info, range) in self.0.covariance().layout().names() {
            let slice = PySlice::new(py, range.start as isize, range.end as isize, 1);
            blocks.set_item(info.name, slice)?;
        }
        Ok(blocks)
    }

    /// Number of states, that is of rows of the covariance.
    fn __len__(&self) -> usize {
        self.0.covariance().layout().len()
    }

    /// Covariance within a block, or between two.
    ///
    /// Parameters
    /// ----------
    /// rows : str
    ///     Name of a block that is open.
    /// columns : str, optional
    ///     Another one; without it the same.
    ///
    /// Returns
    /// -------
    /// (k, l)
    ///     That part of the covariance.
    #[pyo3(signature = (rows, columns=None))]
    fn covariance_of<'py>(
        &self,
        py: Python<'py>,
        rows: &str,
        columns: Option<&str>,
    ) -> PyResult<Any<'py>> {
        let find = |argument, name| range(&self.0, argument, name).map_err(fail(py));
        let rows = find("rows", rows)?;
        let columns = match columns {
            Some(name) => find("columns", name)?,
            None => rows.clone(),
        };
        self.square_of(py, rows, columns)
    }

    /// Standard deviations.
    ///
    /// Parameters
    /// ----------
    /// name : str
    ///     Name of an open block, or ``"heading"``: the rotation about Down, what is held of it included.
    ///
    /// Returns
    /// -------
    /// (k,) or float
    ///     In the units of the states.
    fn sigma<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Any<'py>> {
        if name == "heading" {
            let variance = self.0.attitude_covariance_n()[(2, 2)];
            return shaped(py, vec![variance.max(0.0).sqrt()], &[], &[]);
        }
        let range = range(&self.0, "name", name).map_err(fail(py))?;
        let p = dense(&self.0);
        let n = range.len();
        let sigmas = range.map(|i| p[(i, i)].max(0.0).sqrt()).collect();
        shaped(py, sigmas, &[], &[n])
    }

    /// Take the truth to be ``dx`` away: the estimate moves (⊞), the covariance stays.
    ///
    /// For corrections found elsewhere, and for numerical derivatives.
    ///
    /// Parameters
    /// ----------
    /// dx : (n,)
    ///     Errors of all open states.
    fn retract(&mut self, py: Python<'_>, dx: &Any<'_>) -> PyResult<()> {
        let dx = self.states("dx", dx).map_err(fail(py))?;
        self.0.retract(&dx);
        Ok(())
    }

    /// The error of this estimate if another's is the truth (⊟), the inverse of :meth:`retract`.
    ///
    /// Parameters
    /// ----------
    /// truth : Eskf
    ///     A filter whose estimate is taken for the truth.
    ///
    /// Returns
    /// -------
    /// (n,)
    ///     Errors of all states that are open here.
    fn local<'py>(slf: &Bound<'py, Self>, truth: &Bound<'py, Self>) -> PyResult<Any<'py>> {
        let (own, truth) = (slf.try_borrow()?, truth.try_borrow()?);
        let layout = own.0.covariance().layout();
        let dx = own.0.nominal().local(layout, truth.0.nominal());
        let n = layout.len();
        shaped(slf.py(), dx[..n].to_vec(), &[], &[n])
    }

    fn __repr__(&self) -> String {
        let layout = self.0.covariance().layout();
        let optional: Vec<&str> = layout.names().skip(5).map(|(info, _)| info.name).collect();
        let optional = match optional.as_slice() {
            [] => String::new(),
            names => format!(", with {}", names.join(", ")),
        };
        format!(
            "<insnav.filter.Eskf at {:.6} s: {} states{optional}>",
            self.time_s(),
            layout.len()
        )
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        pickle::reduce(slf, &slf.try_borrow()?.0)
    }

    #[staticmethod]
    fn _from_state(state: &[u8]) -> PyResult<Self> {
        pickle::load::<Self, _>(state).map(Eskf)
    }
}

impl Eskf {
    fn states(&self, name: &str, dx: &Any<'_>) -> Result<filter::States, Failure> {
        let n = self.0.covariance().layout().len();
        let given = Argument::new(name, dx).column(Some(n))?;
        if let Some(at) = given.iter().position(|x| !x.is_finite()) {
            let received = format!("{} at {at}", given[at]);
            return Err(Failure::argument(
                "bad_value",
                name,
                received,
                "finite numbers",
                "",
            ));
        }
        let mut states = [0.0; CAPACITY];
        states[..n].copy_from_slice(&given);
        Ok(states)
    }

    fn square_of<'py>(
        &self,
        py: Python<'py>,
        rows: std::ops::Range<usize>,
        columns: std::ops::Range<usize>,
    ) -> PyResult<Any<'py>> {
        let p = dense(&self.0);
        let shape = [rows.len(), columns.len()];
        let values = rows
            .flat_map(|i| columns.clone().map(move |j| (i, j)))
            .map(|at| p[at])
            .collect();
        shaped(py, values, &[], &shape)
    }
}
