//! The extension module `insnav._insnav`: a log or numpy arrays in, numpy arrays out.
//!
//! No mathematics here. In the order data flows: `inputs` and `settings` take what Python gives, `run` plans and
//! drives the main job of `insnav_log` with the interpreter released, `sinks` keeps the solution, `solution` hands out its
//! columns. `arrays` is the only place that knows numpy.

mod arrays;
mod failure;
mod inputs;
mod known_start;
mod run;
mod settings;
mod sinks;
mod solution;

use pyo3::prelude::*;

#[pymodule]
mod _insnav {
    use super::*;

    #[pymodule_export]
    use super::run::run;
    #[pymodule_export]
    use super::solution::Solution;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
