//! The Rust part of the Python package `shellcal`: fits, predictions, partial fits and logs. Its
//! public classes are written in Python.

mod arrays;
mod error;
mod fitted;
mod interrupt;
mod log;
mod options;
mod partial;

use pyo3::prelude::*;

#[pymodule]
mod _native {
    #[pymodule_export]
    use super::fitted::{Fitted, fit};
    #[pymodule_export]
    use super::log::read_log;
    #[pymodule_export]
    use super::partial::{Partial, read_partials};

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
