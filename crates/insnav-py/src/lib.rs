//! The extension module `insnav._insnav`: a log or numpy arrays in, numpy arrays out.
//!
//! No mathematics here. In the order data flows: `inputs` and `settings` take what Python gives, `run` plans and
//! drives the main job of `insnav_log` with the interpreter released, `sinks` keeps the solution, `solution` hands out its
//! columns. `orientation` is the same for `insnav.ahrs`; `noise` holds the tools of `insnav.noise`. `arrays` is the only
//! place that knows numpy.

mod arrays;
mod failure;
mod inputs;
mod known_start;
mod noise;
mod orientation;
mod run;
mod settings;
mod sinks;
mod solution;

use pyo3::prelude::*;

#[pymodule]
mod _insnav {
    use super::*;

    #[pymodule_export]
    use super::noise::{
        Design, als_design, als_estimate, als_estimate_ltv, als_solve, fit_allan, identify_noise,
        lag_covariance, mdm_estimate, overlapping_allan,
    };
    #[pymodule_export]
    use super::orientation::{Orientation, ahrs};
    #[pymodule_export]
    use super::run::run;
    #[pymodule_export]
    use super::solution::Solution;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
