//! What really was, as the classes of `insnav._sim`: those are written in Python, so that they can be pickled.

use crate::arrays::{rows, scalars};
use insnav_core::attitude::Euler;
use insnav_core::imu::STANDARD_GRAVITY;
use insnav_core::metrics::ReferencePoint;
use insnav_core::sim::Truth;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// `insnav.sim.Truth`, with the columns of a solution.
pub(super) fn truth<'py>(
    py: Python<'py>,
    instants: &[(f64, Truth)],
) -> PyResult<Bound<'py, PyAny>> {
    const DEG_PER_HOUR: f64 = 180.0 / std::f64::consts::PI * 3600.0;
    const MG: f64 = 1e3 / STANDARD_GRAVITY;
    let fields = PyDict::new(py);
    let scalar = |name: &str, get: fn(&Truth) -> f64| {
        fields.set_item(name, scalars(py, instants.iter().map(|(_, t)| get(t)))?)
    };
    let vector = |name: &str, get: fn(&Truth) -> [f64; 3]| {
        fields.set_item(name, rows(py, instants.iter().map(|(_, t)| get(t)))?)
    };
    fields.set_item("time_s", scalars(py, instants.iter().map(|(s, _)| *s))?)?;
    scalar("latitude_deg", |t| t.nav.position.latitude_deg())?;
    scalar("longitude_deg", |t| t.nav.position.longitude_deg())?;
    scalar("height_m", |t| t.nav.position.height)?;
    vector("velocity_n_m_per_s", |t| t.nav.velocity_n.into())?;
    let quaternions = instants.iter().map(|(_, t)| {
        let q = t.nav.q_nb;
        [q.w, q.i, q.j, q.k]
    });
    fields.set_item("quaternion_nb_wxyz", rows(py, quaternions)?)?;
    let euler = |t: &Truth| Euler::from_quaternion(&t.nav.q_nb);
    let angles: Vec<Euler> = instants.iter().map(|(_, t)| euler(t)).collect();
    let angle = |name: &str, get: fn(&Euler) -> f64| {
        fields.set_item(name, scalars(py, angles.iter().map(get))?)
    };
    angle("roll_deg", |e| e.roll.to_degrees())?;
    angle("pitch_deg", |e| e.pitch.to_degrees())?;
    angle("heading_deg", Euler::heading_deg)?;
    vector("angular_rate_b_rad_per_s", |t| t.angular_rate_b.into())?;
    vector("specific_force_b_m_per_s2", |t| t.specific_force_b.into())?;
    vector("gyro_bias_deg_per_hour", |t| {
        (t.imu_errors.gyro_bias * DEG_PER_HOUR).into()
    })?;
    vector("accel_bias_mg", |t| (t.imu_errors.accel_bias * MG).into())?;
    let standing = instants.iter().map(|(_, t)| {
        let point = ReferencePoint {
            velocity_n: Some(t.nav.velocity_n),
            ..ReferencePoint::default()
        };
        point.standing() == Some(true)
    });
    fields.set_item("standing", scalars(py, standing)?)?;
    py.import("insnav._sim")?
        .getattr("Truth")?
        .call((), Some(&fields))
}
