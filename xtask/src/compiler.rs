//! Compilers for other targets: rustup's, or the distribution's with the sources of the standard
//! library, which is then compiled along.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::steps::workspace;

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
