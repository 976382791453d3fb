//! Compilers for other targets: rustup's, or the distribution's with the sources of the standard
//! library, which is compiled as well.

use std::path::Path;
use std::process::{Command, Stdio};

use crate::steps::{installed, workspace};

pub(crate) const BOARD_TARGET: &str = "thumbv7em-none-eabihf";
pub(crate) const PAGE_TARGET: &str = "wasm32-unknown-unknown";

/// Other systems that the program compiles for; Windows without GNU's tools, which may be missing.
pub(crate) const SYSTEMS: [&str; 2] = ["x86_64-pc-windows-msvc", "aarch64-unknown-linux-gnu"];

const DISTRIBUTION: &str = "/usr/bin";

/// A linker that is available without rustup.
const GNU_LINKER: &str = "arm-none-eabi-ld";

/// A compiler that is new enough, and can build for a target and link for the board.
#[derive(Debug)]
pub(crate) struct Compiler {
    /// `None` for the one that runs this task.
    dir: Option<&'static str>,
    pub(crate) version: String,
    target: &'static str,
    pub(crate) std_parts: Option<&'static str>,
    has_linker: bool,
}

impl Compiler {
    /// Finds a compiler for a target: the one that runs this task, or the distribution's.
    pub(crate) fn find(target: &'static str) -> Option<Self> {
        [None, Some(DISTRIBUTION)].into_iter().find_map(|dir| Self::in_dir(dir, target))
    }

    fn in_dir(dir: Option<&'static str>, target: &'static str) -> Option<Self> {
        let rustc = |arguments: &[&str]| -> Option<String> {
            let output = command("rustc", dir).args(arguments).output().ok()?;
            output.status.success().then(|| String::from_utf8(output.stdout).ok())?
        };
        let about = rustc(&["-vV"])?;
        let field = |name| about.lines().find_map(|line| line.strip_prefix(name));
        if parts(field("release: ")?) < parts(env!("CARGO_PKG_RUST_VERSION")) {
            return None;
        }
        let rustlib = Path::new(rustc(&["--print", "sysroot"])?.trim()).join("lib/rustlib");
        let has_sources = rustlib.join("src/rust/library/core/Cargo.toml").is_file();
        let std_parts = match target {
            _ if rustlib.join(target).join("lib").is_dir() => None,
            BOARD_TARGET if has_sources => Some("core"),
            // Its linker comes with rustup's target.
            PAGE_TARGET => return None,
            _ if has_sources => Some("std,panic_abort"),
            _ => return None,
        };
        let has_linker = rustlib.join(field("host: ")?).join("bin/rust-lld").exists();
        if target == BOARD_TARGET && !has_linker && !installed(GNU_LINKER, &["--version"]) {
            return None;
        }
        Some(Self { dir, version: about.lines().next()?.to_owned(), target, std_parts, has_linker })
    }

    pub(crate) fn cargo(&self, arguments: &[&str]) -> Command {
        let mut cargo = command("cargo", self.dir);
        cargo.current_dir(workspace()).stdin(Stdio::null());
        cargo.args(arguments).args(["--target", self.target]);
        if let Some(parts) = self.std_parts {
            cargo.args(["-Z", &format!("build-std={parts}")]).env("RUSTC_BOOTSTRAP", "1");
        }
        if !self.has_linker {
            cargo.env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER", GNU_LINKER);
        }
        cargo
    }
}

/// Returns a compiler's program, without the variables that cargo sets.
fn command(program: &str, dir: Option<&str>) -> Command {
    let Some(dir) = dir else { return Command::new(program) };
    let mut command = Command::new(Path::new(dir).join(program));
    for name in ["CARGO", "RUSTUP_TOOLCHAIN", "LD_LIBRARY_PATH"] {
        command.env_remove(name);
    }
    let path = std::env::var("PATH").unwrap_or_default();
    command.env("PATH", format!("{dir}:{path}"));
    command
}

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
        let compiler = Compiler::find("no-such-target");
        assert!(compiler.is_none_or(|compiler| compiler.std_parts.is_some()));
    }
}
