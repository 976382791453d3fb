//! From readings to forces: the one pipeline of every command that shows forces.
//!
//! ```text
//!                     first rows of the log ─▶ PipelineSetup ─▶ tare, clock
//!                                                                  │
//! readings ─▶ wrench = W(readings) ─▶ − tare ─▶ low-pass (on an even grid of time) ─▶ window
//! ```
//!
//! The same log, calibration and [`ForceOptions`] give the same bits wherever they are applied: to the
//! whole log at once, in blocks, to the rows around a window, or while the log is recorded.
//!
//! **Tare.** The mean wrench of the first 50 *fresh* frames, or of the fresh frames between two times.
//! A row that repeats the frame before, as telemetry does until the sensor gives the next, is not a
//! frame: it counts neither in the tare nor in its mean, whichever rows are written later. A tare can also
//! follow the [stationary intervals](stationary): straight from one to the next, or, while recording, that of the last.
//!
//! **Clock.** The grid of the low-pass has the usual period between rows, the median of the first
//! `CLOCK_ROWS` rows. Each frame stands in the slot nearest to its own time, and a slot without a
//! frame holds the frame before. Repeated rows therefore change nothing, missing and uneven rows keep
//! the cutoff in Hz true, and rows outnumber frames, so that no two frames share a slot.
//! (The rate of fresh frames alone would fail on a sensor at rest, which repeats its readings.)
//!
//! **Low-pass.** A 4th-order Butterworth filter at 10 Hz: forward and backward (zero-phase) where the
//! whole log is there, forward only (causal) while it is being recorded. It runs over blocks of the
//! grid at fixed positions, each with the filter's memory before it and (zero-phase) after it. A force
//! therefore depends on the rows around it alone, which a window needs, and memory is bounded; what is
//! further away would change it by less than 10⁻¹² of the signal's range. Where no row comes for
//! longer than the filter remembers, the recording is taken to have paused: each side is filtered
//! on its own.
//!
//! **Lag.** A reference that lagged behind the readings shows a load later by its clock. Forces are those of
//! that clock, so that they can be compared with it: their time stamps move by the lag, or, where a row has to keep its
//! stamp, forces are taken straight between rows.
//!
//! Pure: no files, no printing. `docs/forces.md` says the same to users.

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
