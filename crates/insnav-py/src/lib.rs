//! The extension module `insnav._insnav`: a log or numpy arrays in, numpy arrays out.
//!
//! No mathematics here. In the order data flows: `inputs` and `settings` take what Python gives, `run` plans and
//! drives the main job of `insnav_log` with the interpreter released, `sinks` keeps the solution, `solution` hands out its
//! columns. `logs` reads and writes files, `sim` simulates, `columns` gives samples back as arrays, `compare` judges a solution.
//! `geometry` binds the core's functions of the Earth, of rotations and of strapdown navigation, `filter` the error-state filter,
//! `navigator` the loop itself. `orientation` is the same for `insnav.ahrs`; `noise` holds the tools of `insnav.noise`. `arrays` is the
//! only place that knows numpy, `interrupt` the only one that knows signals. `command` is the command line in the wheel.

mod align;
mod arrays;
mod attitude_filter;
mod columns;
mod command;
mod compare;
mod epochs;
mod failure;
mod figures;
mod filter;
mod geometry;
mod inputs;
mod interrupt;
mod known_start;
mod logs;
mod named;
mod navigator;
mod noise;
mod orientation;
mod pickle;
mod remedy;
mod run;
mod settings;
mod sim;
mod sinks;
mod solution;
mod stationary;
mod updates;
mod withheld;

use pyo3::prelude::*;

#[pymodule]
mod _insnav {
    use super::*;

    #[pymodule_export]
    use super::align::{
        Record, align_by_stops, align_stops, level, magnetic_start, moving_base_start, run_start,
    };
    #[pymodule_export]
    use super::attitude_filter::AttitudeFilter;
    #[pymodule_export]
    use super::command::command;
    #[pymodule_export]
    use super::compare::compare;
    #[pymodule_export]
    use super::figures::angle_sigmas_deg;
    #[pymodule_export]
    use super::filter::{Eskf, Gate, noise_from_data_sheet, noise_of_grade};
    #[pymodule_export]
    use super::geometry::attitude::{
        exp, from_dcm, from_euler, inverse, left_jacobian, log, multiply, rotate, skew, to_dcm,
        to_euler, wrap_angle,
    };
    #[pymodule_export]
    use super::geometry::earth::{
        LocalFrame, earth_rate_n, from_ecef, gravity, gravity_gradient, meridian_radius,
        ned_to_ecef, offset, offset_to, to_ecef, transport_rate_n, transverse_radius,
    };
    #[pymodule_export]
    use super::geometry::mechanization::{increments, increments_of_sums, mechanize};
    #[pymodule_export]
    use super::geometry::nav_state::NavState;
    #[pymodule_export]
    use super::logs::{read_mcap, read_solution, write_mcap};
    #[pymodule_export]
    use super::navigator::Navigator;
    #[pymodule_export]
    use super::noise::{
        ChannelDesign, Design, ForgettingProcessNoise, LagAccumulator, MohamedSchwarz, als_design,
        als_estimate, als_estimate_ltv, als_solve, fit_allan, identify_noise, lag_covariance,
        mdm_estimate, overlapping_allan, rest_stability,
    };
    #[pymodule_export]
    use super::orientation::{Orientation, ahrs};
    #[pymodule_export]
    use super::run::run;
    #[pymodule_export]
    use super::settings::given_settings;
    #[pymodule_export]
    use super::sim::{
        Scenario, belokurov2018, gauss_markov, kozadaev2017, lobusov2014, white_noise,
    };
    #[pymodule_export]
    use super::stationary::{StopDetector, detect_stops, detector_statistic, quantile_of_squares};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("SCENARIO_EXAMPLE", insnav_log::SCENARIO_EXAMPLE)?;
        for (name, value) in super::geometry::earth::CONSTANTS {
            module.add(name, value)?;
        }
        let blocks = pyo3::types::PyDict::new(module.py());
        for (name, size, unit) in super::filter::known_blocks() {
            blocks.set_item(name, (size, unit))?;
        }
        module.add("BLOCKS", blocks)?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
