//! `insnav.Solution`: the columns of a solution as numpy arrays.

use crate::arrays::{matrices, rows, scalars};
use crate::epochs::{Row, root};
use insnav_core::time::Time;
use nalgebra::Matrix3;
use pyo3::prelude::*;

/// A trajectory with its uncertainty: one row an epoch, every column a numpy array.
///
/// Positions are those of the IMU. ``n`` is north-east-down at the epoch's position, ``b`` forward-right-down.
/// Every access makes a new array.
#[pyclass(frozen, module = "insnav")]
pub(crate) struct Solution {
    pub(crate) rows: Vec<Row>,
    pub(crate) origin: Time,
}

type Column<'py> = PyResult<Bound<'py, PyAny>>;

impl Solution {
    fn scalar<'py, T: numpy::Element>(&self, py: Python<'py>, get: fn(&Row) -> T) -> Column<'py> {
        scalars(py, self.rows.iter().map(get))
    }

    fn vector<'py, const N: usize>(
        &self,
        py: Python<'py>,
        get: fn(&Row) -> [f64; N],
    ) -> Column<'py> {
        rows(py, self.rows.iter().map(get))
    }

    fn matrix<'py>(&self, py: Python<'py>, get: fn(&Row) -> Matrix3<f64>) -> Column<'py> {
        // Covariances are symmetric: column by column is row by row.
        matrices(py, self.rows.iter().map(|r| get(r).into()))
    }
}

fn sigma(covariance: &Matrix3<f64>) -> [f64; 3] {
    covariance.diagonal().map(root).into()
}

#[pymethods]
impl Solution {
    fn __len__(&self) -> usize {
        self.rows.len()
    }

    fn __repr__(&self) -> String {
        match (self.rows.first(), self.rows.last()) {
            (Some(first), Some(last)) => format!(
                "<insnav.Solution: {} epochs, {:.3} s to {:.3} s>",
                self.rows.len(),
                first.time.since(self.origin),
                last.time.since(self.origin)
            ),
            _ => "<insnav.Solution: no epochs>".to_owned(),
        }
    }

    /// Instant from which ``time_s`` counts, ns on the clock of the GNSS positions (int).
    #[getter]
    fn t0_ns(&self) -> i64 {
        self.origin.0
    }

    /// Time since ``t0_ns``, s, shape (n,).
    #[getter]
    fn time_s<'py>(&self, py: Python<'py>) -> Column<'py> {
        scalars(py, self.rows.iter().map(|r| r.time.since(self.origin)))
    }

    /// Time on the clock of the GNSS positions, ns, exact, int64, shape (n,).
    #[getter]
    fn time_ns<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |r| r.time.0)
    }

    /// Geodetic latitude (WGS-84), degrees, shape (n,).
    #[getter]
    fn latitude_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |r| r.latitude_deg)
    }

    /// Longitude, degrees, shape (n,).
    #[getter]
    fn longitude_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |r| r.longitude_deg)
    }

    /// Height above the ellipsoid, m, shape (n,).
    #[getter]
    fn height_m<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |r| r.height_m)
    }

    /// Velocity over ground, north-east-down, m/s, shape (n, 3).
    #[getter]
    fn velocity_n_m_per_s<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |r| r.velocity_n_m_per_s)
    }

    /// Unit quaternion that takes vectors from b to n (w, x, y, z), shape (n, 4).
    #[getter]
    fn quaternion_nb_wxyz<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |r| r.quaternion_nb_wxyz)
    }

    /// Roll, right side down positive, degrees, shape (n,).
    #[getter]
    fn roll_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |r| r.roll_deg)
    }

    /// Pitch, nose up positive, degrees, shape (n,).
    #[getter]
    fn pitch_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |r| r.pitch_deg)
    }

    /// Heading, clockwise from true north, 0 to 360 degrees, shape (n,).
    #[getter]
    fn heading_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |r| r.heading_deg)
    }

    /// Gyro bias (measured minus true), body axes, degrees per hour, shape (n, 3).
    #[getter]
    fn gyro_bias_deg_per_hour<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |r| r.gyro_bias_deg_per_hour)
    }

    /// Accelerometer bias (measured minus true), body axes, thousandths of 9.80665 m/s², shape (n, 3).
    #[getter]
    fn accel_bias_mg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |r| r.accel_bias_mg)
    }

    /// Standard deviation of the position, north-east-down, m, shape (n, 3).
    #[getter]
    fn sigma_position_n_m<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |r| sigma(&r.position_covariance_n))
    }

    /// Standard deviation of the velocity, north-east-down, m/s, shape (n, 3).
    #[getter]
    fn sigma_velocity_n_m_per_s<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |r| sigma(&r.velocity_covariance_n))
    }

    /// Standard deviation of the attitude as a small rotation about north, east and down, degrees, shape (n, 3).
    ///
    /// The last column is the standard deviation of the heading.
    #[getter]
    fn sigma_attitude_n_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |r| sigma(&r.attitude_covariance_n).map(f64::to_degrees))
    }

    /// Standard deviation of the gyro bias, degrees per hour, shape (n, 3).
    #[getter]
    fn sigma_gyro_bias_deg_per_hour<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |r| r.sigma_gyro_bias_deg_per_hour)
    }

    /// Standard deviation of the accelerometer bias, thousandths of 9.80665 m/s², shape (n, 3).
    #[getter]
    fn sigma_accel_bias_mg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |r| r.sigma_accel_bias_mg)
    }

    /// Covariance of the position, north-east-down, m², shape (n, 3, 3).
    #[getter]
    fn position_covariance_n_m2<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.matrix(py, |r| r.position_covariance_n)
    }

    /// Covariance of the velocity, north-east-down, m²/s², shape (n, 3, 3).
    #[getter]
    fn velocity_covariance_n_m2_per_s2<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.matrix(py, |r| r.velocity_covariance_n)
    }

    /// Covariance of the attitude as a small rotation about north, east and down, rad², shape (n, 3, 3).
    #[getter]
    fn attitude_covariance_n_rad2<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.matrix(py, |r| r.attitude_covariance_n)
    }

    /// Whether the body was found to stand, bool, shape (n,).
    #[getter]
    fn standing<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |r| r.standing)
    }
}
