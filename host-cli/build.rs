//! How the program is linked, and which of its tests can run here.

use std::path::Path;
use std::process::{Command, Stdio};

/// Names the directory of the real recordings, which are not part of the repository.
const REAL_DATA: &str = "SHELLCAL_REAL_DATA";

fn main() {
    // Tests on real recordings are built as ignored where there are none.
    println!("cargo::rustc-check-cfg=cfg(real_data)");
    println!("cargo::rerun-if-env-changed={REAL_DATA}");
    if is_set(REAL_DATA) {
        println!("cargo::rustc-cfg=real_data");
    }
    // So are those on pages of the manual where nothing renders them.
    println!("cargo::rustc-check-cfg=cfg(groff)");
    let quiet =
        |program: &mut Command| program.stdout(Stdio::null()).stderr(Stdio::null()).status();
    if quiet(Command::new("groff").arg("--version")).is_ok_and(|status| status.success()) {
        println!("cargo::rustc-cfg=groff");
    }
    // And completions in shells that are not here.
    for shell in ["zsh", "fish"] {
        println!("cargo::rustc-check-cfg=cfg({shell})");
        if quiet(Command::new(shell).arg("--version")).is_ok_and(|status| status.success()) {
            println!("cargo::rustc-cfg={shell}");
        }
    }
    println!("cargo::rerun-if-changed=build.rs");
    let target = |key: &str| std::env::var(format!("CARGO_CFG_TARGET_{key}")).unwrap_or_default();
    if target("OS") == "linux" && target("ENV") == "gnu" {
        // At a fixed address nothing has to be relocated before `main`: of the 2.3 ms that
        // `shellcal --version` takes otherwise 0.7 ms, as a median of 400 runs of either in turn.
        println!("cargo::rustc-link-arg-bins=-no-pie");
        // The release alone is optimised for size.
        if std::env::var("OPT_LEVEL").is_ok_and(|level| level == "s") {
            leave_out_unwinding();
        }
    }
}

/// Whether a variable has a value; an empty one has none.
fn is_set(name: &str) -> bool {
    std::env::var_os(name).is_some_and(|value| !value.is_empty())
}

/// A panic ends the release at once, so nobody looks up how to unwind it: 1.1 MB of tables.
fn leave_out_unwinding() {
    let folder = std::env::var("OUT_DIR").expect("cargo names a folder");
    let script = Path::new(&folder).join("no-unwinding.ld");
    // It adds to the linker's own script.
    let text = "SECTIONS { /DISCARD/ : { *(.eh_frame) } } INSERT AFTER .text;\n";
    std::fs::write(&script, text).expect("cargo's folder can be written");
    println!("cargo::rustc-link-arg-bins=-Wl,--no-eh-frame-hdr");
    println!("cargo::rustc-link-arg-bins=-Wl,-T,{}", script.display());
}
