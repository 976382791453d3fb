//! What a live view shows, apart from how it is drawn.
//!
//! ```text
//! rows ─▶ LiveModel ─▶ traces, channels, arrows ─▶ a terminal, a browser
//!             ▲
//!       tare, pause, zoom, mark
//! ```
//!
//! [`LiveModel`] keeps the last minute of rows and nothing else, so memory is bounded. What it is told to do
//! (tare, pause, zoom) changes what is shown, never what is recorded.
//!
//! Pure: no ports, no files, no clock but that of the rows.

mod guide;
mod history;
mod model;
#[allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "serves a page")]
pub mod web;

pub use guide::{Guide, GuidePhase, GuideView, GuidedLoad, HOLD_S};
pub use history::{History, LiveRow};
pub use model::{ChannelState, ChannelView, LiveModel, Mark, Picture, TraceView};
