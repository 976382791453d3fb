//! `cargo xtask firmware`: builds the boards' images and says what they take of the boards.
//!
//! Flash, RAM and a bound on the stack are read off an image. Instructions and the deepest that the
//! stack has been seen are those of the flashed image on the model of its microcontroller; where there
//! is no model, those of the emulated board, whose drivers are its own. Either is the same every run
//! with the same compiler. Another compiler executes a few more or a few less, so they are printed
//! beside those of `firmware/measured.toml`, and only a frame that costs far more is an error.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use shared_proto::{Calibration, Command, MAX_PIECE, Piece, Stream, crc32};
use system_tests::emulation::{Memory, PlayedFrame};
use system_tests::flashed::Model;
use system_tests::workload;

use crate::emulator::{self, Run};
use crate::image::{self, Board, Footprint, Image};
use crate::model::{self, Measured};
use crate::stack;
use crate::steps::{self, workspace};
use crate::toolchain;

#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct Args {
    /// Keep what was measured in firmware/measured.toml, for later runs to compare with
    #[arg(long)]
    record: bool,
}

/// What an image may take of the STM32L432KC's 256 KiB of flash and 64 KiB of RAM; other boards have more.
const FLASH_LIMIT: u64 = 96 * 1024;
const RAM_LIMIT: u64 = 16 * 1024;

/// The boards' core, and the rate at which frames are due.
const CORE_HZ: f64 = 80e6;
const RATE_HZ: f64 = 100.0;

/// How many times the recorded instructions a frame may take: more than two compilers differ by.
const INSTRUCTIONS_FACTOR: f64 = 1.25;

/// Where measurements are recorded.
const RECORD: &str = "firmware/measured.toml";
const RECORD_HEAD: &str = "\
# Instructions from one frame to the next, as `cargo xtask firmware --record` measured them: of each
# board's image on the model of its microcontroller, and of the emulated board's in QEMU.

";

/// Frames of two runs, whose difference is that of frames in the middle of a stream.
const FRAMES: [u32; 2] = [500, 1500];

/// Builds all images, measures, prints, and is an error above a limit.
pub(crate) fn run(args: Args) -> Result<()> {
    let measured = measure()?;
    if args.record { measured.write() } else { Ok(()) }
}

fn measure() -> Result<Record> {
    let recorded = Record::read()?;
    let toolchain = toolchain::set_up()?;
    emulator::set_up()?;
    let emulated = Image::Emulated.build(&toolchain)?;
    let in_emulation = Measurements::of_emulated(&emulated)?;
    // The bound is by the machine code alone; here it is held against what was seen.
    let (seen, bound) = (in_emulation.stack(), stack::bound(&emulated)?);
    ensure!(seen <= bound, "{seen} B of stack seen, {bound} B thought of");
    let compiler: Vec<&str> = toolchain.version.split(' ').take(2).collect();
    let mut measured = Record { compiler: compiler.join(" "), ..Record::default() };
    measured.add(&in_emulation);
    let mut exceeded = Vec::new();
    for board in Board::ALL {
        let image = board.image().build(&toolchain)?;
        let report = Report::new(board, &image, &in_emulation, &recorded)?;
        println!("{}: {}\n{report}", image.display(), toolchain.version);
        measured.add(&report.measurements);
        exceeded.extend(report.exceeded().map(|what| format!("{what} of {}", board.name())));
    }
    if !exceeded.is_empty() {
        bail!("the firmware is above its limits: {}", exceeded.join(", "));
    }
    Ok(measured)
}

/// Instructions of each workload, by whose they are.
#[derive(Debug, Default, Serialize, Deserialize)]
struct Record {
    compiler: String,
    #[serde(flatten)]
    instructions: BTreeMap<String, BTreeMap<String, f64>>,
}

impl Record {
    /// Reads what was recorded last.
    fn read() -> Result<Self> {
        let text = std::fs::read_to_string(workspace().join(RECORD)).context(RECORD)?;
        toml::from_str(&text).context(RECORD)
    }

    fn write(&self) -> Result<()> {
        let text = toml::to_string(self).context(RECORD)?;
        std::fs::write(workspace().join(RECORD), format!("{RECORD_HEAD}{text}")).context(RECORD)
    }

    fn add(&mut self, measurements: &Measurements) {
        let rounded = |stream: &Streaming| (stream.instructions_per_frame * 10.0).round() / 10.0;
        let streams = measurements.streams.iter();
        let table = streams.map(|stream| (stream.workload.name().to_owned(), rounded(stream)));
        self.instructions.insert(measurements.whose.to_owned(), table.collect());
    }

    fn of(&self, whose: &str, workload: Workload) -> Option<f64> {
        self.instructions.get(whose)?.get(workload.name()).copied()
    }
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

    fn is_too_much(&self, recorded: Option<f64>) -> bool {
        recorded
            .is_some_and(|recorded| self.instructions_per_frame > INSTRUCTIONS_FACTOR * recorded)
    }
}

/// What running an image has shown.
#[derive(Clone)]
struct Measurements {
    streams: Vec<Streaming>,
    /// The stack that commands take.
    commands_stack: u32,
    /// The name of the board, `EMULATED` in QEMU.
    whose: &'static str,
}

const EMULATED: &str = "emulated";

impl Measurements {
    fn of_emulated(image: &Path) -> Result<Self> {
        let streams = Workload::ALL.into_iter().map(|workload| stream(image, workload));
        let commands = run_once(image, setting_up(), "commands")?;
        Ok(Self {
            streams: streams.collect::<Result<_>>()?,
            commands_stack: commands.stack,
            whose: EMULATED,
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
        Ok(Self { streams, commands_stack: 0, whose: model.board })
    }

    /// The deepest that the stack has been.
    fn stack(&self) -> u32 {
        let streams = self.streams.iter().map(|stream| stream.stack);
        streams.fold(self.commands_stack, u32::max)
    }
}

struct Report<'a> {
    recorded: &'a Record,
    board: Board,
    footprint: Footprint,
    stack_bound: u32,
    measurements: Measurements,
}

impl<'a> Report<'a> {
    fn new(
        board: Board,
        image: &Path,
        in_emulation: &Measurements,
        recorded: &'a Record,
    ) -> Result<Self> {
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
        let footprint = image::footprint(image)?;
        Ok(Self { recorded, board, footprint, stack_bound, measurements })
    }

    fn exceeded(&self) -> impl Iterator<Item = &'static str> {
        let Self { footprint, measurements, .. } = self;
        let is_too_much = |stream: &Streaming| {
            stream.is_too_much(self.recorded.of(measurements.whose, stream.workload))
        };
        let checks = [
            (footprint.flash > FLASH_LIMIT, "flash"),
            (footprint.ram > RAM_LIMIT, "RAM"),
            (self.stack_bound > self.board.stack_size(), "stack"),
            (measurements.streams.iter().any(is_too_much), "instructions"),
        ];
        checks.into_iter().filter(|(exceeded, _)| *exceeded).map(|(_, what)| what)
    }
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kib = |bytes: u64| bytes as f64 / 1024.0;
        let Footprint { flash, ram, .. } = self.footprint;
        writeln!(f, "  flash        {:6.1} KiB of {:.0}", kib(flash), kib(FLASH_LIMIT))?;
        writeln!(f, "  static RAM   {:6.1} KiB of {:.0}", kib(ram), kib(RAM_LIMIT))?;
        let Measurements { streams, whose, .. } = &self.measurements;
        let (bound, seen) = (kib(self.stack_bound.into()), kib(self.measurements.stack().into()));
        writeln!(
            f,
            "  stack        {bound:6.1} KiB of {:.0} at most, {seen:.1} seen ({whose})",
            kib(self.board.stack_size().into()),
        )?;
        writeln!(f, "  instructions per frame ({whose}):")?;
        for stream in streams {
            let Streaming { workload, instructions_per_frame, .. } = stream;
            let recorded = match self.recorded.of(whose, *workload) {
                Some(recorded) => {
                    let change = (instructions_per_frame / recorded - 1.0) * 100.0;
                    format!("{change:+.1} % since {}", self.recorded.compiler)
                }
                None => "never recorded".to_owned(),
            };
            writeln!(
                f,
                "    {:<24} {instructions_per_frame:8.1}, {:.2} % of {:.0} MHz at {RATE_HZ} Hz; {recorded}",
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
