//! Options for linking the program, and conditions for tests that need data or tools of this computer.

use std::path::Path;
use std::process::{Command, Stdio};

/// Environment variable with the directory of the real recordings, which are not part of the repository.
const REAL_DATA: &str = "SHELLCAL_REAL_DATA";

fn main() {
    println!("cargo::rustc-check-cfg=cfg(real_data)");
    println!("cargo::rerun-if-env-changed={REAL_DATA}");
    if is_set(REAL_DATA) {
        println!("cargo::rustc-cfg=real_data");
    }
    println!("cargo::rustc-check-cfg=cfg(groff)");
    let quiet =
        |program: &mut Command| program.stdout(Stdio::null()).stderr(Stdio::null()).status();
    if quiet(Command::new("groff").arg("--version")).is_ok_and(|status| status.success()) {
        println!("cargo::rustc-cfg=groff");
    }
    for shell in ["zsh", "fish"] {
        println!("cargo::rustc-check-cfg=cfg({shell})");
        if quiet(Command::new(shell).arg("--version")).is_ok_and(|status| status.success()) {
            println!("cargo::rustc-cfg={shell}");
        }
    }
    println!("cargo::rerun-if-changed=build.rs");
    let target = |key: &str| std::env::var(format!("CARGO_CFG_TARGET_{key}")).unwrap_or_default();
    if target("OS") == "linux" && target("ENV") == "gnu" {
        // At a fixed address nothing has to be relocated before `main`. This saves 0.7 ms of the 2.3 ms that
        // `shellcal --version` takes otherwise (medians of 400 alternating runs of each).
        println!("cargo::rustc-link-arg-bins=-no-pie");
        // Only the release profile is optimised for size.
        if std::env::var("OPT_LEVEL").is_ok_and(|level| level == "s") {
            leave_out_unwinding();
        }
    }
}

/// Returns true if an environment variable is set and not empty.
fn is_set(name: &str) -> bool {
    std::env::var_os(name).is_some_and(|value| !value.is_empty())
}

/// Discards the unwinding tables, 1.1 MB: a panic in the release aborts, so nothing reads them.
fn leave_out_unwinding() {
    let folder = std::env::var("OUT_DIR").expect("cargo names a folder");
    let script = Path::new(&folder).join("no-unwinding.ld");
    // `INSERT` extends the linker's default script.
    let text = "SECTIONS { /DISCARD/ : { *(.eh_frame) } } INSERT AFTER .text;\n";
    std::fs::write(&script, text).expect("cargo's folder can be written");
    println!("cargo::rustc-link-arg-bins=-Wl,--no-eh-frame-hdr");
    println!("cargo::rustc-link-arg-bins=-Wl,-T,{}", script.display());
}
