//! Frames for other programs while they arrive.
//!
//! ```text
//! BoardFrame ─ FrameStream ─▶ StreamRow ─ Decimator ─▶ RowEncoder ─▶ Readers (a pipe, a file, UDP, TCP)
//!                                                      └──▶ NetFtBox (records as an ATI box sends them)
//! ```
//!
//! [`FrameStream`] makes forces by the [pipeline](forces) of all commands, so a row has the bits that a log has;
//! [`Decimator`] lowers the rate without aliasing. [`Readers`] never wait: a reader that is too slow loses rows,
//! every row says how many it has lost, and no other reader notices. A [`StreamWatcher`] is a
//! [`Watcher`](board_link::Watcher) of a recording that has a stream.

#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "serves sockets, keeps time"
)]

mod decimation;
mod encoding;
mod latency;
mod netft;
mod readers;
mod stream;

pub use decimation::Decimator;
pub use encoding::{RowEncoder, StreamFormat, StreamRow};
pub use latency::{Latency, LatencySummary};
pub use netft::{NetFtAddress, NetFtPage};
pub use readers::{BadDestination, Destination, ReaderSummary, Readers};
pub use stream::{
    FrameStream, LEAST_RATE_HZ, StreamCommand, StreamHandle, StreamOptions, StreamSummary,
    StreamWatcher, UnknownCommand,
};
