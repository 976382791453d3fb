//! Python's symbols are only available when it loads the extension, which macOS's linker has to be told.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
