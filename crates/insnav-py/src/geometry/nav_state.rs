//! `insnav.mechanization.NavState`.

use super::earth::{geodetic, of_geodetic, positions};
use super::rows::{Rows, quaternion, shaped, vector, wxyz};
use crate::arrays::Argument;
use crate::failure::{Failure, fail};
use crate::pickle;
use insnav_core::attitude::Euler;
use insnav_core::earth::Geodetic;
use insnav_core::mechanization::{self, Increment};
use insnav_core::time::Time;
use nalgebra::{UnitQuaternion, Vector3};
use pyo3::prelude::*;
use pyo3::types::PyTuple;

type Array<'py> = PyResult<Bound<'py, PyAny>>;

/// Position, velocity and attitude at one instant; never changes.
///
/// Parameters
/// ----------
/// position : (3,)
///     Latitude and longitude, rad, and height above the ellipsoid, m.
/// velocity_n : (3,)
///     Velocity over ground, north-east-down, m/s.
/// q_nb : (4,)
///     Quaternion (w, x, y, z) that takes vectors from b (forward-right-down) to n.
/// time_s : float or numpy.datetime64, default 0
///     The instant.
///
/// Examples
/// --------
/// >>> from insnav.mechanization import NavState
/// >>> at_rest = NavState.from_degrees(50.0, 14.0, 300.0, heading_deg=90.0)
/// >>> at_rest.advance(0.01, rotation_b=[0.0, 0.0, 0.0], velocity_b=[0.0, 0.0, -0.0981]).time_s
/// 0.01
#[pyclass(frozen, eq, module = "insnav.mechanization")]
#[derive(Clone, Copy, PartialEq)]
pub(crate) struct NavState(pub(crate) mechanization::NavState);

fn alone<'py>(rows: Rows<'py>, name: &str, row: &str) -> Result<Rows<'py>, Failure> {
    if rows.lead.is_empty() {
        return Ok(rows);
    }
    let lead: Vec<String> = rows.lead.iter().map(usize::to_string).collect();
    Err(Failure::argument(
        "wrong_shape",
        name,
        format!("{} rows", lead.join(" by ")),
        format!("one row, {row}"),
        "",
    ))
}

/// One vector of finite numbers.
pub(crate) fn one_vector(name: &str, object: &Bound<'_, PyAny>) -> Result<Vector3<f64>, Failure> {
    let rows = alone(Rows::vectors(name, object)?, name, "(3,)")?;
    rows.finite()?;
    Ok(vector(rows.values()))
}

/// One attitude.
pub(crate) fn one_quaternion(
    name: &str,
    object: &Bound<'_, PyAny>,
) -> Result<UnitQuaternion<f64>, Failure> {
    let rows = alone(Rows::quaternions(name, object)?, name, "(4,)")?;
    Ok(quaternion(rows.values()))
}

/// One position: latitude and longitude in radians, height in metres.
pub(crate) fn one_position(name: &str, object: &Bound<'_, PyAny>) -> Result<Geodetic, Failure> {
    let rows = alone(positions(name, object)?, name, "(3,)")?;
    Ok(geodetic(rows.values()))
}

/// Length of an interval, s.
pub(crate) fn interval(dt: f64) -> Result<f64, Failure> {
    if dt.is_finite() && dt >= 0.0 {
        return Ok(dt);
    }
    let expected = "seconds, finite and not negative";
    Err(Failure::argument(
        "bad_value",
        "dt",
        dt.to_string(),
        expected,
        "",
    ))
}

#[pymethods]
impl NavState {
    #[new]
    #[pyo3(signature = (position, velocity_n, q_nb, *, time_s=None), text_signature = "(position, velocity_n, q_nb, *, time_s=0.0)")]
    fn new(
        position: &Bound<'_, PyAny>,
        velocity_n: &Bound<'_, PyAny>,
        q_nb: &Bound<'_, PyAny>,
        time_s: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let py = position.py();
        let make = || {
            Ok(NavState(mechanization::NavState {
                time: time_s.map_or(Ok(Time(0)), |t| Argument::new("time_s", t).instant())?,
                position: one_position("position", position)?,
                velocity_n: one_vector("velocity_n", velocity_n)?,
                q_nb: one_quaternion("q_nb", q_nb)?,
            }))
        };
        make().map_err(fail(py))
    }

    /// A state from degrees.
    ///
    /// Parameters
    /// ----------
    /// latitude_deg, longitude_deg : float
    ///     Geodetic latitude and longitude, degrees.
    /// height_m : float
    ///     Height above the ellipsoid, m.
    /// velocity_n_m_per_s : (3,), default zero
    ///     Velocity over ground, north-east-down, m/s.
    /// roll_deg, pitch_deg, heading_deg : float, default 0
    ///     Attitude, degrees; heading clockwise from true north.
    /// time_s : float or numpy.datetime64, default 0
    ///     The instant.
    ///
    /// Returns
    /// -------
    /// NavState
    ///     The same in radians.
    #[staticmethod]
    #[pyo3(signature = (latitude_deg, longitude_deg, height_m, velocity_n_m_per_s=None, *, roll_deg=0.0, pitch_deg=0.0,
        heading_deg=0.0, time_s=None),
        text_signature = "(latitude_deg, longitude_deg, height_m, velocity_n_m_per_s=(0.0, 0.0, 0.0), *, roll_deg=0.0, pitch_deg=0.0, heading_deg=0.0, time_s=0.0)")]
    // One argument each of the Python function.
    #[allow(clippy::too_many_arguments)]
    fn from_degrees(
        py: Python<'_>,
        latitude_deg: f64,
        longitude_deg: f64,
        height_m: f64,
        velocity_n_m_per_s: Option<&Bound<'_, PyAny>>,
        roll_deg: f64,
        pitch_deg: f64,
        heading_deg: f64,
        time_s: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let position = Geodetic::from_degrees(latitude_deg, longitude_deg, height_m);
        let angles = [roll_deg, pitch_deg, heading_deg];
        if !position.is_valid() || angles.iter().any(|a| !a.is_finite()) {
            return Err(fail(py)(Failure::argument(
                "bad_value",
                "latitude_deg, longitude_deg, height_m, roll_deg, pitch_deg, heading_deg",
                format!(
                    "[{latitude_deg}, {longitude_deg}, {height_m}, {roll_deg}, {pitch_deg}, {heading_deg}]"
                ),
                "degrees and metres, finite, a latitude up to 90",
                "",
            )));
        }
        let make = || {
            Ok(NavState(mechanization::NavState {
                time: time_s.map_or(Ok(Time(0)), |t| Argument::new("time_s", t).instant())?,
                position,
                velocity_n: velocity_n_m_per_s.map_or(Ok(Vector3::zeros()), |v| {
                    one_vector("velocity_n_m_per_s", v)
                })?,
                q_nb: Euler::from_degrees(roll_deg, pitch_deg, heading_deg).to_quaternion(),
            }))
        };
        make().map_err(fail(py))
    }

    /// The instant, s.
    #[getter]
    fn time_s(&self) -> f64 {
        self.0.time.since(Time(0))
    }

    /// The instant, ns, exact.
    #[getter]
    fn time_ns(&self) -> i64 {
        self.0.time.0
    }

    /// Latitude and longitude, rad, and height above the ellipsoid, m, shape (3,).
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Array<'py> {
        shaped(py, of_geodetic(&self.0.position).to_vec(), &[], &[3])
    }

    /// Velocity over ground, north-east-down, m/s, shape (3,).
    #[getter]
    fn velocity_n<'py>(&self, py: Python<'py>) -> Array<'py> {
        shaped(py, self.0.velocity_n.as_slice().to_vec(), &[], &[3])
    }

    /// Unit quaternion (w, x, y, z) that takes vectors from b to n, shape (4,).
    #[getter]
    fn q_nb<'py>(&self, py: Python<'py>) -> Array<'py> {
        shaped(py, wxyz(&self.0.q_nb).to_vec(), &[], &[4])
    }

    /// Roll, pitch and heading, rad, shape (3,).
    #[getter]
    fn euler<'py>(&self, py: Python<'py>) -> Array<'py> {
        let e = Euler::from_quaternion(&self.0.q_nb);
        shaped(py, vec![e.roll, e.pitch, e.heading], &[], &[3])
    }

    /// The state one increment later (sensor errors already taken out).
    ///
    /// NED mechanization ([Groves13] section 5.4, [Savage98b]): the velocity gain is rotated by the whole left Jacobian of the rotation,
    /// gravity, Coriolis and both frame rates are taken in the middle of the interval. Stays below 89° of latitude.
    ///
    /// Parameters
    /// ----------
    /// dt : float
    ///     Length of the interval, s.
    /// rotation_b : (3,)
    ///     Rotation vector of the body against inertial space, coning inside, rad.
    /// velocity_b : (3,)
    ///     Velocity increment of specific force in the axes of the turning body, sculling inside, m/s.
    ///
    /// Returns
    /// -------
    /// NavState
    ///     The new state; this one stays as it is.
    fn advance(
        &self,
        dt: f64,
        rotation_b: &Bound<'_, PyAny>,
        velocity_b: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let make = || {
            let dt = interval(dt)?;
            let mut nav = self.0;
            nav.advance(&Increment {
                time: nav.time.plus(dt),
                dt,
                rotation_b: one_vector("rotation_b", rotation_b)?,
                velocity_b: one_vector("velocity_b", velocity_b)?,
            });
            Ok(NavState(nav))
        };
        make().map_err(fail(rotation_b.py()))
    }

    fn __repr__(&self) -> String {
        let nav = &self.0;
        let e = Euler::from_quaternion(&nav.q_nb);
        format!(
            "<insnav.NavState at {:.6} s: {:.7} deg, {:.7} deg, {:.3} m; [{:.3}, {:.3}, {:.3}] m/s; roll {:.3} deg, pitch {:.3} deg, heading {:.3} deg>",
            self.time_s(),
            nav.position.latitude_deg(),
            nav.position.longitude_deg(),
            nav.position.height,
            nav.velocity_n.x,
            nav.velocity_n.y,
            nav.velocity_n.z,
            e.roll.to_degrees(),
            e.pitch.to_degrees(),
            e.heading_deg(),
        )
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyTuple>> {
        pickle::reduce(slf, &slf.get().0)
    }

    #[staticmethod]
    fn _from_state(state: &[u8]) -> PyResult<Self> {
        pickle::load::<Self, _>(state).map(NavState)
    }
}
