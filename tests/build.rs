//! Which tests can run here: those that cannot are built as ignored, with the reason.

use std::path::Path;

#[allow(unreachable_pub, reason = "shared with the library")]
#[path = "src/chromium.rs"]
mod chromium;

/// Configurations, and the variables that all have to be set for them; `cargo xtask test` sets them.
const NEEDS: [(&str, &[&str]); 3] = [
    ("emulated_image", &["SHELLCAL_EMULATED_IMAGE"]),
    ("flashed_image", &["SHELLCAL_FLASHED_IMAGE", "SHELLCAL_MODEL_PYTHON"]),
    ("real_data", &["SHELLCAL_REAL_DATA"]),
];

/// The reference solution of the beam channel, from the recordings.
const ORACLE: &str = "../oracles/beam.json";

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=src/chromium.rs");
    for (name, variables) in NEEDS {
        println!("cargo::rustc-check-cfg=cfg({name})");
        for variable in variables {
            println!("cargo::rerun-if-env-changed={variable}");
        }
        if variables.iter().all(|variable| std::env::var_os(variable).is_some()) {
            println!("cargo::rustc-cfg={name}");
        }
    }
    // The reference values are not part of the recordings, but may lie beside them.
    println!("cargo::rustc-check-cfg=cfg(reference_values)");
    let values = std::env::var_os("SHELLCAL_REAL_DATA").map(|data| Path::new(&data).join(ORACLE));
    if values.is_some_and(|values| values.exists()) {
        println!("cargo::rustc-cfg=reference_values");
    }
    println!("cargo::rustc-check-cfg=cfg(browser)");
    println!("cargo::rerun-if-env-changed={}", chromium::CHROMIUM);
    println!("cargo::rerun-if-env-changed=PATH");
    if chromium::find().is_some() {
        println!("cargo::rustc-cfg=browser");
    }
}
