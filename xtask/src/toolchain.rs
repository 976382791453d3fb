//! A compiler for the board's Cortex-M4F: whatever is there, or what can be had.
//!
//! The target is rustup's to add. Where rustup cannot fetch it, a compiler that has the sources of
//! `core` compiles them along, such as Debian's.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};

use crate::apt;
use crate::measure::installed;
use crate::steps::workspace;

pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// Where a distribution has its compiler, past rustup's.
const DISTRIBUTION: &str = "/usr/bin";

/// Debian's compiler, the sources of `core`, and a linker. The packages named `web` follow the
/// browsers, which want a new compiler.
const PACKAGES: [&str; 4] = ["cargo-web", "rustc-web", "rust-web-src", "binutils-arm-none-eabi"];

/// The linker to be had without rustup.
const GNU_LINKER: &str = "arm-none-eabi-ld";

/// How long rustup may try.
const RUSTUP_TIME: Duration = Duration::from_secs(180);

/// A compiler that can build for the board.
#[derive(Debug)]
pub(crate) struct Toolchain {
    /// Its directory, `None` for the one that runs this task.
    dir: Option<PathBuf>,
    /// What it says it is.
    pub(crate) version: String,
    /// Whether `core` has to be compiled along.
    builds_core: bool,
    linker: Option<&'static str>,
}

/// Finds a compiler, or gets one.
pub(crate) fn set_up() -> Result<Toolchain> {
    if let Some(found) = find() {
        return Ok(found);
    }
    if installed("rustup", &["--version"]) {
        eprintln!("\n==> add the board's target: rustup target add {TARGET}");
        match add_target() {
            Ok(()) => {}
            Err(error) => eprintln!("    {error:#}; trying the distribution's compiler"),
        }
        if let Some(found) = find() {
            return Ok(found);
        }
    }
    let what = format!("a compiler for the board (`rustup target add {TARGET}` gives one too)");
    apt::install(&PACKAGES, &what)?;
    find().with_context(|| format!("the packages {} do not make one", PACKAGES.join(", ")))
}

fn find() -> Option<Toolchain> {
    let dirs = [None, Some(PathBuf::from(DISTRIBUTION))];
    dirs.into_iter().find_map(Toolchain::in_dir)
}

/// Does not take for ever where there is no network.
fn add_target() -> Result<()> {
    let mut rustup = Command::new("rustup");
    let mut child = rustup.args(["target", "add", TARGET]).current_dir(workspace()).spawn()?;
    let deadline = Instant::now() + RUSTUP_TIME;
    loop {
        match child.try_wait()? {
            Some(status) if status.success() => return Ok(()),
            Some(status) => bail!("rustup: {status}"),
            None if Instant::now() > deadline => {
                child.kill()?;
                child.wait()?;
                bail!("rustup has taken more than {} s", RUSTUP_TIME.as_secs());
            }
            None => std::thread::sleep(Duration::from_millis(100)),
        }
    }
}

impl Toolchain {
    /// The compiler in a directory, if it is new enough and has all that it takes.
    fn in_dir(dir: Option<PathBuf>) -> Option<Self> {
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
        let sysroot = PathBuf::from(rustc(&["--print", "sysroot"])?);
        let rustlib = sysroot.join("lib/rustlib");
        let builds_core = !rustlib.join(TARGET).join("lib").is_dir();
        if builds_core && !rustlib.join("src/rust/library/core/Cargo.toml").is_file() {
            return None;
        }
        let host = rustc(&["-vV"])?;
        let host = host.lines().find_map(|line| line.strip_prefix("host: "))?;
        let has_own_linker = rustlib.join(host).join("bin/rust-lld").exists();
        if !has_own_linker && !installed(GNU_LINKER, &["--version"]) {
            return None;
        }
        let linker = (!has_own_linker).then_some(GNU_LINKER);
        Some(Self { dir, version, builds_core, linker })
    }

    /// A build of the package `firmware` for the board, with the linker told `link`.
    pub(crate) fn build(&self, link: &[&str]) -> Command {
        let mut cargo = command("cargo", self.dir.as_deref());
        cargo.current_dir(workspace()).stdin(Stdio::null());
        cargo.args(["build", "--profile", "firmware", "--package", "firmware", "--target", TARGET]);
        if self.builds_core {
            cargo.args(["-Z", "build-std=core"]).env("RUSTC_BOOTSTRAP", "1");
        }
        if let Some(linker) = self.linker {
            cargo.env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", linker);
        }
        let flags: Vec<_> = link.iter().map(|argument| format!("-C link-arg={argument}")).collect();
        cargo.env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_RUSTFLAGS", flags.join(" "));
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_compared_by_number() {
        assert!(parts("1.100.0-nightly") > parts("1.89"));
        assert!(parts("1.63.0") < parts("1.89"));
        assert_eq!(parts("1.89.1"), parts("1.89"));
    }
}
