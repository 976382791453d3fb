//! Rows for a live view, from a port or from a log that is played.
//!
//! ```text
//! port ─ record() ─▶ log, if there is one
//!            └─▶ Feed ─▶ LiveSession ─▶ whoever shows it
//! log ── play() ──▲
//! ```
//!
//! The thread that records hands frames over and never waits for who shows them: where that is too slow,
//! frames are left out of the view, and counted, never of the log.

mod feed;
mod play;
mod session;

pub use feed::Feed;
pub use play::play;
pub use session::{LiveAction, LiveSession, LogMaker, LogSeries, PERIOD, clock, guide_through};
