//! Noise of an inertial unit from Python.

use crate::failure::{Failure, fail};
use insnav_core::imu::{ImuGrade, ImuNoise};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};

const FIELDS: [&str; 6] = [
    "gyro_white",
    "accel_white",
    "gyro_bias_sigma",
    "accel_bias_sigma",
    "gyro_bias_tau",
    "accel_bias_tau",
];

/// A class by its name, or an `insnav.filter.ImuNoise`.
pub(crate) fn imu_noise(name: &str, given: &Bound<'_, PyAny>) -> PyResult<ImuNoise> {
    let fail = fail(given.py());
    if let Ok(grade) = given.cast::<PyString>() {
        return of_grade(name, grade.to_str()?).map_err(fail);
    }
    let mut values = [0.0; 6];
    for (field, value) in FIELDS.iter().zip(&mut values) {
        *value = given
            .getattr(*field)
            .and_then(|v| v.extract::<f64>())
            .map_err(|_| {
                fail(Failure::argument(
                    "bad_value",
                    name,
                    format!("{}", given.get_type()),
                    "an insnav.filter.ImuNoise, or the name of a class",
                    "ImuNoise.from_data_sheet takes the units of data sheets",
                ))
            })?;
        let is_tau = field.ends_with("tau");
        if value.is_nan()
            || *value < 0.0
            || (*value == 0.0 && is_tau)
            || (value.is_infinite() && !is_tau)
        {
            let expected = "not negative, correlation times above 0";
            let received = value.to_string();
            let argument = format!("{name}.{field}");
            return Err(fail(Failure::argument(
                "bad_value",
                &argument,
                received,
                expected,
                "",
            )));
        }
    }
    let [
        gyro_white,
        accel_white,
        gyro_bias_sigma,
        accel_bias_sigma,
        gyro_bias_tau,
        accel_bias_tau,
    ] = values;
    Ok(ImuNoise {
        gyro_white,
        accel_white,
        gyro_bias_sigma,
        accel_bias_sigma,
        gyro_bias_tau,
        accel_bias_tau,
    })
}

fn of_grade(argument: &str, name: &str) -> Result<ImuNoise, Failure> {
    let grade = ImuGrade::ALL.iter().find(|g| g.name() == name);
    grade.map(|g| g.noise()).ok_or_else(|| {
        let known = ImuGrade::ALL.map(ImuGrade::name).join(", ");
        Failure::argument(
            "bad_option",
            argument,
            format!("{name:?}"),
            format!("one of {known}"),
            "",
        )
    })
}

/// An `insnav.filter.ImuNoise`.
pub(crate) fn told<'py>(py: Python<'py>, noise: &ImuNoise) -> PyResult<Bound<'py, PyAny>> {
    let values = [
        noise.gyro_white,
        noise.accel_white,
        noise.gyro_bias_sigma,
        noise.accel_bias_sigma,
        noise.gyro_bias_tau,
        noise.accel_bias_tau,
    ];
    let fields = PyDict::new(py);
    for (field, value) in FIELDS.iter().zip(values) {
        fields.set_item(field, value)?;
    }
    py.import("insnav._filter")?
        .getattr("ImuNoise")?
        .call((), Some(&fields))
}

/// Noise of a class of inertial units ([Groves13] table 4.1, from the middle of each class).
///
/// Parameters
/// ----------
/// grade : {"consumer", "automotive", "industrial", "tactical", "navigation"}
///     The class.
///
/// Returns
/// -------
/// ImuNoise
///     In SI units.
#[pyfunction]
pub(crate) fn noise_of_grade<'py>(py: Python<'py>, grade: &str) -> PyResult<Bound<'py, PyAny>> {
    let noise = of_grade("grade", grade).map_err(fail(py))?;
    told(py, &noise)
}

/// Noise of an inertial unit from the units of data sheets.
///
/// Parameters
/// ----------
/// gyro_arw_deg_per_sqrt_hour : float
///     Angle random walk, °/√h.
/// accel_vrw_m_per_s_per_sqrt_hour : float
///     Velocity random walk, m/s/√h.
/// gyro_bias_deg_per_hour : float
///     Standard deviation of the gyro bias, °/h.
/// accel_bias_mg : float
///     Standard deviation of the accelerometer bias, thousandths of 9.80665 m/s².
/// gyro_bias_tau_s, accel_bias_tau_s : float, default 20000
///     Correlation times of the biases, s.
///
/// Returns
/// -------
/// ImuNoise
///     In SI units.
#[pyfunction]
#[pyo3(signature = (gyro_arw_deg_per_sqrt_hour, accel_vrw_m_per_s_per_sqrt_hour, gyro_bias_deg_per_hour, accel_bias_mg, *,
    gyro_bias_tau_s=20_000.0, accel_bias_tau_s=20_000.0))]
pub(crate) fn noise_from_data_sheet(
    py: Python<'_>,
    gyro_arw_deg_per_sqrt_hour: f64,
    accel_vrw_m_per_s_per_sqrt_hour: f64,
    gyro_bias_deg_per_hour: f64,
    accel_bias_mg: f64,
    gyro_bias_tau_s: f64,
    accel_bias_tau_s: f64,
) -> PyResult<Bound<'_, PyAny>> {
    let stated = [
        ("gyro_arw_deg_per_sqrt_hour", gyro_arw_deg_per_sqrt_hour),
        (
            "accel_vrw_m_per_s_per_sqrt_hour",
            accel_vrw_m_per_s_per_sqrt_hour,
        ),
        ("gyro_bias_deg_per_hour", gyro_bias_deg_per_hour),
        ("accel_bias_mg", accel_bias_mg),
    ];
    for (name, value) in stated {
        if !(value.is_finite() && value >= 0.0) {
            let (received, expected) = (value.to_string(), "finite and not negative");
            return Err(
                Failure::argument("bad_value", name, received, expected, "").into_py_err(py)
            );
        }
    }
    for (name, value) in [
        ("gyro_bias_tau_s", gyro_bias_tau_s),
        ("accel_bias_tau_s", accel_bias_tau_s),
    ] {
        // Infinity is a constant bias.
        if value.is_nan() || value <= 0.0 {
            let (received, expected) = (value.to_string(), "above 0");
            return Err(
                Failure::argument("bad_value", name, received, expected, "").into_py_err(py)
            );
        }
    }
    told(
        py,
        &ImuNoise::from_data_sheet(
            gyro_arw_deg_per_sqrt_hour,
            accel_vrw_m_per_s_per_sqrt_hour,
            gyro_bias_deg_per_hour,
            accel_bias_mg,
            gyro_bias_tau_s,
            accel_bias_tau_s,
        ),
    )
}
