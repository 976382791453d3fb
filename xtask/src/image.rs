//! The images of the firmware: building them, and what they take.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use object::{Object, ObjectSection, SectionFlags, SectionKind, elf};

use crate::steps::{self, workspace};
use crate::toolchain::{TARGET, Toolchain};

/// Where the RAM of both boards begins, and how much there is.
pub(crate) const RAM: u32 = 0x2000_0000;
pub(crate) const RAM_SIZE: u32 = 64 * 1024;

/// What the board's linker script gives to the stack.
pub(crate) const STACK_SIZE: u32 = 48 * 1024;

/// A binary of the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Image {
    /// For the STM32L432KC.
    SkinProc,
    /// For QEMU.
    Emulated,
}

impl Image {
    fn name(self) -> &'static str {
        match self {
            Image::SkinProc => "skinproc",
            Image::Emulated => "skinproc-emulated",
        }
    }

    /// Builds it and returns where it is.
    pub(crate) fn build(self, toolchain: &Toolchain) -> Result<PathBuf> {
        let (feature, link): (_, &[&str]) = match self {
            Image::SkinProc => ("skinproc", &["-Tlink.x", "--nmagic", "-Tdefmt.x"]),
            Image::Emulated => ("emulated", &["-Tlink.x", "--nmagic"]),
        };
        let mut cargo = toolchain.build(link);
        cargo.args(["--features", feature, "--bin", self.name(), "--target-dir"]).arg(target_dir());
        steps::run(&format!("build {} ({})", self.name(), toolchain.version), &mut cargo)?;
        Ok(self.path())
    }

    /// Where it is once it has been built.
    pub(crate) fn path(self) -> PathBuf {
        target_dir().join(TARGET).join("firmware").join(self.name())
    }
}

/// A directory of its own: the compiler may be another one than the host's.
fn target_dir() -> PathBuf {
    workspace().join("target/firmware")
}

/// Memory that an image takes whatever it does, in bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Footprint {
    /// Code, constants and initial values.
    pub(crate) flash: u64,
    /// Variables, the futures of all tasks among them; not the stack.
    pub(crate) ram: u64,
    /// The first address behind the variables.
    pub(crate) ram_end: u64,
}

/// What the image in a file takes.
pub(crate) fn footprint(path: &Path) -> Result<Footprint> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read `{}`", path.display()))?;
    let file = object::File::parse(&*bytes)
        .with_context(|| format!("`{}` is not an image", path.display()))?;
    let mut footprint = Footprint { ram_end: RAM.into(), ..Footprint::default() };
    for section in file.sections() {
        let SectionFlags::Elf { sh_flags, .. } = section.flags() else { continue };
        if !sh_flags.contains(elf::SHF_ALLOC) {
            continue;
        }
        if section.kind() != SectionKind::UninitializedData {
            footprint.flash += section.size();
        }
        if section.address() >= RAM.into() {
            footprint.ram += section.size();
            footprint.ram_end = footprint.ram_end.max(section.address() + section.size());
        }
    }
    Ok(footprint)
}
