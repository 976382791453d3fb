//! `cargo xtask firmware`: builds the boards' images and reports their resource use. Flash, RAM and
//! a bound on the stack are read from an image. Instructions and the observed stack depth come from
//! the model of its microcontroller, the same in every run with the same compiler. All are printed
//! next to `firmware/measured.toml`. An image that does not fit, or a frame that costs far more
//! than before, is an error.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use shared_proto::{
    BoardId, Calibration, Command as Order, MAX_PIECE, Packet, Piece, Stream, crc32,
};
use system_tests::flashed::{FlashedBoard, Model, PlayedFrame, SERIAL};
use system_tests::workload;

use crate::compiler::BOARD_TARGET;
use crate::image::{self, Board};
use crate::need;
use crate::python;
use crate::stack;
use crate::steps::{self, workspace};

#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct FirmwareArgs {
    /// Store the measurements in firmware/measured.toml, for comparison in later runs
    #[arg(long)]
    record: bool,
}

const CORE_HZ: f64 = 80e6;
const RATE_HZ: f64 = 100.0;

/// Maximum instructions of a frame over the recorded value: more than compilers differ.
const INSTRUCTIONS_FACTOR: f64 = 1.25;

const RECORD: &str = "firmware/measured.toml";
const RECORD_HEAD: &str = "\
# Sizes of the images in bytes, and instructions from one frame to the next on the model of the
# microcontroller, measured by `cargo xtask firmware --record`.

";

/// Lints, builds and measures all images; an error if something does not fit.
pub(crate) fn run(args: FirmwareArgs) -> Result<()> {
    let record = workspace().join(RECORD);
    let recorded = std::fs::read_to_string(&record).context(RECORD)?;
    let recorded: MeasuredImages = toml::from_str(&recorded).context(RECORD)?;
    let compiler = need::compiler(BOARD_TARGET)?;
    let version = compiler.version.split(" (").next().unwrap_or_default().to_owned();
    let mut measured = MeasuredImages { compiler: version, boards: BTreeMap::new() };
    let mut exceeded = Vec::new();
    for board in Board::ALL {
        board.lint(&compiler)?;
        let image = board.build()?;
        let before = recorded.boards.get(board.name()).cloned().unwrap_or_default();
        let taken = Taken::measure(board, &image)?;
        println!("{}: {}", image.display(), compiler.version);
        let too_much = taken.report(board, &before, &recorded.compiler).into_iter();
        exceeded.extend(too_much.map(|what| format!("{what} of {}", board.name())));
        measured.boards.insert(board.name().to_owned(), taken);
    }
    ensure!(exceeded.is_empty(), "the firmware takes too much: {}", exceeded.join(", "));
    if args.record {
        let text = toml::to_string(&measured).context(RECORD)?;
        std::fs::write(record, format!("{RECORD_HEAD}{text}")).context(RECORD)?;
    }
    Ok(())
}

#[derive(Debug, Default, Serialize, Deserialize)]
struct MeasuredImages {
    compiler: String,
    #[serde(flatten)]
    boards: BTreeMap<String, Taken>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
struct Taken {
    flash: u64,
    ram: u64,
    /// Depth of the stack, bytes: a bound, and the greatest observed.
    stack_bound: u64,
    stack_seen: u64,
    instructions: BTreeMap<String, f64>,
}

impl Taken {
    fn measure(board: Board, image: &Path) -> Result<Self> {
        let bytes = std::fs::read(image).with_context(|| image.display().to_string())?;
        let image = object::File::parse(&*bytes).context("not an image")?;
        let (flash, ram) = image::footprint(&image);
        let stack_bound = stack::bound(&image)?.into();
        let mut taken = Self { flash, ram, stack_bound, ..Self::default() };
        match model(board) {
            Ok(model) => {
                for (name, mode, calibration, played) in WORKLOADS {
                    let (played, calibration) = (played(), calibration());
                    let (instructions, stack) =
                        stream(&model, mode, &played, &calibration, RATE_HZ)?;
                    let instructions = (instructions * 10.0).round() / 10.0;
                    taken.instructions.insert(name.to_owned(), instructions);
                    taken.stack_seen = taken.stack_seen.max(stack.into());
                }
            }
            Err(reason) => eprintln!("{reason:#}: the flashed image is not executed"),
        }
        if taken.stack_seen > stack_bound {
            bail!("{} B of stack seen, {stack_bound} B thought of", taken.stack_seen);
        }
        Ok(taken)
    }

    /// Prints the measurements; returns those that do not fit or cost far more than before.
    fn report(&self, board: Board, before: &Self, compiler: &str) -> Vec<String> {
        let [flash, ram, stack] = board.memory();
        let kib = |bytes: u64| format!("{:8.1} KiB", bytes as f64 / 1024.0);
        let sizes = [
            ("flash", self.flash, before.flash, flash),
            ("static RAM", self.ram, before.ram, ram),
            ("stack at most", self.stack_bound, before.stack_bound, stack),
            ("stack seen", self.stack_seen, before.stack_seen, stack),
        ];
        println!("  {:<24} {:>12} {:>12} {:>12}", "", "now", "recorded", "of");
        let mut exceeded = Vec::new();
        for (name, now, then, room) in sizes {
            exceeded.extend((now > room).then(|| name.to_owned()));
            println!("  {name:<24} {} {} {}", kib(now), kib(then), kib(room));
        }
        println!("  instructions per frame (recorded with {compiler}):");
        for (workload, now) in &self.instructions {
            let then = before.instructions.get(workload).copied().unwrap_or_default();
            let share = now * RATE_HZ / CORE_HZ * 100.0;
            println!("  {workload:<24} {now:>12.1} {then:>12.1} {share:>10.2} %");
            if then > 0.0 && *now > INSTRUCTIONS_FACTOR * then {
                exceeded.push(format!("instructions for {workload}"));
            }
        }
        exceeded
    }
}

type Workload = (&'static str, Stream, fn() -> Calibration, fn() -> Vec<PlayedFrame>);

/// No wrench explains the last workload, so its inversion takes the most steps.
const WORKLOADS: [Workload; 4] = [
    ("readings", Stream::Raw, workload::cubic, workload::everywhere),
    ("wrenches, cubic", Stream::Wrench, workload::cubic, workload::everywhere),
    ("wrenches, physics", Stream::Wrench, workload::physics, workload::poses),
    ("physics, no wrench fits", Stream::Wrench, workload::physics, workload::everywhere),
];

/// Time for the longest command, s: two pages are erased, a slot is written, and the answer is sent.
const ORDER_S: f64 = 0.12;

/// Time for a stream to settle, and time counted, s.
const SETTLE_S: f64 = 0.2;
const COUNTED_S: f64 = 1.0;

pub(crate) fn set_up_model() -> Result<PathBuf> {
    let requirements = workspace().join("firmware/emulation/requirements.txt");
    python::environment("emulation-python", &["--requirement", &requirements.to_string_lossy()])
}

/// Starts the model of a board with its latest image, or says why not.
pub(crate) fn model(board: Board) -> Result<Model> {
    let image = board.image();
    ensure!(image.exists(), "the board's image has not been built");
    let python = set_up_model().context("no Python with `unicorn`")?;
    Ok(Model { board: board.name(), image, python })
}

/// Streams after an upload, at the default settings. Returns the instructions per frame, and the
/// greatest depth of the stack, bytes.
fn stream(
    model: &Model,
    stream: Stream,
    played: &[PlayedFrame],
    calibration: &Calibration,
    rate_hz: f64,
) -> Result<(f64, u32)> {
    let dir = steps::scratch("emulation")?;
    let mut board = FlashedBoard::start(model, played, &dir);
    board.run(ORDER_S);
    for (number, command) in (1..).zip(orders(stream, calibration)) {
        let packet = Packet::Command { number, to: Some(BoardId::from_serial(&SERIAL)), command };
        board.send(&packet.encode());
        board.run(ORDER_S);
    }
    let before = board.run(SETTLE_S);
    let after = board.run(COUNTED_S);
    ensure!(after.resets.is_empty() && !after.sent.is_empty(), "the flashed image does not stream");
    let instructions = (after.instructions - before.instructions) as f64;
    let frames = (after.time_s - before.time_s) * rate_hz;
    Ok((instructions / frames, after.stack))
}

fn orders(stream: Stream, calibration: &Calibration) -> Vec<Order> {
    let bytes = calibration.to_bytes();
    let pieces = bytes.chunks(MAX_PIECE).enumerate().filter_map(|(i, piece)| {
        let data = Piece::copy_of(piece)?;
        Some(Order::CalibrationPiece { offset: (i * MAX_PIECE) as u16, data })
    });
    let begin = Order::BeginCalibration { size: bytes.len() as u32, crc32: crc32(&bytes) };
    let end = [Order::CommitCalibration, Order::SetStream(stream), Order::Start];
    std::iter::once(begin).chain(pieces).chain(end).collect()
}
