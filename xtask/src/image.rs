//! The images of the firmware: building, flashing, and resource use.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Result, ensure};
use object::{Object, ObjectSection, SectionFlags, SectionKind, elf};

use crate::compiler::{BOARD_TARGET, Compiler};
use crate::need;
use crate::steps::{self, installed, workspace};

const RAM: u32 = 0x2000_0000;

/// Linker arguments, and symbol names that contain types (for stack.rs).
const FLAGS: &str = "-C link-arg=-Tlink.x -C link-arg=--nmagic -C link-arg=-Tdefmt.x \
    -C symbol-mangling-version=v0";

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

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::SkinProc => "skinproc",
            Self::NucleoG491re => "nucleo-g491re",
        }
    }

    pub(crate) fn chip(self) -> &'static str {
        match self {
            Self::SkinProc => "STM32L432KCUx",
            Self::NucleoG491re => "STM32G491RETx",
        }
    }

    /// Returns sizes in bytes: flash for code without the calibration's pages, and RAM for
    /// variables (all of SRAM2) and for the stack (all of SRAM1).
    pub(crate) fn memory(self) -> [u64; 3] {
        match self {
            Self::SkinProc => [248, 16, 48].map(|kib| kib * 1024),
            Self::NucleoG491re => [504, 16, 80].map(|kib| kib * 1024),
        }
    }

    pub(crate) fn lint(self, compiler: &Compiler) -> Result<()> {
        let mut cargo = self.cargo("clippy", compiler);
        steps::run(&format!("lints of {}", self.name()), cargo.args(["--", "-D", "warnings"]))
    }

    pub(crate) fn build(self) -> Result<PathBuf> {
        let compiler = need::compiler(BOARD_TARGET)?;
        let title = format!("build {} ({})", self.name(), compiler.version);
        steps::run(&title, &mut self.cargo("build", &compiler))?;
        Ok(self.image())
    }

    fn cargo(self, name: &str, compiler: &Compiler) -> Command {
        let mut cargo = compiler.cargo(&[name, "--profile", "firmware", "--package", "firmware"]);
        cargo.args(["--features", self.name(), "--bin", self.name(), "--target-dir"]);
        cargo.arg(target_dir()).env("CARGO_TARGET_THUMBV7EM_NONE_EABIHF_RUSTFLAGS", FLAGS);
        cargo
    }

    pub(crate) fn image(self) -> PathBuf {
        target_dir().join(BOARD_TARGET).join("firmware").join(self.name())
    }
}

/// Folder for images only, as their compiler may differ from the host's.
fn target_dir() -> PathBuf {
    workspace().join("target/firmware")
}

/// Returns the static memory use in bytes: flash for code, constants and initial values, and RAM
/// for variables, including all tasks' futures, without the stack.
pub(crate) fn footprint(image: &object::File<'_>) -> (u64, u64) {
    let (mut flash, mut ram) = (0, 0);
    for section in image.sections() {
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
    (flash, ram)
}

#[derive(Debug, clap::Args)]
pub(crate) struct FlashArgs {
    /// Board at the probe
    #[arg(long, value_enum, default_value = "skinproc")]
    board: Board,

    /// Probe to use if there are several, as `probe-rs list` names it
    #[arg(long, value_name = "VID:PID[:SERIAL]")]
    probe: Option<String>,

    /// Stay and print the board's log
    #[arg(long)]
    log: bool,
}

pub(crate) fn flash(args: &FlashArgs) -> Result<()> {
    // Checked before spending minutes on the image.
    ensure!(
        installed("probe-rs", &["--version"]),
        "`probe-rs` is missing, which talks to the debug probe; install it with \
         `cargo install --locked probe-rs-tools`, or see https://probe.rs/docs/getting-started"
    );
    let image = args.board.build()?;
    let mut probe = vec!["--chip", args.board.chip()];
    if let Some(selector) = &args.probe {
        probe.extend(["--probe", selector]);
    }
    let command = |name: &str| {
        let mut command = Command::new("probe-rs");
        command.arg(name).args(&probe);
        command
    };
    if args.log {
        return steps::run("flash, reset, and listen until Ctrl-C", command("run").arg(&image));
    }
    steps::run("flash", command("download").arg("--verify").arg(&image))?;
    steps::run("reset", &mut command("reset"))
}
