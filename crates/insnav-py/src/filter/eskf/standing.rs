//! Measurements of a body that stands.

use super::super::measured::{positive, sigmas};
use super::{Any, Eskf, Given, GivenGate, word};
use crate::failure::fail;
use crate::geometry::nav_state::one_vector;
use insnav_core::config::HeadingRateGain;
use insnav_core::measurement::{
    StandingForceModel, StandingRateModel, ZeroHeadingRateModel, ZeroVelocityModel,
};
use pyo3::prelude::*;

#[pymethods]
impl Eskf {
    /// The body stands: r = −v.
    ///
    /// Parameters
    /// ----------
    /// sigma : float
    ///     Standard deviation of each component, m/s.
    /// time_s, gate
    ///     As of :meth:`update_gnss_position`.
    ///
    /// Returns
    /// -------
    /// Update
    ///     Residual, its standard deviations, NIS and verdict.
    #[pyo3(signature = (*, sigma, time_s=None, gate=None))]
    fn update_zero_velocity<'py>(
        &mut self,
        py: Python<'py>,
        sigma: f64,
        time_s: Given<'_, 'py>,
        gate: GivenGate<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let sigma = positive("sigma", sigma).map_err(fail(py))?;
        self.weigh(py, &ZeroVelocityModel { sigma }, time_s, gate)
    }

    /// The body did not turn about Down over the interval just moved over: r = −(C ω − ω_ie)_D.
    ///
    /// Parameters
    /// ----------
    /// dt : float
    ///     Length of that interval, s.
    /// sigma : float, optional
    ///     Standard deviation of the rate over it, rad/s; without it what the gyros' white noise gives.
    /// gain : {"correlated", "naive", "bias_only"}
    ///     ``"correlated"`` knows that the noise of the rate has gone into the attitude as well; ``"naive"`` does not; ``"bias_only"``
    ///     corrects the gyro bias alone.
    /// time_s, gate
    ///     As of :meth:`update_gnss_position`.
    ///
    /// Returns
    /// -------
    /// Update
    ///     Residual, its standard deviation, NIS and verdict.
    #[pyo3(signature = (dt, *, sigma=None, gain="correlated", time_s=None, gate=None))]
    fn update_zero_heading_rate<'py>(
        &mut self,
        py: Python<'py>,
        dt: f64,
        sigma: Option<f64>,
        gain: &str,
        time_s: Given<'_, 'py>,
        gate: GivenGate<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let known = [
            ("correlated", HeadingRateGain::Correlated),
            ("naive", HeadingRateGain::Naive),
            ("bias_only", HeadingRateGain::BiasOnly),
        ];
        let make = || {
            let dt = positive("dt", dt)?;
            let sigma = sigma.unwrap_or_else(|| self.0.noise().gyro_white / dt.sqrt());
            Ok(ZeroHeadingRateModel {
                sigma: positive("sigma", sigma)?,
                dt,
                gain: word("gain", gain, &known)?,
            })
        };
        let model = make().map_err(fail(py))?;
        self.weigh(py, &model, time_s, gate)
    }

    /// The body stands: the mean specific force shows tilt and accelerometer errors, r = f̃ − ((1 + s_a)(−Cᵀ g) + b_a).
    ///
    /// Parameters
    /// ----------
    /// specific_force_b : (3,)
    ///     The mean as measured, m/s².
    /// sigma : float
    ///     Its standard deviation on each axis, m/s².
    /// time_s, gate
    ///     As of :meth:`update_gnss_position`.
    ///
    /// Returns
    /// -------
    /// Update
    ///     Residual, its standard deviations, NIS and verdict.
    #[pyo3(signature = (specific_force_b, *, sigma, time_s=None, gate=None))]
    fn update_standing_force<'py>(
        &mut self,
        py: Python<'py>,
        specific_force_b: &Any<'py>,
        sigma: f64,
        time_s: Given<'_, 'py>,
        gate: GivenGate<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let make = || {
            let sigma = positive("sigma", sigma)?;
            Ok(StandingForceModel {
                specific_force_b: one_vector("specific_force_b", specific_force_b)?,
                variance: sigma * sigma,
            })
        };
        let model = make().map_err(fail(py))?;
        self.weigh(py, &model, time_s, gate)
    }

    /// The body stands: the mean angular rate shows gyro errors and the heading, r = ω̃ − ((1 + s_g) Cᵀ ω_ie + b_g).
    ///
    /// Parameters
    /// ----------
    /// angular_rate_b : (3,)
    ///     The mean as measured, rad/s.
    /// sigma : float or (3,)
    ///     Its standard deviations, rad/s.
    /// earth_rate_tells : bool, default True
    ///     Whether the heading is known well enough to say where on the body the Earth's rate is; else sigma has to cover it.
    /// time_s, gate
    ///     As of :meth:`update_gnss_position`.
    ///
    /// Returns
    /// -------
    /// Update
    ///     Residual, its standard deviations, NIS and verdict.
    #[pyo3(signature = (angular_rate_b, *, sigma, earth_rate_tells=true, time_s=None, gate=None))]
    fn update_standing_rate<'py>(
        &mut self,
        py: Python<'py>,
        angular_rate_b: &Any<'py>,
        sigma: &Any<'py>,
        earth_rate_tells: bool,
        time_s: Given<'_, 'py>,
        gate: GivenGate<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let make = || {
            let sigma = sigmas("sigma", sigma, false)?;
            Ok(StandingRateModel {
                angular_rate_b: one_vector("angular_rate_b", angular_rate_b)?,
                variance: sigma.component_mul(&sigma),
                earth_rate_tells,
                by_heading: nalgebra::Vector3::zeros(),
            })
        };
        let model = make().map_err(fail(py))?;
        self.weigh(py, &model, time_s, gate)
    }
}
