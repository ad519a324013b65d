//! The extension module `insnav._insnav`: numpy arrays in, the navigator of the core, numpy arrays out.
//!
//! No mathematics here. In the order data flows: `inputs` and `settings` take what Python gives, `run` drives the
//! navigator with the interpreter released, `epochs` keeps the solution, `solution` hands out its columns. `arrays` is the
//! only place that knows numpy.

mod arrays;
mod epochs;
mod failure;
mod inputs;
mod run;
mod settings;
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
