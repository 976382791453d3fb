//! Frames for other programs while they arrive.
//!
//! ```text
//! BoardFrame ─ FrameRows ─▶ StreamRow ─ Decimator ─▶ RowEncoder ─▶ Readers (a pipe, a file, UDP, TCP)
//! ```
//!
//! `FrameRows` makes forces by the [pipeline](forces) of all commands, so a row has the bits that a log has;
//! [`Decimator`] lowers the rate without aliasing. [`Readers`] never wait: a reader that is too slow loses rows,
//! every row says how many it has lost, and no other reader notices. [`FrameStream`] joins them, as a
//! [`Watcher`](board_link::Watcher) of a recording.

#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "serves sockets, keeps time"
)]

mod command;
mod decimation;
mod destination;
mod encoding;
mod latency;
mod readers;
mod rows;
mod stream;

pub use command::{StreamCommand, UnknownCommand};
pub use decimation::Decimator;
pub use destination::{BadDestination, Destination};
pub use encoding::{RowEncoder, StreamFormat};
pub use latency::{Latency, LatencySummary};
pub use readers::{ReaderSummary, Readers};
pub use rows::StreamRow;
pub use stream::{FrameStream, StreamHandle, StreamOptions, StreamSummary, StreamWatcher};
