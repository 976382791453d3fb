//! The images of the firmware: building them, and what they take.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};
use object::{Object, ObjectSection, SectionFlags, SectionKind, elf};

use crate::compiler::{BOARD_TARGET, Toolchain};
use crate::steps::{self, workspace};

/// Where the RAM of all boards begins.
const RAM: u32 = 0x2000_0000;

/// A board that can be flashed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Board {
    /// The SkinProc board, and the Nucleo-L432KC with the same chip
    #[value(name = "skinproc")]
    SkinProc,
    /// The Nucleo-G491RE
    #[value(name = "nucleo-g491re")]
    NucleoG491re,
}

impl Board {
    pub(crate) const ALL: [Self; 2] = [Self::SkinProc, Self::NucleoG491re];

    /// That of the feature, the binary, and the linker's map.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::SkinProc => "skinproc",
            Self::NucleoG491re => "nucleo-g491re",
        }
    }

    /// Its microcontroller by the name that probe-rs has for it.
    pub(crate) fn chip(self) -> &'static str {
        match self {
            Self::SkinProc => "STM32L432KCUx",
            Self::NucleoG491re => "STM32G491RETx",
        }
    }

    /// What its linker script gives to the stack: all of SRAM1.
    pub(crate) fn stack_size(self) -> u64 {
        match self {
            Self::SkinProc => 48 * 1024,
            Self::NucleoG491re => 80 * 1024,
        }
    }

    /// Flash for code, without the pages of the calibration.
    pub(crate) fn flash_size(self) -> u64 {
        match self {
            Self::SkinProc => 248 * 1024,
            Self::NucleoG491re => 504 * 1024,
        }
    }

    /// What its linker script gives to variables: all of SRAM2.
    pub(crate) fn ram_size(self) -> u64 {
        16 * 1024
    }

    /// Lints what only the board's target compiles; warnings are errors.
    pub(crate) fn lint(self, toolchain: &Toolchain) -> Result<()> {
        let mut cargo = self.cargo("clippy", toolchain);
        steps::run(&format!("lints of {}", self.name()), cargo.args(["--", "-D", "warnings"]))
    }

    /// Builds its image and returns where it is.
    pub(crate) fn build(self, toolchain: &Toolchain) -> Result<PathBuf> {
        let title = format!("build {} ({})", self.name(), toolchain.compiler.version);
        steps::run(&title, &mut self.cargo("build", toolchain))?;
        Ok(self.image())
    }

    fn cargo(self, name: &str, toolchain: &Toolchain) -> Command {
        let mut cargo = toolchain.command(name);
        cargo.args(["--features", self.name(), "--bin", self.name(), "--target-dir"]);
        cargo.arg(target_dir());
        cargo
    }

    /// Where its image is once it has been built.
    pub(crate) fn image(self) -> PathBuf {
        target_dir().join(BOARD_TARGET).join("firmware").join(self.name())
    }
}

/// A directory of its own: the compiler may be another one than the host's.
fn target_dir() -> PathBuf {
    workspace().join("target/firmware")
}

/// Memory that the image in a file takes whatever it does, in bytes: flash for code, constants and initial values, and
/// RAM for variables, the futures of all tasks among them, but not for the stack.
pub(crate) fn footprint(path: &Path) -> Result<(u64, u64)> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read `{}`", path.display()))?;
    let file = object::File::parse(&*bytes)
        .with_context(|| format!("`{}` is not an image", path.display()))?;
    let (mut flash, mut ram) = (0, 0);
    for section in file.sections() {
        let SectionFlags::Elf { sh_flags, .. } = section.flags() else { continue };
        if !sh_flags.contains(elf::SHF_ALLOC) {
            continue;
        }
        if section.kind() != SectionKind::UninitializedData {
            flash += section.size();
        }
        if section.address() >= RAM.into() {
            ram += section.size();
        }
    }
    Ok((flash, ram))
}
