//! `insnav.filter.Eskf`.
//!
//! The class and what its methods share. The methods are by theme: `state` makes a filter, tells what it is and keeps it, `propagation`
//! moves it, `measurements` are those of a body that moves and `standing` those of one that stands, `holds` is what is held meanwhile,
//! `priors` are blocks, covariances and calibration as told from outside.

mod holds;
mod measurements;
mod priors;
mod propagation;
mod standing;
mod state;

use super::gate::Gate;
use super::told;
use crate::arrays::Argument;
use crate::failure::{Failure, fail, refused};
use crate::geometry::nav_state::one_vector;
use insnav_core::filter::{self, Measurement};
use insnav_core::time::Time;
use nalgebra::Vector3;
use pyo3::prelude::*;

type Any<'py> = Bound<'py, PyAny>;
type Given<'a, 'py> = Option<&'a Bound<'py, PyAny>>;
type GivenGate<'a, 'py> = Option<&'a Bound<'py, Gate>>;

/// Error-state Kalman filter of a strapdown INS: 15 base states and optional blocks that open and close.
///
/// ``true = estimate ⊞ dx`` and ``residual = measured − predicted ≈ H dx + v``. The states are the errors of position (m,
/// north-east-down), velocity (m/s, n), attitude (rad, small rotation in n, tilt before turn: ``C = Exp(φ_D) Exp(φ_N, φ_E) Ĉ``), gyro bias (rad/s, b) and accelerometer bias
/// (m/s², b), then those of the blocks that are open, by name. In SI units and radians. A filter pickles and copies to the last bit.
///
/// Parameters
/// ----------
/// start : NavState
///     Where the body is, how it moves and how it is turned.
/// noise : str or ImuNoise
///     Class of the inertial unit, or its noise.
/// position_sigma, velocity_sigma, attitude_sigma : float or (3,)
///     Standard deviations of the start: m and m/s along north, east, down; rad about them.
/// gyro_bias, accel_bias : (3,), default zero
///     Biases as known, rad/s and m/s², measured minus true.
/// gyro_bias_sigma, accel_bias_sigma : float or (3,), optional
///     Their standard deviations; without them those of ``noise``.
/// gyro_scale, accel_scale : (3,), default zero
///     Scale factor errors as known: measured = (1 + s) true.
///
/// Examples
/// --------
/// >>> import numpy as np
/// >>> from insnav import earth
/// >>> from insnav.filter import Eskf
/// >>> from insnav.mechanization import NavState
/// >>> start = NavState.from_degrees(50.0, 14.0, 300.0, heading_deg=90.0)
/// >>> eskf = Eskf(start, "industrial", position_sigma=1.0, velocity_sigma=0.1, attitude_sigma=[0.01, 0.01, 0.1])
/// >>> still = np.tile([0.0, 0.0, -0.01 * earth.gravity(np.radians(50.0), 300.0)], (100, 1))
/// >>> eskf.propagate(0.01, np.zeros((100, 3)), still)
/// >>> update = eskf.update_zero_velocity(sigma=0.01)
/// >>> update.verdict, bool(eskf.sigma("velocity")[0] < 0.02)
/// ('accepted', True)
#[pyclass(module = "insnav.filter")]
pub(crate) struct Eskf(pub(crate) filter::Eskf);

impl Eskf {
    /// Weigh a measurement; without a gate everything is used.
    pub(super) fn weigh<'py, const M: usize>(
        &mut self,
        py: Python<'py>,
        model: &impl Measurement<M>,
        time_s: Given<'_, 'py>,
        gate: GivenGate<'_, 'py>,
    ) -> PyResult<Any<'py>> {
        let time = self.instant(time_s).map_err(fail(py))?;
        let told = match gate {
            Some(gate) => self.0.update(model, time, &mut gate.try_borrow_mut()?.0),
            None => self.0.update(model, time, &mut filter::Gate::open()),
        };
        told::update(py, &told.map_err(refused(py, Time(0)))?)
    }

    /// That of a measurement; the filter's own where nothing is said.
    pub(super) fn instant(&self, time_s: Given<'_, '_>) -> Result<Time, Failure> {
        time_s.map_or(Ok(self.0.nominal().nav.time), |t| {
            Argument::new("time_s", t).instant()
        })
    }
}

fn vector_or_zero(name: &str, given: Given<'_, '_>) -> Result<Vector3<f64>, Failure> {
    given.map_or(Ok(Vector3::zeros()), |v| one_vector(name, v))
}

fn word<T>(argument: &str, given: &str, known: &[(&str, T)]) -> Result<T, Failure>
where
    T: Copy,
{
    let found = known.iter().find(|(name, _)| *name == given);
    found.map(|(_, value)| *value).ok_or_else(|| {
        let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
        Failure::argument(
            "bad_option",
            argument,
            format!("{given:?}"),
            format!("one of {}", names.join(", ")),
            "",
        )
    })
}
