//! The wire protocol between the SkinProc board and `shellcal`, used by both ends.
//!
//! A [`Packet`] travels as a [`Frame`]: COBS with a zero delimiter. Over a transparent XBee the frames are the byte
//! stream; in API mode they are the data of [`xbee`] frames. A [`Decoder`] turns bytes back into packets and counts
//! damage. The README has the layout byte by byte; `tests/it/golden.rs` pins it.
//!
//! ```
//! use shared_proto::{Decoder, Event, Framing, PacketOrigin, Packet, ReceivedPacket, Sample, Values};
//!
//! let sample = Sample {
//!     sequence: 7,
//!     clock_us: 70_000,
//!     values: Values::Readings([31_376; 8]),
//!     saturated: 0,
//!     dropped: 0,
//! };
//! let origin = PacketOrigin { board: 0x2052, start: 1 };
//! let frame = Packet::Sample(sample).encode_from(origin);
//!
//! let mut decoder = Decoder::new(Framing::Cobs);
//! let mut packets = Vec::new();
//! for piece in frame.chunks(3) {
//!     decoder.feed(piece, |event| packets.push(event));
//! }
//! let received = ReceivedPacket { origin: Some(origin), packet: Packet::Sample(sample) };
//! assert_eq!(packets, [Event::Packet(received)]);
//! ```
//!
//! The crate does no input or output, allocates nothing and never panics on its input. [`skinproc`] has the byte
//! protocol of the original SkinProc board.
#![no_std]
#![forbid(unsafe_code)]
#![warn(missing_docs)]

mod board;
mod calibration;
mod command;
mod decoder;
mod field;
mod frame;
mod packet;
pub mod skinproc;
pub mod xbee;

pub use board::{Board, BoardId, Identity, ResetCause, Status, Stream};
pub use calibration::{
    Calibration, CalibrationBytes, Cubic, FACTOR, FEATURES, PRIOR, Physics, PhysicsSensor, crc32,
};
pub use command::{Answer, Command, MAX_PIECE, Piece, Refusal};
pub use decoder::{Counters, Decoder, Event, Framing, Protocol, detect};
pub use field::Bytes;
pub use frame::{DecodeError, Frame, MAX_FRAME, MAX_PACKET};
pub use packet::{
    Boot, COUNTS_PER_LSB, Edge, Health, Packet, PacketOrigin, READINGS_FRAME, ReceivedPacket,
    Sample, Timing, VERSION, Values, Vitals, WRENCH_FRAME,
};

/// Number of photointerrupters on the board.
pub const CHANNELS: usize = 8;

/// Axes of a wrench: Fx, Fy, Fz in N, then Mx, My, Mz in N·m.
pub const AXES: usize = 6;
