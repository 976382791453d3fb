//! `cargo xtask firmware`: builds the boards' images and says what they take of the boards.
//!
//! Flash, RAM and a bound on the stack are read off an image. Instructions and the deepest that the
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
use crate::image::{self, Board, Footprint, Image};
use crate::model::{self, Measured};
use crate::stack;
use crate::steps;
use crate::toolchain;

/// What an image may take of the STM32L432KC's 256 KiB of flash and 64 KiB of RAM; other boards have more.
const FLASH_LIMIT: u64 = 96 * 1024;
const RAM_LIMIT: u64 = 16 * 1024;

/// The boards' core, and the rate at which frames are due.
const CORE_HZ: f64 = 80e6;
const RATE_HZ: f64 = 100.0;

/// What a frame may take, of readings and of the wrenches of a polynomial, a fortieth of the core; and of those of
/// the physics model.
const INSTRUCTIONS_LIMIT: f64 = 20_000.0;
const PHYSICS_LIMIT: f64 = 40_000.0;

/// Frames of two runs, whose difference is that of frames in the middle of a stream.
const FRAMES: [u32; 2] = [500, 1500];

/// Builds all images, measures, prints, and is an error above a limit. Returns the emulated one.
pub(crate) fn check() -> Result<PathBuf> {
    let toolchain = toolchain::set_up()?;
    emulator::set_up()?;
    let emulated = Image::Emulated.build(&toolchain)?;
    let in_emulation = Measurements::of_emulated(&emulated)?;
    // The bound is by the machine code alone; here it is held against what was seen.
    let (seen, bound) = (in_emulation.stack(), stack::bound(&emulated)?);
    ensure!(seen <= bound, "{seen} B of stack seen, {bound} B thought of");
    let mut exceeded = Vec::new();
    for board in Board::ALL {
        let image = board.image().build(&toolchain)?;
        let report = Report::new(board, &image, &in_emulation)?;
        println!("{}: {}\n{report}", image.display(), toolchain.version);
        exceeded.extend(report.exceeded().map(|what| format!("{what} of {}", board.name())));
    }
    if !exceeded.is_empty() {
        bail!("the firmware is above its limits: {}", exceeded.join(", "));
    }
    Ok(emulated)
}

/// The image for a board, for who wants to flash it.
pub(crate) fn build(board: Board) -> Result<PathBuf> {
    board.image().build(&toolchain::set_up()?)
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

    /// Instructions that a frame may take.
    fn limit(self) -> f64 {
        match self {
            Self::Readings | Self::Cubic => INSTRUCTIONS_LIMIT,
            Self::Physics | Self::Misfits => PHYSICS_LIMIT,
        }
    }
}

/// A stream of frames.
#[derive(Clone)]
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
        self.instructions_per_frame > self.workload.limit()
    }
}

/// What running an image has shown.
#[derive(Clone)]
struct Measurements {
    streams: Vec<Streaming>,
    /// The stack that commands take.
    commands_stack: u32,
    whose: &'static str,
}

impl Measurements {
    fn of_emulated(image: &Path) -> Result<Self> {
        let streams = Workload::ALL.into_iter().map(|workload| stream(image, workload));
        let commands = run_once(image, setting_up(), "commands")?;
        Ok(Self {
            streams: streams.collect::<Result<_>>()?,
            commands_stack: commands.stack,
            whose: "of the emulated board",
        })
    }

    fn of_flashed(model: &Model) -> Result<Self> {
        let measure = |workload: Workload| -> Result<Streaming> {
            let (played, calibration) = (workload.played(), workload.calibration());
            let Measured { instructions_per_frame, stack } =
                model::measure(model, workload.mode(), &played, &calibration, RATE_HZ)?;
            Ok(Streaming { workload, instructions_per_frame, stack })
        };
        let streams = Workload::ALL.into_iter().map(measure).collect::<Result<_>>()?;
        // Every stream has been set up by commands.
        Ok(Self { streams, commands_stack: 0, whose: "of the flashed image" })
    }

    /// The deepest that the stack has been.
    fn stack(&self) -> u32 {
        let streams = self.streams.iter().map(|stream| stream.stack);
        streams.fold(self.commands_stack, u32::max)
    }
}

struct Report {
    board: Board,
    footprint: Footprint,
    stack_bound: u32,
    measurements: Measurements,
}

impl Report {
    fn new(board: Board, image: &Path, in_emulation: &Measurements) -> Result<Self> {
        let stack_bound = stack::bound(image)?;
        let measurements = match model::find(board) {
            Ok(model) => {
                let measurements = Measurements::of_flashed(&model)?;
                let seen = measurements.stack();
                ensure!(seen <= stack_bound, "{seen} B of stack seen, {stack_bound} B thought of");
                measurements
            }
            Err(reason) => {
                eprintln!("{reason:#}: the flashed image is not executed");
                in_emulation.clone()
            }
        };
        Ok(Self { board, footprint: image::footprint(image)?, stack_bound, measurements })
    }

    fn exceeded(&self) -> impl Iterator<Item = &'static str> {
        let Self { footprint, measurements, .. } = self;
        let checks = [
            (footprint.flash > FLASH_LIMIT, "flash"),
            (footprint.ram > RAM_LIMIT, "RAM"),
            (self.stack_bound > self.board.stack_size(), "stack"),
            (measurements.streams.iter().any(Streaming::is_too_much), "instructions"),
        ];
        checks.into_iter().filter(|(exceeded, _)| *exceeded).map(|(_, what)| what)
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kib = |bytes: u64| bytes as f64 / 1024.0;
        let Footprint { flash, ram, .. } = self.footprint;
        writeln!(f, "  flash        {:6.1} KiB of {:.0}", kib(flash), kib(FLASH_LIMIT))?;
        writeln!(f, "  static RAM   {:6.1} KiB of {:.0}", kib(ram), kib(RAM_LIMIT))?;
        let Measurements { streams, whose, .. } = &self.measurements;
        let (bound, seen) = (kib(self.stack_bound.into()), kib(self.measurements.stack().into()));
        writeln!(
            f,
            "  stack        {bound:6.1} KiB of {:.0} at most, {seen:.1} seen, {whose}",
            kib(self.board.stack_size().into()),
        )?;
        writeln!(f, "  instructions per frame, {whose}:")?;
        for stream in streams {
            let Streaming { workload, instructions_per_frame, .. } = stream;
            let limit = workload.limit();
            writeln!(
                f,
                "    {:<24} {instructions_per_frame:8.1} of {limit}: {:.2} % of {:.0} MHz at {RATE_HZ} Hz",
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
