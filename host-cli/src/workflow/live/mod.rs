//! Rows for a live view, from a port or from playback of a log.
//!
//! ```text
//! port ─ record() ─▶ log, if there is one
//!            └─▶ Feed ─▶ LiveSession ─▶ screen or web page
//! log ── play() ──▲
//! ```
//!
//! The recording thread hands frames over and never waits for the display. If the display is too slow, frames
//! are left out of the view, and counted, but never left out of the log.

mod feed;
mod play;
mod session;

pub use feed::Feed;
pub use play::play;
pub(super) use play::saturated;
pub use session::{LiveAction, LiveSession, LogMaker, LogSeries, PERIOD, clock, guide_through};
