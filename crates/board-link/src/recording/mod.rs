//! Conversion of a board's data to rows of a log: bytes in, CSV lines out.
//!
//! ```text
//! bytes ─ recognition ─▶ protocol ─ Boards ─ Reception ─▶ BoardFrame ─ RowWriter ─▶ CSV lines
//! ```
//!
//! [`Boards`] splits the bytes into packets, with a [`Reception`] for every board, which unwraps
//! sequence numbers and clocks, finds restarts and removes frames that contradict their neighbours.
//! `RowWriter` sorts the frames of a batch, marks gaps and adds forces. The channels of a frame are
//! interpolated to a common time; a missing frame has no row, and the next row counts it.
//!
//! Readings are in 12-bit steps for every board (packets are divided by
//! [`shared_proto::COUNTS_PER_LSB`]), so that a calibration suits all. This module uses no files,
//! ports or clocks: see [`crate`].

mod arrival_clock;
mod boards;
mod forces;
mod reception;
mod recognition;
mod reference;
mod rows;
mod sequence;
mod simultaneous;
mod timeline;

pub use arrival_clock::ArrivalClock;
pub(crate) use boards::PacketWire;
pub use boards::{BoardSource, Boards, HeardBoard};
pub use forces::{Force, LiveForces, RunningForces, UnsuitableCalibration};
pub use reception::{BoardFrame, Losses, Measured, Reception};
pub(crate) use recognition::other_version;
pub use recognition::{NoFrame, PROTOCOLS, Recognition, protocol_name};
pub(crate) use reference::ReferenceBeside;
pub use reference::{
    RecordedReference, ReferenceCounts, ReferenceInput, ReferenceSample, ReferenceState,
};
pub(crate) use rows::{Annotations, RowWriter};
pub use rows::{row_flags, write_time};
pub use sequence::BoardEdge;
pub use simultaneous::Simultaneous;
