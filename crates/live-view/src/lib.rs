//! The content of a live view, independent of its rendering.
//!
//! ```text
//! rows ─▶ LiveModel ─▶ traces, channels, arrows ─▶ a terminal, a browser
//!             ▲
//!       tare, pause, zoom, mark
//! ```
//!
//! [`LiveModel`] keeps the last minute. Its commands change the display, never the recording.
//! The crate is pure: no ports, no files, and no clock except the time of the rows.

mod guide;
mod history;
mod model;
#[allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "serves a page")]
pub mod web;

pub use guide::{ErrorPoint, Guide, GuidePhase, GuideView, GuidedLoad, LoadGuide, UnloadedValues};
pub use history::{History, LiveRow};
pub use model::{ChannelState, ChannelView, LiveModel, Mark, Picture, TraceView};
