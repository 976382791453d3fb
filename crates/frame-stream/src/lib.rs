//! Streams of frames to other programs in real time.
//!
//! ```text
//! BoardFrame ─ FrameStream ─▶ StreamRow ─ Decimator ─▶ RowEncoder ─▶ Readers (a pipe, a file, UDP, TCP)
//!                                                      └──▶ NetFtBox (records in the format of an ATI box)
//! ```
//!
//! [`FrameStream`] computes forces with the common [pipeline](forces), so a row has the same bits
//! as in a log; [`Decimator`] reduces the rate without aliasing. [`Readers`] never block: a slow
//! reader loses rows, which every row counts, and others are not affected. A [`StreamWatcher`] is a
//! [`Watcher`](board_link::Watcher) that streams a running recording.

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
mod summary;

pub use decimation::Decimator;
pub use encoding::{RowEncoder, StreamFormat, StreamRow};
pub use latency::{Latency, LatencySummary};
pub use netft::{NetFtAddress, NetFtPage};
pub use readers::{BadDestination, Destination, Readers};
pub use stream::{
    FrameStream, LEAST_RATE_HZ, StreamCommand, StreamHandle, StreamOptions, StreamSummary,
    StreamWatcher, UnknownCommand,
};
pub use summary::ReaderSummary;
