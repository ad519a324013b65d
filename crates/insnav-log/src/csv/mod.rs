//! The common CSV: one table per sensor, gzip or not, columns known by their header, any subset of them.
//!
//! `t_s` counts from the recording's zero. Body axes are forward-right-down, velocities NED, angles degrees, `nan` (or an
//! empty cell) where a value is not known.

mod table;
mod tables;
mod write;

pub use table::Table;
pub(crate) use table::{open_text, read_line};
pub(crate) use tables::MICROTESLA;
pub use tables::{
    GnssTable, ImuTable, QuaternionTable, SpeedTable, TruthTable, read_gnss, read_imu, read_speed,
    read_truth, read_truth_quat,
};
pub(crate) use write::{
    Cell, SOLUTION_HEADER, not_writable, write as write_text, write_epochs,
    write_or as write_text_or,
};
pub use write::{write_gnss, write_imu, write_solution, write_truth};
