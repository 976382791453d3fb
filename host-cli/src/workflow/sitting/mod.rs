//! A calibration in one sitting, without port, files and display.
//!
//! ```text
//! rows ─▶ Guide ─▶ load held ─▶ HeldLoad ─┬─▶ named fault, asked again
//!          ▲                              └─▶ Take ─▶ refit, error on new poses ─▶ next load, or the check
//!          └──────────────────────────── the most informative load ◀───────────────┘
//! ```
//!
//! [`Sitting`] takes rows as they arrive. Its state depends only on the loads recorded so far, so a sitting can be
//! resumed from its log and its table of loads. A log that was recorded before is processed likewise, load by load.

mod estimate;
mod fault;
mod held;
mod recorded;
mod state;

pub use estimate::{Estimate, WrongLoad};
pub use fault::SittingFault;
pub use held::HeldLoad;
pub use recorded::{fit_sitting, held_loads, rest_readings};
pub use state::{CHECK, ErrorLimits, Sitting, SittingStage};
