//! What a board sends, as rows of a log: bytes in, CSV lines out.
//!
//! ```text
//! bytes ─ recognition ─▶ protocol ─ Boards ─ Reception ─▶ BoardFrame ─ RowWriter ─▶ CSV lines
//! ```
//!
//! [`Boards`] cuts packets and has a [`Reception`] for every board that is heard.
//! [`Reception`] unwraps sequence and clock, finds restarts of the board and leaves out frames that those
//! around them contradict; `RowWriter` puts the
//! frames of a batch in order, marks gaps and adds forces where there is a calibration. The channels of
//! a frame are brought to one time; nothing else is interpolated: a frame that did
//! not arrive has no row, and the row after it says how many are missing.
//!
//! Readings are in steps of the 12-bit converter, those of the original board as they are, those of
//! the packets over [`shared_proto::COUNTS_PER_LSB`], so a calibration holds for both.
//!
//! No files, ports or clocks here: see [`crate`].

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
