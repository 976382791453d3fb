//! The model of the board's microcontroller: setting it up, and what the flashed image takes on it.
//!
//! The model is a Python program that needs `unicorn`, which is put into an environment of its own
//! below `target`.

use std::path::PathBuf;

use anyhow::{Context, Result, ensure};
use shared_proto::{
    BoardId, Calibration, Command as Order, MAX_PIECE, Packet, Piece, Stream, crc32,
};
use system_tests::flashed::{FlashedBoard, Model, PlayedFrame, SERIAL};

use crate::image::Board;
use crate::python;
use crate::steps::{self, workspace};

/// Time that an order takes at most: two pages erased, a slot written, and the answer.
const ORDER_S: f64 = 0.12;

/// Time until a stream runs as it will, and the time that is counted, in s.
const SETTLE_S: f64 = 0.2;
const COUNTED_S: f64 = 1.0;

/// The Python of the environment, which is made where it is not there.
pub(crate) fn set_up() -> Result<PathBuf> {
    let requirements = workspace().join("firmware/emulation/requirements.txt");
    let requirements = requirements.to_string_lossy();
    python::environment("emulation-python", &["--requirement", &requirements], "import unicorn")
}

/// The model of a board with its image that was built last.
///
/// # Errors
/// Why the model cannot run.
pub(crate) fn find(board: Board) -> Result<Model> {
    let image = board.image();
    ensure!(image.exists(), "the board's image has not been built");
    let python = set_up().context("no Python with `unicorn`")?;
    Ok(Model { board: board.name(), image, python })
}

/// Streams after an upload, at the settings after a reset. Returns the instructions from one frame to the next, and the
/// deepest that the stack has been, in bytes.
pub(crate) fn measure(
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
