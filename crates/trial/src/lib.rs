//! Trials of a robot in a channel: drag, lift, energies and specific resistance, per trial and per
//! stride, with statistics by condition.
//!
//! ```text
//! TrialRows ──► force pipeline ──► forces ─┐
//!        └──► motor power ─────────────────┼─► evaluate ──► TrialResult ──► statistics
//!        └──► leg angle ──► strides ───────┘
//! ```
//!
//! [`evaluate()`] takes the rows around a trial's window ([`TrialRows`]); [`forces::PipelineSetup::needed_s`] gives
//! their range. `docs/trials.md` has the formulas and definitions.

mod diagnostic;
mod error;
mod evaluate;
mod input;
mod integral;
mod leg;
pub mod manifest;
mod phase;
mod power;
mod profile;
mod results;
mod signals;
mod statistics;
pub mod tables;
mod trace;
mod uncertainty;
mod value_table;
mod window;

pub use diagnostic::{Diagnostic, Severity};
pub use error::TrialError;
pub use evaluate::{check_window, evaluate};
pub use input::{Instrument, LogTimes, TraceExtent, Trial, TrialInput, TrialOptions, TrialRows};
pub use phase::{PhaseForce, PhaseProfile};
pub use profile::{
    Motor, Profile, Robot, TelemetryColumn, TelemetryScales, TrialChannel, VELOCIROACH,
    used_telemetry,
};
pub use results::{ConditionRow, Per, Quantity, RunMeasures, StrideRow, TrialResult, TrialRow};
pub use statistics::{Interval, MeanDifference, Statistics, ValueSample};
pub use trace::Trace;
pub use uncertainty::ForceUncertainty;
pub use value_table::{ValueRow, ValueTable};
pub use window::{GOOD_CONFIDENCE, NoWindow, Proposal, propose_window};
