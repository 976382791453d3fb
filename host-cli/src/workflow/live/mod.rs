//! Rows for a live view, from a port or from a log that is played.
//!
//! ```text
//! port ─ record() ─▶ log, if there is one
//!            └─▶ Feed ─▶ LiveRows ─▶ LiveSession ─▶ whoever shows it
//! log ── play() ──▲
//! ```
//!
//! The thread that records hands frames over and never waits for who shows them: where that is too slow,
//! frames are left out of the view, and counted, never of the log.

mod feed;
mod guide;
mod play;
mod rows;
mod session;

pub use feed::Feed;
pub use guide::guide_through;
pub use play::{PlayError, play};
pub use rows::LiveRows;
pub use session::{LiveAction, LiveSession, LogMaker, LogSeries, PERIOD, Shown, clock};
