//! Measurements of a body that moves, and those of the user's own.

use super::super::linear::Linear;
use super::super::measured::{covariance, positive};
use super::super::told;
use super::{Any, Eskf, Given, GivenGate, vector_or_zero};
use crate::arrays::Argument;
use crate::failure::{Failure, fail, refused};
use crate::geometry::nav_state::one_position;
use crate::geometry::rows::vector;
use insnav_core::filter;
use insnav_core::measurement::{
    GnssPositionModel, GnssVelocityModel, HeadingModel, HorizontalVelocityModel, LateralModel,
    NonholonomicModel,
};
use insnav_core::time::Time;
use nalgebra::Matrix2;
use pyo3::prelude::*;
use pyo3::types::PyMapping;
use std::f64::consts::TAU;

#[pymethods]
impl Eskf {
    /// Use a GNSS position: r = p_gnss − (p + C l), with the colour and the clock offset where these are estimated.
    ///
    /// Parameters
    /// ----------
    /// position : (3,)
    ///     Of the antenna: latitude and longitude, rad, and height above the ellipsoid, m.
    /// sigma : float or (3,)
    ///     Standard deviations, north-east-down, m; or
    /// covariance : (3, 3)
    ///     the whole covariance, m².
    /// lever_arm_b : (3,), default zero
    ///     Antenna from the IMU, b, m.
    /// dependence : float, default 1
    ///     Factor on the covariance in gate and gain, for errors shared with the fixes just before.
    /// position_alone : bool, default False
    ///     Correct the position and nothing else (a Schmidt update).
    /// time_s : float or numpy.datetime64, optional
    ///     Instant that the update tells; without it the filter's own.
    /// gate : Gate, optional
    ///     What decides whether it is used; without it everything is.
    ///
    /// Returns
    /// -------
    /// Update
    ///     Residual, its standard deviations, NIS and verdict.
    #[pyo3(signature = (position, *, sigma=None, covariance=None, lever_arm_b=None, dependence=1.0, position_alone=false, time_s=None, gate=None),
        text_signature = "($self, position, *, sigma=None, covariance=None, lever_arm_b=(0.0, 0.0, 0.0), dependence=1.0, position_alone=False, time_s=None, gate=None)")]
    #[allow(clippy::too_many_arguments)]
    fn update_gnss_position<'py>(
        &mut self,
        py: Python<'py>,
        position: &Any<'py>,
        sigma: Given<'_, 'py>,
        covariance: Given<'_, 'py>,
        lever_arm_b: Given<'_, 'py>,
        dependence: f64,
        position_alone: bool,
        time_s: Given<'_, 'py>,
        gate: GivenGate<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let make = || {
            Ok(GnssPositionModel {
                position: one_position("position", position)?,
                lever_arm_b: vector_or_zero("lever_arm_b", lever_arm_b)?,
                r: self::covariance(sigma, covariance)?,
                dependence: positive("dependence", dependence)?.max(1.0),
                position_alone,
            })
        };
        let model = make().map_err(fail(py))?;
        self.weigh(py, &model, time_s, gate)
    }

    /// Use a GNSS velocity: r = v_gnss − (v + C (ω_ib × l) − ω_ie × C l).
    ///
    /// Parameters
    /// ----------
    /// velocity_n : (3,)
    ///     Of the antenna over ground, north-east-down, m/s; down NaN: the two horizontal components alone.
    /// sigma : float or (3,)
    ///     Standard deviations, m/s; or
    /// covariance : (3, 3)
    ///     the whole covariance, m²/s².
    /// lever_arm_b : (3,), default zero
    ///     Antenna from the IMU, b, m.
    /// time_s, gate
    ///     As of :meth:`update_gnss_position`.
    ///
    /// Returns
    /// -------
    /// Update
    ///     Residual, its standard deviations, NIS and verdict.
    #[pyo3(signature = (velocity_n, *, sigma=None, covariance=None, lever_arm_b=None, time_s=None, gate=None),
        text_signature = "($self, velocity_n, *, sigma=None, covariance=None, lever_arm_b=(0.0, 0.0, 0.0), time_s=None, gate=None)")]
    #[allow(clippy::too_many_arguments)]
    fn update_gnss_velocity<'py>(
        &mut self,
        py: Python<'py>,
        velocity_n: &Any<'py>,
        sigma: Given<'_, 'py>,
        covariance: Given<'_, 'py>,
        lever_arm_b: Given<'_, 'py>,
        time_s: Given<'_, 'py>,
        gate: GivenGate<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let make = || {
            let velocity = Argument::new("velocity_n", velocity_n).column(Some(3))?;
            if !(velocity[0].is_finite() && velocity[1].is_finite() && !velocity[2].is_infinite()) {
                let expected = "finite numbers, down may be NaN";
                let received = format!("{velocity:?}");
                return Err(Failure::argument(
                    "bad_value",
                    "velocity_n",
                    received,
                    expected,
                    "",
                ));
            }
            Ok(GnssVelocityModel {
                velocity_n: vector(&velocity),
                lever_arm_b: vector_or_zero("lever_arm_b", lever_arm_b)?,
                r: self::covariance(sigma, covariance)?,
            })
        };
        let model: GnssVelocityModel = make().map_err(fail(py))?;
        if model.velocity_n.z.is_nan() {
            self.weigh(py, &HorizontalVelocityModel(model), time_s, gate)
        } else {
            self.weigh(py, &model, time_s, gate)
        }
    }

    /// Use a heading: r = ψ_fix − ψ. Singular at a pitch of ±90°.
    ///
    /// Parameters
    /// ----------
    /// heading : float
    ///     Clockwise from true north, rad; within a turn either way, so that degrees are not taken for it.
    /// sigma : float
    ///     Standard deviation, rad.
    /// time_s, gate
    ///     As of :meth:`update_gnss_position`.
    ///
    /// Returns
    /// -------
    /// Update
    ///     Residual, its standard deviation, NIS and verdict.
    #[pyo3(signature = (heading, *, sigma, time_s=None, gate=None))]
    fn update_heading<'py>(
        &mut self,
        py: Python<'py>,
        heading: f64,
        sigma: f64,
        time_s: Given<'_, 'py>,
        gate: GivenGate<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let sigma = positive("sigma", sigma).map_err(fail(py))?;
        if heading.is_finite() && heading.abs() > TAU {
            return Err(fail(py)(Failure::argument(
                "bad_value",
                "heading",
                heading.to_string(),
                "radians, within a turn either way",
                format!("if these are degrees, np.radians({heading})"),
            )));
        }
        self.weigh(py, &HeadingModel { heading, sigma }, time_s, gate)
    }

    /// A wheeled vehicle moves where its wheels point: across and upwards its velocity is zero ([Dissanayake01]).
    ///
    /// Parameters
    /// ----------
    /// sigma : float
    ///     Standard deviation of each component, m/s.
    /// axle_b : (3,), default zero
    ///     Middle of the axle that is not steered, from the IMU, b, m.
    /// lateral_only : bool, default False
    ///     Use the velocity across alone.
    /// time_s, gate
    ///     As of :meth:`update_gnss_position`.
    ///
    /// Returns
    /// -------
    /// Update
    ///     Residual, its standard deviations, NIS and verdict.
    #[pyo3(signature = (*, sigma, axle_b=None, lateral_only=false, time_s=None, gate=None),
        text_signature = "($self, *, sigma, axle_b=(0.0, 0.0, 0.0), lateral_only=False, time_s=None, gate=None)")]
    fn update_nonholonomic<'py>(
        &mut self,
        py: Python<'py>,
        sigma: f64,
        axle_b: Given<'_, 'py>,
        lateral_only: bool,
        time_s: Given<'_, 'py>,
        gate: GivenGate<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let make = || {
            let sigma = positive("sigma", sigma)?;
            Ok(NonholonomicModel {
                axle_b: vector_or_zero("axle_b", axle_b)?,
                r: Matrix2::from_diagonal_element(sigma * sigma),
            })
        };
        let model = make().map_err(fail(py))?;
        if lateral_only {
            self.weigh(py, &LateralModel(model), time_s, gate)
        } else {
            self.weigh(py, &model, time_s, gate)
        }
    }

    /// Use a measurement of your own: residual ≈ Σ H_block dx_block + v.
    ///
    /// Parameters
    /// ----------
    /// name : str
    ///     What reports call it. Names are kept for as long as the program runs.
    /// residual : (m,)
    ///     Measured minus predicted at the estimate of now (:attr:`nominal`), one to three components.
    /// h : mapping
    ///     Derivatives of the residual's model by the states of blocks, by name: shape (m, k) for a block of k states; blocks that are
    ///     absent do not act.
    /// r : (m, m)
    ///     Covariance of the noise v.
    /// time_s, gate
    ///     As of :meth:`update_gnss_position`.
    ///
    /// Returns
    /// -------
    /// Update
    ///     Residual, its standard deviations, NIS and verdict.
    ///
    /// Examples
    /// --------
    /// A barometer's height: Down is the third state of the position.
    ///
    /// >>> from insnav.filter import Eskf
    /// >>> from insnav.mechanization import NavState
    /// >>> start = NavState.from_degrees(50.0, 14.0, 300.0)
    /// >>> eskf = Eskf(start, "consumer", position_sigma=10.0, velocity_sigma=1.0, attitude_sigma=0.1)
    /// >>> residual = [-(301.0 - eskf.state.position[2])]
    /// >>> update = eskf.update_linear("barometer", residual, {"position": [[0.0, 0.0, 1.0]]}, [[0.25]])
    /// >>> round(float(eskf.state.position[2]), 3), round(float(eskf.sigma("position")[2]), 3)
    /// (300.998, 0.499)
    #[pyo3(signature = (name, residual, h, r, *, time_s=None, gate=None))]
    #[allow(clippy::too_many_arguments)]
    fn update_linear<'py>(
        &mut self,
        py: Python<'py>,
        name: &str,
        residual: &Any<'py>,
        h: &Bound<'py, PyMapping>,
        r: &Any<'py>,
        time_s: Given<'_, 'py>,
        gate: GivenGate<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let linear = Linear::read(&self.0, name, residual, h, r)?;
        let time = self.instant(time_s).map_err(fail(py))?;
        let told = match gate {
            Some(gate) => linear.update(&mut self.0, time, &mut gate.try_borrow_mut()?.0),
            None => linear.update(&mut self.0, time, &mut filter::Gate::open()),
        };
        told::update(py, &told.map_err(refused(py, Time(0)))?)
    }
}
