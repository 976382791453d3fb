//! `cargo xtask cross`: what runs on a computer also compiles for other computers.
//!
//! Checked only, neither linked nor run, so no linker and no library of the other system is needed.

use anyhow::Result;

use crate::compiler::Compiler;
use crate::need::{Need, Way};
use crate::steps::{self, workspace};

/// Debian's compiler with the sources of the standard library.
const SOURCES: Way = Way::Packages(&["cargo-web", "rustc-web", "rust-web-src"]);

/// A system to check for.
#[derive(Clone, Copy, Debug)]
struct System {
    target: &'static str,
    need: Need,
}

/// Windows with the compiler's own tools: with GNU's, the standard library needs those to compile.
const WINDOWS: System = System {
    target: "x86_64-pc-windows-msvc",
    need: Need {
        what: "a standard library for Windows",
        is_met: || find("x86_64-pc-windows-msvc").is_some(),
        ways: &[Way::RustupTarget("x86_64-pc-windows-msvc"), SOURCES],
    },
};

const AARCH64: System = System {
    target: "aarch64-unknown-linux-gnu",
    need: Need {
        what: "a standard library for Linux on aarch64",
        is_met: || find("aarch64-unknown-linux-gnu").is_some(),
        ways: &[Way::RustupTarget("aarch64-unknown-linux-gnu"), SOURCES],
    },
};

const SYSTEMS: [System; 2] = [WINDOWS, AARCH64];

pub(crate) const NEEDS: [Need; 2] = [WINDOWS.need, AARCH64.need];

/// The package of the program; the libraries are checked along with it.
const CHECK: [&str; 5] = ["check", "--package", "shellcal", "--lib", "--bins"];

/// Checks for every system that this machine has, or can get, a standard library for; says which
/// ones it had to leave out, and why.
pub(crate) fn check() -> Result<()> {
    for system in SYSTEMS {
        if let Err(reason) = system.need.meet() {
            eprintln!("\n==> {}: not checked: {reason:#}", system.target);
            continue;
        }
        let Some(compiler) = find(system.target) else { continue };
        // A directory of its own: the compiler may be another one than the host's.
        let mut check = compiler.cargo(&CHECK, "std,panic_abort");
        check.arg("--target-dir").arg(workspace().join("target/cross"));
        check.env("RUSTFLAGS", "-D warnings");
        steps::run(&format!("{} ({})", system.target, compiler.version), &mut check)?;
    }
    Ok(())
}

fn find(target: &'static str) -> Option<Compiler> {
    Compiler::for_target(target).next()
}
