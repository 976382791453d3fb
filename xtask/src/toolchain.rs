//! A compiler and a linker for the board's Cortex-M4F.

use std::process::Command;

use anyhow::{Context, Result};

use crate::compiler::Compiler;
use crate::need::{Need, Way};
use crate::steps::installed;

pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// The linker to be had without rustup.
const GNU_LINKER: &str = "arm-none-eabi-ld";

/// rustup's target, or Debian's compiler, the sources of `core`, and a linker. The packages named
/// `web` follow the browsers, which want a new compiler.
pub(crate) const NEED: Need = Need {
    what: "a compiler for the board",
    is_met: || find().is_some(),
    ways: &[
        Way::Rustup(&["target", "add", TARGET]),
        Way::Packages(&["cargo-web", "rustc-web", "rust-web-src", "binutils-arm-none-eabi"]),
    ],
};

/// A compiler that can build and link for the board.
#[derive(Debug)]
pub(crate) struct Toolchain {
    pub(crate) compiler: Compiler,
    /// `None` for the compiler's own.
    linker: Option<&'static str>,
}

/// Finds a compiler, or gets one.
pub(crate) fn set_up() -> Result<Toolchain> {
    NEED.meet()?;
    find().context("the compiler for the board is gone")
}

fn find() -> Option<Toolchain> {
    Compiler::for_target(TARGET).find_map(Toolchain::new)
}

impl Toolchain {
    /// A compiler with its linker, or with that of the distribution.
    fn new(compiler: Compiler) -> Option<Self> {
        let has_own = compiler.rustlib.join(&compiler.host).join("bin/rust-lld").exists();
        let linker = (!has_own).then_some(GNU_LINKER);
        let has_linker = linker.is_none_or(|linker| installed(linker, &["--version"]));
        has_linker.then_some(Self { compiler, linker })
    }

    /// A command of cargo on the package `firmware` for the board.
    pub(crate) fn command(&self, name: &str) -> Command {
        let arguments = [name, "--profile", "firmware", "--package", "firmware"];
        let mut cargo = self.compiler.cargo(&arguments, "core");
        if let Some(linker) = self.linker {
            cargo.env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", linker);
        }
        let link = ["-Tlink.x", "--nmagic", "-Tdefmt.x"];
        let flags = link.iter().map(|argument| format!("-C link-arg={argument}"));
        // Names of functions that say of which types they are (stack.rs).
        let flags: Vec<_> = flags.chain(["-C symbol-mangling-version=v0".to_owned()]).collect();
        cargo.env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_RUSTFLAGS", flags.join(" "));
        cargo
    }
}
