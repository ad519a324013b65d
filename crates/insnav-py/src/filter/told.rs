//! Results of the filter, as the classes of `insnav._filter`.

use crate::geometry::nav_state::NavState;
use crate::geometry::rows::{shaped, wxyz};
use insnav_core::filter::{Nominal, Update, Verdict};
use insnav_core::time::Time;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// One of the classes of `insnav._filter`, by the names of its fields.
fn make<'py>(
    py: Python<'py>,
    class: &str,
    fields: &Bound<'py, PyDict>,
) -> PyResult<Bound<'py, PyAny>> {
    py.import("insnav._filter")?
        .getattr(class)?
        .call((), Some(fields))
}

/// `insnav.filter.Update`.
pub(super) fn update<'py>(py: Python<'py>, update: &Update) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyDict::new(py);
    let few = |values: &[f64; 3]| shaped(py, values[..update.dof].to_vec(), &[], &[update.dof]);
    fields.set_item("time_s", update.time.since(Time(0)))?;
    fields.set_item("measurement", update.measurement)?;
    fields.set_item("dof", update.dof)?;
    fields.set_item("residual", few(&update.residual)?)?;
    fields.set_item("sigma", few(&update.sigma)?)?;
    fields.set_item("nis", update.nis)?;
    let verdict = match update.verdict {
        Verdict::Accepted => "accepted",
        Verdict::Inflated => "inflated",
        Verdict::Rejected => "rejected",
        Verdict::Reset => "reset",
        Verdict::Frozen => "frozen",
    };
    fields.set_item("verdict", verdict)?;
    make(py, "Update", &fields)
}

/// `insnav.filter.Nominal`.
pub(super) fn nominal<'py>(py: Python<'py>, nominal: &Nominal) -> PyResult<Bound<'py, PyAny>> {
    let fields = PyDict::new(py);
    let (errors, calibration) = (&nominal.imu_errors, &nominal.calibration);
    fields.set_item("nav", Bound::new(py, NavState(nominal.nav))?)?;
    for (name, vector) in [
        ("gyro_bias", &errors.gyro_bias),
        ("accel_bias", &errors.accel_bias),
        ("gyro_scale", &errors.gyro_scale),
        ("accel_scale", &errors.accel_scale),
        ("rate_b", &nominal.rate_b),
        ("acceleration_n", &nominal.acceleration_n),
        ("lever_arm_b", &calibration.lever_arm_b),
        ("gnss_colour_n", &calibration.gnss_colour_n),
    ] {
        fields.set_item(name, shaped(py, vector.as_slice().to_vec(), &[], &[3])?)?;
    }
    let mounting = calibration.mounting.as_slice().to_vec();
    fields.set_item("mounting", shaped(py, mounting, &[], &[2])?)?;
    fields.set_item("axle_forward", calibration.axle_forward)?;
    fields.set_item("odometer_scale", calibration.odometer_scale)?;
    fields.set_item("clock_offset", calibration.clock_offset)?;
    let held = wxyz(&nominal.held_q_nb).to_vec();
    fields.set_item("held_q_nb", shaped(py, held, &[], &[4])?)?;
    make(py, "Nominal", &fields)
}
