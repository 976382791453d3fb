//! Symbols of Python are there when it loads the extension, which the linker of macOS has to be told.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
