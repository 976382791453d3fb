//! `cargo xtask firmware`: builds the board's image and says what it takes of the board.
//!
//! Flash, RAM and a bound on the stack are read off the image. Instructions and the deepest that the
//! stack has been seen are those of the flashed image on the model of its microcontroller; where there
//! is no model, those of the emulated board, whose drivers are its own. Either is the same every run.

use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use shared_proto::{Calibration, Command, MAX_PIECE, Piece, Stream, crc32};
use system_tests::emulation::{Memory, PlayedFrame};
use system_tests::flashed::Model;
use system_tests::workload;

use crate::emulator::{self, Run};
use crate::image::{self, Footprint, Image, STACK_SIZE};
use crate::model::{self, Measured};
use crate::stack;
use crate::steps;
use crate::toolchain;

/// What the image may take of the STM32L432KC's 256 KiB of flash and 64 KiB of RAM.
const FLASH_LIMIT: u64 = 96 * 1024;
const RAM_LIMIT: u64 = 16 * 1024;

/// The board's core, and the rate at which frames are due.
const CORE_HZ: f64 = 80e6;
const RATE_HZ: f64 = 100.0;

/// What a frame may take, of readings and of the wrenches of a polynomial, a fortieth of the core; and of those of
/// the physics model.
const INSTRUCTIONS_LIMIT: f64 = 20_000.0;
const PHYSICS_LIMIT: f64 = 40_000.0;

/// Frames of two runs, whose difference is that of frames in the middle of a stream.
const FRAMES: [u32; 2] = [500, 1500];

/// Builds both images, measures, prints, and is an error above a limit. Returns the emulated one.
pub(crate) fn check() -> Result<PathBuf> {
    let toolchain = toolchain::set_up()?;
    emulator::set_up()?;
    let image = Image::SkinProc.build(&toolchain)?;
    let emulated = Image::Emulated.build(&toolchain)?;
    let footprint = image::footprint(&image)?;
    let mut report = Report {
        footprint,
        stack_bound: stack::bound(&image)?,
        streams: Workload::ALL
            .map(|workload| stream(&emulated, workload))
            .into_iter()
            .collect::<Result<_>>()?,
        commands: run_once(&emulated, setting_up(), "commands")?,
        where_measured: "of the emulated board",
    };
    // The bound is by the machine code alone; here it is held against what was seen.
    let bound = stack::bound(&emulated)?;
    ensure!(report.stack() <= bound, "{} B of stack seen, {bound} B thought of", report.stack());
    match model::find() {
        Ok(model) => report.measure_flashed(&model)?,
        Err(reason) => eprintln!("{reason:#}: the flashed image is not executed"),
    }
    println!("{}: {}\n{report}", image.display(), toolchain.version);
    let exceeded = report.exceeded();
    if !exceeded.is_empty() {
        bail!("the firmware is above its limits: {}", exceeded.join(", "));
    }
    Ok(emulated)
}

/// The image for the board, for who wants to flash it.
pub(crate) fn build() -> Result<PathBuf> {
    Image::SkinProc.build(&toolchain::set_up()?)
}

/// What is streamed.
#[derive(Clone, Copy)]
enum Workload {
    Readings,
    Cubic,
    Physics,
    /// What no wrench explains, at which the steps of the inversion end last.
    Misfits,
}

impl Workload {
    const ALL: [Self; 4] = [Self::Readings, Self::Cubic, Self::Physics, Self::Misfits];

    fn name(self) -> &'static str {
        match self {
            Self::Readings => "readings",
            Self::Cubic => "wrenches, cubic",
            Self::Physics => "wrenches, physics",
            Self::Misfits => "physics, no wrench fits",
        }
    }

    fn mode(self) -> Stream {
        match self {
            Self::Readings => Stream::Raw,
            _ => Stream::Wrench,
        }
    }

    fn calibration(self) -> Calibration {
        match self {
            Self::Readings | Self::Cubic => workload::cubic(),
            Self::Physics | Self::Misfits => workload::physics(),
        }
    }

    fn played(self) -> Vec<PlayedFrame> {
        match self {
            Self::Physics => workload::poses(),
            _ => workload::everywhere(),
        }
    }

    /// Instructions that a frame may take; those of readings that are none are only told.
    fn limit(self) -> Option<f64> {
        match self {
            Self::Readings | Self::Cubic => Some(INSTRUCTIONS_LIMIT),
            Self::Physics => Some(PHYSICS_LIMIT),
            Self::Misfits => None,
        }
    }
}

/// A stream of frames.
struct Streaming {
    workload: Workload,
    instructions_per_frame: f64,
    stack: u32,
}

impl Streaming {
    fn share(&self) -> f64 {
        self.instructions_per_frame * RATE_HZ / CORE_HZ
    }

    fn is_too_much(&self) -> bool {
        self.workload.limit().is_some_and(|limit| self.instructions_per_frame > limit)
    }
}

struct Report {
    footprint: Footprint,
    stack_bound: u32,
    streams: Vec<Streaming>,
    commands: Run,
    where_measured: &'static str,
}

impl Report {
    /// Takes the figures of the flashed image in place of the emulated one's.
    fn measure_flashed(&mut self, model: &Model) -> Result<()> {
        for stream in &mut self.streams {
            let workload = stream.workload;
            let (played, calibration) = (workload.played(), workload.calibration());
            let Measured { instructions_per_frame, stack } =
                model::measure(model, workload.mode(), &played, &calibration, RATE_HZ)?;
            ensure!(stack <= self.stack_bound, "{stack} B of stack seen, more than the bound");
            *stream = Streaming { workload, instructions_per_frame, stack };
        }
        // Every stream has been set up by commands.
        self.commands.stack = 0;
        self.where_measured = "of the flashed image";
        Ok(())
    }

    /// The deepest in emulation.
    fn stack(&self) -> u32 {
        let streams = self.streams.iter().map(|stream| stream.stack);
        streams.fold(self.commands.stack, u32::max)
    }

    fn exceeded(&self) -> Vec<&'static str> {
        let Self { footprint, streams, .. } = self;
        let checks = [
            (footprint.flash > FLASH_LIMIT, "flash"),
            (footprint.ram > RAM_LIMIT, "RAM"),
            (self.stack_bound > STACK_SIZE, "stack"),
            (streams.iter().any(Streaming::is_too_much), "instructions"),
        ];
        checks.into_iter().filter(|(exceeded, _)| *exceeded).map(|(_, what)| what).collect()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kib = |bytes: u64| bytes as f64 / 1024.0;
        let Footprint { flash, ram, .. } = self.footprint;
        writeln!(f, "  flash        {:6.1} KiB of {:.0}", kib(flash), kib(FLASH_LIMIT))?;
        writeln!(f, "  static RAM   {:6.1} KiB of {:.0}", kib(ram), kib(RAM_LIMIT))?;
        let (bound, seen) = (kib(self.stack_bound.into()), kib(self.stack().into()));
        writeln!(
            f,
            "  stack        {bound:6.1} KiB of {:.0} at most, {seen:.1} seen, {}",
            kib(STACK_SIZE.into()),
            self.where_measured
        )?;
        writeln!(f, "  instructions per frame, {}:", self.where_measured)?;
        for stream in &self.streams {
            let Streaming { workload, instructions_per_frame, .. } = stream;
            let limit = workload.limit().map_or(String::new(), |limit| format!(" of {limit}"));
            writeln!(
                f,
                "    {:<24} {instructions_per_frame:8.1}{limit}: {:.2} % of {:.0} MHz at {RATE_HZ} Hz",
                workload.name(),
                stream.share() * 100.0,
                CORE_HZ / 1e6,
            )?;
        }
        Ok(())
    }
}

/// Streams, with a short run and a long one.
fn stream(image: &Path, workload: Workload) -> Result<Streaming> {
    let commands: &[Command] = match workload.mode() {
        Stream::Raw | Stream::Other(_) => &[Command::Start],
        Stream::Wrench => &[Command::SetStream(Stream::Wrench), Command::Start],
    };
    let (played, calibration) = (workload.played(), workload.calibration());
    let run = |frames: u32| {
        let memory = Memory::new().play(&played).keep(&calibration).order(commands, frames);
        run_once(image, memory, "stream")
    };
    let [short, long] = [run(FRAMES[0])?, run(FRAMES[1])?];
    let instructions = (long.instructions - short.instructions) as f64;
    Ok(Streaming {
        workload,
        instructions_per_frame: instructions / f64::from(FRAMES[1] - FRAMES[0]),
        stack: long.stack.max(short.stack),
    })
}

/// Every command, in an order that makes sense, and a stream with a zero taken.
fn setting_up() -> Memory {
    let bytes = workload::physics().to_bytes();
    let pieces = bytes.chunks(MAX_PIECE).enumerate().filter_map(|(i, piece)| {
        let data = Piece::copy_of(piece)?;
        Some(Command::CalibrationPiece { offset: (i * MAX_PIECE) as u16, data })
    });
    let begin = Command::BeginCalibration { size: bytes.len() as u32, crc32: crc32(&bytes) };
    let mut commands = vec![Command::Identify, Command::Status, begin];
    commands.extend(pieces);
    commands.extend([
        Command::CommitCalibration,
        Command::SetOversampling { conversions: 64 },
        Command::SetSettling { settling_us: 100 },
        Command::SetPeriod { period_us: 5_000 },
        Command::SetStream(Stream::Wrench),
        Command::Zero { frames: 10 },
        Command::Start,
        Command::Status,
    ]);
    Memory::new().play(&workload::poses()).order(&commands, 100)
}

fn run_once(image: &Path, memory: Memory, name: &str) -> Result<Run> {
    let ram_end = u32::try_from(image::footprint(image)?.ram_end)?;
    let dir = steps::scratch("emulation")?.join(name);
    std::fs::create_dir_all(&dir)?;
    emulator::run(image, memory, ram_end, &dir)
}
