//! Python's symbols exist only once it loads the extension; macOS's linker has to be told.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
