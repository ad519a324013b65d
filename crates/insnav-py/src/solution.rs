//! `insnav.Solution`: the columns of a solution as numpy arrays.

use crate::arrays::{matrices, rows, scalars};
use insnav_core::time::Time;
use insnav_log::ros2::State;
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// A trajectory with its uncertainty: one row an epoch, every column a numpy array.
///
/// Positions are those of the IMU, or of the point that ``output.lever_arm_b_m`` names. ``n`` is north-east-down at the epoch's position, ``b`` forward-right-down.
/// Every access makes a new array.
#[pyclass(frozen, module = "insnav")]
pub(crate) struct Solution {
    pub(crate) states: Vec<State<'static>>,
    pub(crate) origin: Time,
    pub(crate) summary: Py<PyDict>,
}

type Column<'py> = PyResult<Bound<'py, PyAny>>;

impl Solution {
    fn scalar<'py, T: numpy::Element>(
        &self,
        py: Python<'py>,
        get: fn(&State<'_>) -> T,
    ) -> Column<'py> {
        scalars(py, self.states.iter().map(get))
    }

    fn vector<'py, const N: usize>(
        &self,
        py: Python<'py>,
        get: fn(&State<'_>) -> [f64; N],
    ) -> Column<'py> {
        rows(py, self.states.iter().map(get))
    }

    /// From the upper triangle, row by row.
    fn matrix<'py>(&self, py: Python<'py>, get: fn(&State<'_>) -> [f64; 6]) -> Column<'py> {
        let symmetric = |[a, b, c, d, e, f]: [f64; 6]| [[a, b, c], [b, d, e], [c, e, f]];
        matrices(py, self.states.iter().map(|s| symmetric(get(s))))
    }
}

#[pymethods]
impl Solution {
    fn __len__(&self) -> usize {
        self.states.len()
    }

    fn __repr__(&self) -> String {
        match (self.states.first(), self.states.last()) {
            (Some(first), Some(last)) => format!(
                "<insnav.Solution: {} epochs, {:.3} s to {:.3} s>",
                self.states.len(),
                first.header.stamp.since(self.origin),
                last.header.stamp.since(self.origin)
            ),
            _ => "<insnav.Solution: no epochs>".to_owned(),
        }
    }

    /// What the run has to tell, with the keys of ``insnav run --format json``: start, stops, what became of measurements,
    /// the last epoch, warnings, the settings as used.
    #[getter]
    fn summary<'py>(&self, py: Python<'py>) -> Bound<'py, PyDict> {
        self.summary.bind(py).clone()
    }

    /// Instant from which ``time_s`` counts, ns on the clock of the GNSS positions (int).
    #[getter]
    fn t0_ns(&self) -> i64 {
        self.origin.0
    }

    /// Time since ``t0_ns``, s, shape (n,).
    #[getter]
    fn time_s<'py>(&self, py: Python<'py>) -> Column<'py> {
        scalars(
            py,
            self.states
                .iter()
                .map(|s| s.header.stamp.since(self.origin)),
        )
    }

    /// Time on the clock of the GNSS positions, ns, exact, int64, shape (n,).
    #[getter]
    fn time_ns<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |s| s.header.stamp.0)
    }

    /// Turn rate of the body against n, body axes, degrees per second, shape (n, 3).
    #[getter]
    fn rate_b_deg_per_s<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |s| {
            [s.rate_x_deg_per_s, s.rate_y_deg_per_s, s.rate_z_deg_per_s]
        })
    }

    /// Geodetic latitude (WGS-84), degrees, shape (n,).
    #[getter]
    fn latitude_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |s| s.latitude_deg)
    }

    /// Longitude, degrees, shape (n,).
    #[getter]
    fn longitude_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |s| s.longitude_deg)
    }

    /// Height above the ellipsoid, m, shape (n,).
    #[getter]
    fn height_m<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |s| s.height_m)
    }

    /// Velocity over ground, north-east-down, m/s, shape (n, 3).
    #[getter]
    fn velocity_n_m_per_s<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |s| {
            [
                s.velocity_north_m_per_s,
                s.velocity_east_m_per_s,
                s.velocity_down_m_per_s,
            ]
        })
    }

    /// Unit quaternion that takes vectors from b to n (w, x, y, z), shape (n, 4).
    #[getter]
    fn quaternion_nb_wxyz<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |s| [s.q_nb_w, s.q_nb_x, s.q_nb_y, s.q_nb_z])
    }

    /// Roll, right side down positive, degrees, shape (n,).
    #[getter]
    fn roll_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |s| s.roll_deg)
    }

    /// Pitch, nose up positive, degrees, shape (n,).
    #[getter]
    fn pitch_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |s| s.pitch_deg)
    }

    /// Heading, clockwise from true north, 0 to 360 degrees, shape (n,).
    #[getter]
    fn heading_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |s| s.heading_deg)
    }

    /// Gyro bias (measured minus true), body axes, degrees per hour, shape (n, 3).
    #[getter]
    fn gyro_bias_deg_per_hour<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |s| {
            [
                s.gyro_bias_x_deg_per_hour,
                s.gyro_bias_y_deg_per_hour,
                s.gyro_bias_z_deg_per_hour,
            ]
        })
    }

    /// Accelerometer bias (measured minus true), body axes, thousandths of 9.80665 m/s², shape (n, 3).
    #[getter]
    fn accel_bias_mg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |s| {
            [s.accel_bias_x_mg, s.accel_bias_y_mg, s.accel_bias_z_mg]
        })
    }

    /// Standard deviation of the position, north-east-down, m, shape (n, 3).
    #[getter]
    fn sigma_position_n_m<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |s| [s.sigma_north_m, s.sigma_east_m, s.sigma_down_m])
    }

    /// Standard deviation of the velocity, north-east-down, m/s, shape (n, 3).
    #[getter]
    fn sigma_velocity_n_m_per_s<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |s| {
            [
                s.sigma_velocity_north_m_per_s,
                s.sigma_velocity_east_m_per_s,
                s.sigma_velocity_down_m_per_s,
            ]
        })
    }

    /// Standard deviation of the attitude as a small rotation about north, east and down, degrees, shape (n, 3).
    ///
    /// The last column is the standard deviation of the heading.
    #[getter]
    fn sigma_attitude_n_deg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |s| {
            [
                s.sigma_rotation_north_deg,
                s.sigma_rotation_east_deg,
                s.sigma_heading_deg,
            ]
        })
    }

    /// Standard deviation of the gyro bias, degrees per hour, shape (n, 3).
    #[getter]
    fn sigma_gyro_bias_deg_per_hour<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |s| {
            [
                s.sigma_gyro_bias_x_deg_per_hour,
                s.sigma_gyro_bias_y_deg_per_hour,
                s.sigma_gyro_bias_z_deg_per_hour,
            ]
        })
    }

    /// Standard deviation of the accelerometer bias, thousandths of 9.80665 m/s², shape (n, 3).
    #[getter]
    fn sigma_accel_bias_mg<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |s| {
            [
                s.sigma_accel_bias_x_mg,
                s.sigma_accel_bias_y_mg,
                s.sigma_accel_bias_z_mg,
            ]
        })
    }

    /// Covariance of the position, north-east-down, m², shape (n, 3, 3).
    #[getter]
    fn position_covariance_n_m2<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.matrix(py, |s| {
            [
                s.position_covariance_nn_m2,
                s.position_covariance_ne_m2,
                s.position_covariance_nd_m2,
                s.position_covariance_ee_m2,
                s.position_covariance_ed_m2,
                s.position_covariance_dd_m2,
            ]
        })
    }

    /// Covariance of the velocity, north-east-down, m²/s², shape (n, 3, 3).
    #[getter]
    fn velocity_covariance_n_m2_per_s2<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.matrix(py, |s| {
            [
                s.velocity_covariance_nn_m2_per_s2,
                s.velocity_covariance_ne_m2_per_s2,
                s.velocity_covariance_nd_m2_per_s2,
                s.velocity_covariance_ee_m2_per_s2,
                s.velocity_covariance_ed_m2_per_s2,
                s.velocity_covariance_dd_m2_per_s2,
            ]
        })
    }

    /// Covariance of the attitude as a small rotation about north, east and down, rad², shape (n, 3, 3).
    #[getter]
    fn attitude_covariance_n_rad2<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.matrix(py, |s| {
            [
                s.attitude_covariance_nn_rad2,
                s.attitude_covariance_ne_rad2,
                s.attitude_covariance_nd_rad2,
                s.attitude_covariance_ee_rad2,
                s.attitude_covariance_ed_rad2,
                s.attitude_covariance_dd_rad2,
            ]
        })
    }

    /// Whether the body was found to stand, bool, shape (n,).
    #[getter]
    fn standing<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |s| s.motion != 0)
    }

    /// How long the body has been standing, s, shape (n,); 0 when it moves. What a stop turns out to be only after a while is
    /// counted from its begin.
    #[getter]
    fn standing_s<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.scalar(py, |s| s.standing_s)
    }

    /// What the detector of stops saw of specific force, variation of the angular rate, mean angular rate and speed, each over
    /// its threshold: all below 1 speak for a stop. NaN where there is nothing to judge. Shape (n, 4).
    #[getter]
    fn stop_ratios<'py>(&self, py: Python<'py>) -> Column<'py> {
        self.vector(py, |s| {
            [
                s.stop_specific_force_ratio,
                s.stop_angular_rate_ratio,
                s.stop_mean_rate_ratio,
                s.stop_speed_ratio,
            ]
        })
    }
}
