//! The content of a live view, independent of its rendering.
//!
//! ```text
//! rows ─▶ LiveDisplay ─▶ traces, channels, arrows ─▶ a terminal, a browser
//!             ▲
//!       tare, pause, zoom, mark
//! ```
//!
//! [`LiveDisplay`] keeps the last minute. Its commands change the display, never the recording.
//! The crate is pure: no ports, no files, and no clock except the time of the rows.

mod display;
mod guide;
mod history;
#[allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "serves a page")]
pub mod web;

pub use display::{ChannelState, ChannelView, LiveDisplay, Mark, Picture, TraceView};
pub use guide::{ErrorPoint, Guide, GuidePhase, GuideView, GuidedLoad, LoadGuide, UnloadedValues};
pub use history::{History, LiveRow};
