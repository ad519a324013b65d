//! The columns of a solution, filled epoch by epoch and handed to numpy as they lie.

use crate::arrays::scalars;
use insnav_core::time::Time;
use insnav_log::ros2::State;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

/// A column: its name, and its row in a state.
type Column<const N: usize> = (&'static str, fn(&State<'_>) -> [f64; N]);

/// Shape (n,).
const SCALARS: [Column<1>; 7] = [
    ("latitude_deg", |s| [s.latitude_deg]),
    ("longitude_deg", |s| [s.longitude_deg]),
    ("height_m", |s| [s.height_m]),
    ("roll_deg", |s| [s.roll_deg]),
    ("pitch_deg", |s| [s.pitch_deg]),
    ("heading_deg", |s| [s.heading_deg]),
    ("standing_s", |s| [s.standing_s]),
];

/// Shape (n, 3).
const VECTORS: [Column<3>; 9] = [
    ("rate_b_deg_per_s", |s| {
        [s.rate_x_deg_per_s, s.rate_y_deg_per_s, s.rate_z_deg_per_s]
    }),
    ("velocity_n_m_per_s", |s| {
        [
            s.velocity_north_m_per_s,
            s.velocity_east_m_per_s,
            s.velocity_down_m_per_s,
        ]
    }),
    ("gyro_bias_deg_per_hour", |s| {
        [
            s.gyro_bias_x_deg_per_hour,
            s.gyro_bias_y_deg_per_hour,
            s.gyro_bias_z_deg_per_hour,
        ]
    }),
    ("accel_bias_mg", |s| {
        [s.accel_bias_x_mg, s.accel_bias_y_mg, s.accel_bias_z_mg]
    }),
    ("sigma_position_n_m", |s| {
        [s.sigma_north_m, s.sigma_east_m, s.sigma_down_m]
    }),
    ("sigma_velocity_n_m_per_s", |s| {
        [
            s.sigma_velocity_north_m_per_s,
            s.sigma_velocity_east_m_per_s,
            s.sigma_velocity_down_m_per_s,
        ]
    }),
    ("sigma_attitude_n_deg", |s| {
        [
            s.sigma_rotation_north_deg,
            s.sigma_rotation_east_deg,
            s.sigma_heading_deg,
        ]
    }),
    ("sigma_gyro_bias_deg_per_hour", |s| {
        [
            s.sigma_gyro_bias_x_deg_per_hour,
            s.sigma_gyro_bias_y_deg_per_hour,
            s.sigma_gyro_bias_z_deg_per_hour,
        ]
    }),
    ("sigma_accel_bias_mg", |s| {
        [
            s.sigma_accel_bias_x_mg,
            s.sigma_accel_bias_y_mg,
            s.sigma_accel_bias_z_mg,
        ]
    }),
];

/// Shape (n, 4).
const QUADRUPLES: [Column<4>; 2] = [
    ("quaternion_nb_wxyz", |s| {
        [s.q_nb_w, s.q_nb_x, s.q_nb_y, s.q_nb_z]
    }),
    ("stop_ratios", |s| {
        [
            s.stop_specific_force_ratio,
            s.stop_angular_rate_ratio,
            s.stop_mean_rate_ratio,
            s.stop_speed_ratio,
        ]
    }),
];

/// Shape (n, 3, 3); the upper triangle row by row.
const MATRICES: [Column<6>; 3] = [
    ("position_covariance_n_m2", |s| {
        [
            s.position_covariance_nn_m2,
            s.position_covariance_ne_m2,
            s.position_covariance_nd_m2,
            s.position_covariance_ee_m2,
            s.position_covariance_ed_m2,
            s.position_covariance_dd_m2,
        ]
    }),
    ("velocity_covariance_n_m2_per_s2", |s| {
        [
            s.velocity_covariance_nn_m2_per_s2,
            s.velocity_covariance_ne_m2_per_s2,
            s.velocity_covariance_nd_m2_per_s2,
            s.velocity_covariance_ee_m2_per_s2,
            s.velocity_covariance_ed_m2_per_s2,
            s.velocity_covariance_dd_m2_per_s2,
        ]
    }),
    ("attitude_covariance_n_rad2", |s| {
        [
            s.attitude_covariance_nn_rad2,
            s.attitude_covariance_ne_rad2,
            s.attitude_covariance_nd_rad2,
            s.attitude_covariance_ee_rad2,
            s.attitude_covariance_ed_rad2,
            s.attitude_covariance_dd_rad2,
        ]
    }),
];

/// Columns on their way to `insnav.Solution`.
#[derive(Default)]
pub(crate) struct EpochColumns {
    time: Vec<Time>,
    standing: Vec<bool>,
    scalars: [Vec<f64>; SCALARS.len()],
    vectors: [Vec<f64>; VECTORS.len()],
    quadruples: [Vec<f64>; QUADRUPLES.len()],
    matrices: [Vec<f64>; MATRICES.len()],
}

impl EpochColumns {
    /// With room for so many epochs: columns that grow are copied again and again.
    pub(crate) fn with_capacity(epochs: usize) -> Self {
        fn room<const K: usize>(values: usize) -> [Vec<f64>; K] {
            std::array::from_fn(|_| Vec::with_capacity(values))
        }
        EpochColumns {
            time: Vec::with_capacity(epochs),
            standing: Vec::with_capacity(epochs),
            scalars: room(epochs),
            vectors: room(3 * epochs),
            quadruples: room(4 * epochs),
            matrices: room(9 * epochs),
        }
    }

    /// Stamp of the first epoch.
    pub(crate) fn first(&self) -> Option<Time> {
        self.time.first().copied()
    }

    pub(crate) fn push(&mut self, state: &State<'_>) {
        self.time.push(state.header.stamp);
        self.standing.push(state.motion != 0);
        fill(&mut self.scalars, &SCALARS, state);
        fill(&mut self.vectors, &VECTORS, state);
        fill(&mut self.quadruples, &QUADRUPLES, state);
        for (column, (_, get)) in self.matrices.iter_mut().zip(MATRICES) {
            let [a, b, c, d, e, f] = get(state);
            column.extend([a, b, c, b, d, e, c, e, f]);
        }
    }

    /// One array a column, by its name; seconds count from `origin`.
    pub(crate) fn into_python(self, py: Python<'_>, origin: Time) -> PyResult<Bound<'_, PyDict>> {
        let n = self.time.len();
        let columns = PyDict::new(py);
        let seconds = self.time.iter().map(|t| t.since(origin));
        columns.set_item("time_s", scalars(py, seconds)?)?;
        columns.set_item("time_ns", scalars(py, self.time.iter().map(|t| t.0))?)?;
        columns.set_item("standing", PyArray1::from_vec(py, self.standing))?;
        for (column, (name, _)) in self.scalars.into_iter().zip(SCALARS) {
            columns.set_item(name, PyArray1::from_vec(py, column))?;
        }
        for (column, (name, _)) in self.vectors.into_iter().zip(VECTORS) {
            columns.set_item(name, PyArray1::from_vec(py, column).reshape([n, 3])?)?;
        }
        for (column, (name, _)) in self.quadruples.into_iter().zip(QUADRUPLES) {
            columns.set_item(name, PyArray1::from_vec(py, column).reshape([n, 4])?)?;
        }
        for (column, (name, _)) in self.matrices.into_iter().zip(MATRICES) {
            columns.set_item(name, PyArray1::from_vec(py, column).reshape([n, 3, 3])?)?;
        }
        Ok(columns)
    }
}

/// What a [`insnav_log::StateSink`] keeps its states in.
impl Extend<State<'static>> for EpochColumns {
    fn extend<I: IntoIterator<Item = State<'static>>>(&mut self, states: I) {
        states.into_iter().for_each(|state| self.push(&state));
    }
}

fn fill<const N: usize, const K: usize>(
    columns: &mut [Vec<f64>; K],
    table: &[Column<N>; K],
    state: &State<'_>,
) {
    for (column, (_, get)) in columns.iter_mut().zip(table) {
        column.extend(get(state));
    }
}
