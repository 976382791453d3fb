//! Compilers for other targets: rustup's, or the distribution's with the sources of the standard
//! library, which is then compiled along.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result};

use crate::need::{Need, Way};
use crate::steps::{installed, workspace};

/// Where a distribution has its compiler, past rustup's.
const DISTRIBUTION: &str = "/usr/bin";

/// A compiler that is new enough and can build for a target.
#[derive(Debug)]
pub(crate) struct Compiler {
    /// Its directory, `None` for the one that runs this task.
    dir: Option<PathBuf>,
    /// What it says it is.
    pub(crate) version: String,
    /// Its libraries for targets.
    pub(crate) rustlib: PathBuf,
    /// What it runs on.
    pub(crate) host: String,
    target: &'static str,
    /// Whether the standard library has to be compiled along.
    pub(crate) builds_std: bool,
}

impl Compiler {
    /// The compilers of this machine for a target, the one that runs this task first.
    pub(crate) fn for_target(target: &'static str) -> impl Iterator<Item = Self> {
        let dirs = [None, Some(PathBuf::from(DISTRIBUTION))];
        dirs.into_iter().filter_map(move |dir| Self::in_dir(dir, target))
    }

    fn in_dir(dir: Option<PathBuf>, target: &'static str) -> Option<Self> {
        let rustc = |arguments: &[&str]| -> Option<String> {
            let output = command("rustc", dir.as_deref()).args(arguments).output().ok()?;
            let text = String::from_utf8(output.stdout).ok()?;
            output.status.success().then(|| text.trim().to_owned())
        };
        let version = rustc(&["--version"])?;
        let number = version.split_whitespace().nth(1)?;
        if parts(number) < parts(env!("CARGO_PKG_RUST_VERSION")) {
            return None;
        }
        let rustlib = PathBuf::from(rustc(&["--print", "sysroot"])?).join("lib/rustlib");
        let builds_std = !rustlib.join(target).join("lib").is_dir();
        if builds_std && !rustlib.join("src/rust/library/core/Cargo.toml").is_file() {
            return None;
        }
        let about = rustc(&["-vV"])?;
        let host = about.lines().find_map(|line| line.strip_prefix("host: "))?.to_owned();
        Some(Self { dir, version, rustlib, host, target, builds_std })
    }

    /// A cargo command for the target, with these parts of the standard library compiled along if
    /// they have to be.
    pub(crate) fn cargo(&self, arguments: &[&str], parts_of_std: &str) -> Command {
        let mut cargo = command("cargo", self.dir.as_deref());
        cargo.current_dir(workspace()).stdin(Stdio::null());
        cargo.args(arguments).args(["--target", self.target]);
        if self.builds_std {
            cargo.args(["-Z", &format!("build-std={parts_of_std}")]).env("RUSTC_BOOTSTRAP", "1");
        }
        cargo
    }
}

/// A program of the compiler in a directory, without what cargo tells the programs that it runs of
/// its own.
fn command(program: &str, dir: Option<&Path>) -> Command {
    let Some(dir) = dir else { return Command::new(program) };
    let mut command = Command::new(dir.join(program));
    for name in ["CARGO", "RUSTUP_TOOLCHAIN", "LD_LIBRARY_PATH"] {
        command.env_remove(name);
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    let dirs = [dir.to_path_buf()].into_iter().chain(std::env::split_paths(&path));
    if let Ok(path) = std::env::join_paths(dirs) {
        command.env("PATH", path);
    }
    command
}

/// Major and minor version.
fn parts(version: &str) -> Vec<u32> {
    let digits = version.split(['.', '-']).take(2);
    digits.map(|part| part.parse().unwrap_or(0)).collect()
}

pub(crate) const BOARD_TARGET: &str = "thumbv7em-none-eabihf";

/// The linker to be had without rustup.
const GNU_LINKER: &str = "arm-none-eabi-ld";

/// rustup's target, or Debian's compiler, the sources of `core`, and a linker. The packages named
/// `web` follow the browsers, which want a new compiler.
pub(crate) const BOARD_NEED: Need = Need {
    what: "a compiler for the board",
    is_met: || find().is_some(),
    ways: &[
        Way::Rustup(&["target", "add", BOARD_TARGET]),
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
    BOARD_NEED.meet()?;
    find().context("the compiler for the board is gone")
}

fn find() -> Option<Toolchain> {
    Compiler::for_target(BOARD_TARGET).find_map(Toolchain::new)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_compared_by_number() {
        assert!(parts("1.100.0-nightly") > parts("1.89"));
        assert!(parts("1.63.0") < parts("1.89"));
        assert_eq!(parts("1.89.1"), parts("1.89"));
    }

    #[test]
    fn a_target_that_is_not_installed_is_compiled_along() {
        let mut compilers = Compiler::for_target("no-such-target");
        assert!(compilers.all(|compiler| compiler.builds_std));
    }
}
