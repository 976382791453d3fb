//! From readings to forces: the one pipeline of every command that shows forces.
//!
//! ```text
//!                     first rows of the log ─▶ PipelineSetup ─▶ tare, clock
//!                                                                  │
//! readings ─▶ wrench = W(readings) ─▶ − tare ─▶ low-pass (on an even grid of time) ─▶ window
//! ```
//!
//! The forces of a log, calibration and [`ForceOptions`] have the same bits in every use: whole, in blocks, around a
//! window, or during recording.
//!
//! **Tare.** The mean wrench of the first 50 *fresh* frames, or of those between two times, without
//! repeated rows of telemetry. A tare can also follow the [stationary intervals](stationary):
//! interpolated linearly between them, or, during recording, held from the last.
//!
//! **Clock.** The grid of the low-pass has the median period of the first `CLOCK_ROWS` rows. Each
//! frame is assigned to the slot nearest to its time, and a slot without a frame holds the previous
//! one: repeated rows change nothing, and missing or uneven rows leave the cutoff in Hz true. (The
//! rate of fresh frames alone would fail on a still sensor, which repeats its readings.)
//!
//! **Low-pass.** A 4th-order Butterworth filter at 10 Hz: forward and backward (zero-phase) for a
//! complete log, forward only (causal) during recording. It runs over blocks of the grid at fixed
//! positions, each with the filter's memory before it and (zero-phase) after it. A window can
//! therefore be processed alone; rows further away would change a force by less than 10⁻¹² of the
//! signal's range. A gap longer than the filter's memory separates its sides.
//!
//! **Lag.** A reference that lagged behind the readings shows each load at a later time of its clock. Forces are given
//! on the reference's clock: their time stamps are shifted, or the rows keep their stamps and forces are interpolated.
//!
//! The crate neither reads files nor prints. `docs/forces.md` describes the pipeline for users.

mod clock;
pub mod drift;
pub mod filter;
mod frame;
mod lag;
mod options;
pub mod payload;
mod pipeline;
pub mod sampling;
mod signal;
pub mod stationary;
mod tare;

pub use clock::{Clock, ClockSearch, Grid};
pub use frame::{FrameChange, NoFrameChange};
pub use options::{DEFAULT_TARE_FRAMES, ForceOptions, LowPass, RowRule, TareRule};
pub use pipeline::{AppliedLowPass, ForceError, ForcePipeline, ForceStream, PipelineSetup};
pub use tare::{FirstRows, RunningTare, TareFrames, TareResult, by_column};
