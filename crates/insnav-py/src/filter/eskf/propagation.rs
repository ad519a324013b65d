//! A filter moved over time: increments, standing, staying, gaps.

use super::super::measured::positive;
use super::{Any, Eskf, word};
use crate::failure::fail;
use crate::geometry::mechanization::Steps;
use crate::geometry::nav_state::interval;
use crate::interrupt::Signals;
use insnav_core::config::StandingForce;
use insnav_core::filter::Settling;
use pyo3::prelude::*;

#[pymethods]
impl Eskf {
    /// Move over increments as measured (sensor errors inside): strapdown, and the covariance with it. Other threads run meanwhile; an
    /// interruption (Ctrl-C) leaves the filter behind the increments that it had taken by then.
    ///
    /// Parameters
    /// ----------
    /// dt : float or (n,)
    ///     Lengths of the intervals, s.
    /// rotation_b : (3,) or (n, 3)
    ///     Rotation vectors of the body against inertial space, rad (:func:`insnav.mechanization.increments`).
    /// velocity_b : (3,) or (n, 3)
    ///     Velocity increments of specific force in the axes of the turning body, m/s.
    fn propagate(
        &mut self,
        py: Python<'_>,
        dt: &Any<'_>,
        rotation_b: &Any<'_>,
        velocity_b: &Any<'_>,
    ) -> PyResult<()> {
        let steps = Steps::new(dt, rotation_b, velocity_b).map_err(fail(py))?;
        let (count, numbers) = (steps.count, steps.numbers());
        let filter = &mut self.0;
        py.detach(|| {
            let mut signals = Signals::new();
            for row in 0..count {
                signals.look()?;
                filter.propagate(&numbers.increment(row, filter.nominal().nav.time));
            }
            Ok(())
        })
    }

    /// As :meth:`propagate`, for a body that stands.
    ///
    /// Parameters
    /// ----------
    /// dt, rotation_b, velocity_b
    ///     As of :meth:`propagate`.
    /// force : {"gravity", "measured"}
    ///     Specific force as the error dynamics see it: that of a body at rest, or the measured one, whose noise makes the heading
    ///     falsely observable.
    #[pyo3(signature = (dt, rotation_b, velocity_b, *, force="gravity"))]
    fn propagate_standing(
        &mut self,
        py: Python<'_>,
        dt: &Any<'_>,
        rotation_b: &Any<'_>,
        velocity_b: &Any<'_>,
        force: &str,
    ) -> PyResult<()> {
        let steps = Steps::new(dt, rotation_b, velocity_b).map_err(fail(py))?;
        let known = [
            ("gravity", StandingForce::Gravity),
            ("measured", StandingForce::Measured),
        ];
        let force = word("force", force, &known).map_err(fail(py))?;
        let (count, numbers) = (steps.count, steps.numbers());
        let filter = &mut self.0;
        py.detach(|| {
            let mut signals = Signals::new();
            for row in 0..count {
                signals.look()?;
                let increment = numbers.increment(row, filter.nominal().nav.time);
                filter.propagate_standing(&increment, force);
            }
            Ok(())
        })
    }

    /// Stay where the body is for a while: position and attitude constant but for random walks, velocity zero.
    ///
    /// Parameters
    /// ----------
    /// dt : float
    ///     For so long, s.
    /// attitude_walk, position_walk : float, default 0
    ///     Random walks of attitude, rad/√s, and of position, m/√s, on each axis.
    #[pyo3(signature = (dt, *, attitude_walk=0.0, position_walk=0.0))]
    fn stay(
        &mut self,
        py: Python<'_>,
        dt: f64,
        attitude_walk: f64,
        position_walk: f64,
    ) -> PyResult<()> {
        let dt = interval(dt).map_err(fail(py))?;
        let settling = Settling {
            attitude: attitude_walk,
            position: position_walk,
        };
        for (name, walk) in [
            ("attitude_walk", attitude_walk),
            ("position_walk", position_walk),
        ] {
            if walk != 0.0 {
                positive(name, walk).map_err(fail(py))?;
            }
        }
        self.0
            .stay(self.0.nominal().nav.time.plus(dt), dt, &settling);
        Ok(())
    }

    /// Widen the uncertainty for a stretch in which nobody saw what the body did.
    ///
    /// A stretch with a measurement inside is two: what comes after the measurement is widened after it.
    ///
    /// Parameters
    /// ----------
    /// dt : float
    ///     Its length, s.
    /// rate_sigma, force_sigma : float
    ///     By how much rate (rad/s) and specific force (m/s²) may have been wrong all along, one sigma.
    fn bridge(
        &mut self,
        py: Python<'_>,
        dt: f64,
        rate_sigma: f64,
        force_sigma: f64,
    ) -> PyResult<()> {
        let checked = interval(dt)
            .and_then(|_| positive("rate_sigma", rate_sigma))
            .and_then(|_| positive("force_sigma", force_sigma));
        checked.map_err(fail(py))?;
        self.0.bridge(dt, rate_sigma, force_sigma);
        Ok(())
    }
}
