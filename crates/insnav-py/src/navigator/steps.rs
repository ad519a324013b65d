//! One sample at a time.

use super::navigator::{Any, Navigator, is_finished};
use super::sample::{stated, three, time};
use crate::failure::{Failure, fail, refused};
use crate::inputs::{self, heading_sample, position_sample, velocity_sample};
use insnav_core::sample::{ImuIncrement, ImuSample, MagneticField, Sample, Speed, Standstill};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

impl Navigator {
    #[inline]
    fn push(&mut self, py: Python<'_>, sample: &Sample) -> PyResult<()> {
        if self.finished {
            return Err(is_finished(py));
        }
        self.core
            .step(sample, &mut self.pending)
            .map_err(refused(py, self.zero))
    }
}

#[pymethods]
impl Navigator {
    /// Take an inertial sample.
    ///
    /// Fastest with a float and numpy arrays or tuples.
    ///
    /// Parameters
    /// ----------
    /// time_s : float, numpy.datetime64 or datetime.datetime
    ///     Stamp on the unit's clock.
    /// angular_rate_b_rad_per_s : (3,)
    ///     Angular rate against inertial space, forward-right-down (turned by ``imu.mounting_rpy_deg``).
    /// specific_force_b_m_per_s2 : (3,)
    ///     Specific force, (0, 0, -g) at rest and level.
    ///
    /// Raises
    /// ------
    /// ArgumentError
    ///     ``bad_time``: more seconds than a stamp holds, such as milliseconds since 1970.
    /// NavigationError
    ///     A stamp older than the horizon, or a measurement that waited until now and that the filter cannot use; the navigator stays
    ///     usable.
    #[pyo3(signature = (time_s, angular_rate_b_rad_per_s, specific_force_b_m_per_s2, /))]
    fn step_imu(
        &mut self,
        py: Python<'_>,
        time_s: &Any<'_>,
        angular_rate_b_rad_per_s: &Any<'_>,
        specific_force_b_m_per_s2: &Any<'_>,
    ) -> PyResult<()> {
        let make = || {
            Ok(ImuSample {
                time: time(time_s, self.zero)?,
                angular_rate_b: three("angular_rate_b_rad_per_s", angular_rate_b_rad_per_s)?,
                specific_force_b: three("specific_force_b_m_per_s2", specific_force_b_m_per_s2)?,
            })
        };
        let mut sample = make().map_err(fail(py))?;
        if let Some(to_body) = &self.to_body {
            sample.angular_rate_b = to_body * sample.angular_rate_b;
            sample.specific_force_b = to_body * sample.specific_force_b;
        }
        self.push(py, &Sample::Imu(sample))
    }

    /// Take an inertial sample of a unit that integrates by itself.
    ///
    /// Parameters
    /// ----------
    /// time_s : float, numpy.datetime64 or datetime.datetime
    ///     End of the interval, on the unit's clock.
    /// angle_b_rad, velocity_b_m_per_s : (3,)
    ///     What was gained since the sample before.
    #[pyo3(signature = (time_s, angle_b_rad, velocity_b_m_per_s, /))]
    fn step_imu_increment(
        &mut self,
        py: Python<'_>,
        time_s: &Any<'_>,
        angle_b_rad: &Any<'_>,
        velocity_b_m_per_s: &Any<'_>,
    ) -> PyResult<()> {
        let make = || {
            Ok(ImuIncrement {
                time: time(time_s, self.zero)?,
                angle_b: three("angle_b_rad", angle_b_rad)?,
                velocity_b: three("velocity_b_m_per_s", velocity_b_m_per_s)?,
            })
        };
        let mut sample = make().map_err(fail(py))?;
        if let Some(to_body) = &self.to_body {
            sample.angle_b = to_body * sample.angle_b;
            sample.velocity_b = to_body * sample.velocity_b;
        }
        self.push(py, &Sample::ImuIncrement(sample))
    }

    /// Take a GNSS position.
    ///
    /// Parameters
    /// ----------
    /// time_s : float, numpy.datetime64 or datetime.datetime
    ///     Stamp on the GNSS clock.
    /// latitude_deg_longitude_deg_height_m : (3,)
    ///     Of the antenna, height above the ellipsoid.
    /// sigma_n_m : float, (3,) or (3, 3), optional
    ///     Standard deviations, north-east-down, or the covariance, m²; without them, or NaN: not known.
    ///
    /// Raises
    /// ------
    /// ArgumentError
    ///     ``bad_value`` for a sigma below zero, ``not_a_covariance`` for a matrix that is none.
    #[pyo3(signature = (time_s, latitude_deg_longitude_deg_height_m, sigma_n_m=None, /))]
    fn step_gnss_position(
        &mut self,
        py: Python<'_>,
        time_s: &Any<'_>,
        latitude_deg_longitude_deg_height_m: &Any<'_>,
        sigma_n_m: Option<&Any<'_>>,
    ) -> PyResult<()> {
        let make = || {
            let position = three(
                "latitude_deg_longitude_deg_height_m",
                latitude_deg_longitude_deg_height_m,
            )?;
            let stated = stated("sigma_n_m", sigma_n_m)?;
            Ok(position_sample(time(time_s, self.zero)?, &position, stated))
        };
        self.push(py, &make().map_err(fail(py))?)
    }

    /// Take a GNSS velocity.
    ///
    /// Parameters
    /// ----------
    /// time_s : float, numpy.datetime64 or datetime.datetime
    ///     Stamp on the GNSS clock.
    /// velocity_n_m_per_s : (3,)
    ///     Of the antenna over ground, north-east-down; down NaN: horizontal only.
    /// sigma_n_m_per_s : float, (3,) or (3, 3), optional
    ///     Standard deviations, or the covariance, m²/s²; without them, or NaN: not known.
    ///
    /// Raises
    /// ------
    /// ArgumentError
    ///     As of :meth:`step_gnss_position`.
    #[pyo3(signature = (time_s, velocity_n_m_per_s, sigma_n_m_per_s=None, /))]
    fn step_gnss_velocity(
        &mut self,
        py: Python<'_>,
        time_s: &Any<'_>,
        velocity_n_m_per_s: &Any<'_>,
        sigma_n_m_per_s: Option<&Any<'_>>,
    ) -> PyResult<()> {
        let make = || {
            let velocity = three("velocity_n_m_per_s", velocity_n_m_per_s)?;
            let stated = stated("sigma_n_m_per_s", sigma_n_m_per_s)?;
            Ok(velocity_sample(time(time_s, self.zero)?, velocity, stated))
        };
        self.push(py, &make().map_err(fail(py))?)
    }

    /// Take a heading, of a dual antenna or another source.
    ///
    /// Parameters
    /// ----------
    /// time_s : float, numpy.datetime64 or datetime.datetime
    ///     Its instant.
    /// heading_deg, sigma_deg : float
    ///     Clockwise from true north, and its standard deviation.
    ///
    /// Raises
    /// ------
    /// ArgumentError
    ///     ``bad_value`` for a sigma below zero.
    #[pyo3(signature = (time_s, heading_deg, sigma_deg, /))]
    fn step_heading(
        &mut self,
        py: Python<'_>,
        time_s: &Any<'_>,
        heading_deg: f64,
        sigma_deg: f64,
    ) -> PyResult<()> {
        let make = || {
            let time = time(time_s, self.zero)?;
            heading_sample(time, heading_deg, sigma_deg, "sigma_deg", None)
        };
        self.push(py, &make().map_err(fail(py))?)
    }

    /// Somebody says whether the body stands, from then on.
    ///
    /// Parameters
    /// ----------
    /// time_s : float, numpy.datetime64 or datetime.datetime
    ///     Its instant.
    /// standing : bool
    ///     Whether it stands.
    #[pyo3(signature = (time_s, standing, /))]
    fn step_standstill(
        &mut self,
        py: Python<'_>,
        time_s: &Any<'_>,
        standing: &Any<'_>,
    ) -> PyResult<()> {
        let time = time(time_s, self.zero).map_err(fail(py))?;
        let standing = truth("standing", standing).map_err(fail(py))?;
        self.push(py, &Sample::Standstill(Standstill { time, standing }))
    }

    /// How fast the wheels turn, whichever way.
    ///
    /// Parameters
    /// ----------
    /// time_s : float, numpy.datetime64 or datetime.datetime
    ///     Its instant.
    /// speed_m_per_s : float
    ///     The speed.
    #[pyo3(signature = (time_s, speed_m_per_s, /))]
    fn step_speed(&mut self, py: Python<'_>, time_s: &Any<'_>, speed_m_per_s: f64) -> PyResult<()> {
        let sample = Sample::Speed(Speed {
            time: time(time_s, self.zero).map_err(fail(py))?,
            speed: speed_m_per_s,
        });
        self.push(py, &sample)
    }

    /// The magnetic field around a magnetometer: for the heading of a start that nothing else tells.
    ///
    /// Parameters
    /// ----------
    /// time_s : float, numpy.datetime64 or datetime.datetime
    ///     Stamp on the unit's clock.
    /// field_b_tesla : (3,)
    ///     The field, forward-right-down (turned by ``imu.mounting_rpy_deg``), T.
    #[pyo3(signature = (time_s, field_b_tesla, /))]
    fn step_magnetic_field(
        &mut self,
        py: Python<'_>,
        time_s: &Any<'_>,
        field_b_tesla: &Any<'_>,
    ) -> PyResult<()> {
        let make = || {
            Ok(MagneticField {
                time: time(time_s, self.zero)?,
                field_b: three("field_b_tesla", field_b_tesla)?,
            })
        };
        let mut sample = make().map_err(fail(py))?;
        if let Some(to_body) = &self.to_body {
            sample.field_b = to_body * sample.field_b;
        }
        self.push(py, &Sample::Magnetic(sample))
    }

    /// Take one sample of any kind: ``step("imu", time_s, rate, force)`` is ``step_imu(time_s, rate, force)``.
    ///
    /// Parameters
    /// ----------
    /// kind : str
    ///     A key of :class:`Arrays`.
    /// *columns
    ///     One row of that kind's columns.
    #[pyo3(signature = (kind, /, *columns))]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        kind: &str,
        columns: &Bound<'py, PyTuple>,
    ) -> PyResult<()> {
        let (required, most) = match kind {
            "imu" | "imu_increment" | "heading" => (3, 3),
            "gnss_position" | "gnss_velocity" => (2, 3),
            "standstill" | "speed" | "magnetic_field" => (2, 2),
            other => {
                let known = inputs::kinds().join(", ");
                return Err(fail(py)(Failure::unknown_word("kind", other, &known)));
            }
        };
        if !(required..=most).contains(&columns.len()) {
            let expected = if required == most {
                required.to_string()
            } else {
                format!("{required} or {most}")
            };
            return Err(PyTypeError::new_err(format!(
                "step({kind:?}, ...): {} columns, expected {expected}",
                columns.len()
            )));
        }
        let item = |i: usize| columns.get_item(i);
        let third = || match columns.len() {
            3 => item(2).map(|c| (!c.is_none()).then_some(c)),
            _ => Ok(None),
        };
        let (t, a) = (item(0)?, item(1)?);
        match kind {
            "imu" => self.step_imu(py, &t, &a, &item(2)?),
            "imu_increment" => self.step_imu_increment(py, &t, &a, &item(2)?),
            "gnss_position" => self.step_gnss_position(py, &t, &a, third()?.as_ref()),
            "gnss_velocity" => self.step_gnss_velocity(py, &t, &a, third()?.as_ref()),
            "heading" => self.step_heading(py, &t, a.extract()?, item(2)?.extract()?),
            "standstill" => self.step_standstill(py, &t, &a),
            "magnetic_field" => self.step_magnetic_field(py, &t, &a),
            _ => self.step_speed(py, &t, a.extract()?),
        }
    }
}

/// Whether something is so: a bool, or a number as arrays have it.
fn truth(name: &str, given: &Any<'_>) -> Result<bool, Failure> {
    if let Ok(truth) = given.extract::<bool>() {
        return Ok(truth);
    }
    match given.extract::<f64>() {
        Ok(number) if !number.is_nan() => Ok(number != 0.0),
        _ => {
            let received = given
                .repr()
                .map_or_else(|_| "something else".to_owned(), |text| text.to_string());
            let remedy = "leave the step out where nobody says anything";
            Err(Failure::argument(
                "bad_value",
                name,
                received,
                "True or False",
                remedy,
            ))
        }
    }
}
