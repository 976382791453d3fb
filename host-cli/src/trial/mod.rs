//! Trials: drag, lift, energies and specific resistance of a robot in a channel, per trial and per
//! stride, and their statistics by condition.
//!
//! ```text
//! TareSearch ─► TareFrames ─┐
//! Stretch ──► frames ──► forces ──► low-pass ─┐
//!        └──► motor power ────────────────────┼─► evaluate ──► TrialResult ──► statistics
//!        └──► leg angle ──► strides ──────────┘
//! ```
//!
//! [`evaluate()`] takes the rows around a trial's window ([`Stretch`]) and gives its results;
//! [`warm_up_s`] says how far around. `docs/trials.md` has the formulas and definitions.

mod error;
mod evaluate;
mod forces;
mod grid;
mod integral;
mod leg;
pub mod manifest;
mod observe;
mod options;
mod phase;
mod power;
mod profile;
mod remark;
mod results;
mod statistics;
mod stretch;
mod subject;
pub mod tables;
mod tare;
mod toml_place;
mod uncertainty;
mod value_table;
mod window;

pub use error::TrialError;
pub use evaluate::{check_window, evaluate};
pub use forces::warm_up_s;
pub use options::{LowPass, Rule, TareRule, TraceExtent, TrialOptions};
pub use phase::{PHASES, PhaseForce, PhaseProfile};
pub use profile::{Channel, Motor, Profile, Robot, TelemetryScales, VELOCIROACH};
pub use remark::{Remark, Severity};
pub use results::{ConditionRow, Per, Quantity, StrideRow, Trace, TrialResult, TrialRow};
pub use statistics::{Difference, Interval, RESAMPLES, Sample, Statistics};
pub use stretch::{Clock, Stretch};
pub use subject::Trial;
pub use tare::{TareFrames, TareSearch};
pub use toml_place::TomlError;
pub use value_table::{ValueRow, ValueTable};
pub use window::{GOOD_CONFIDENCE, NoWindow, Proposal, propose_window};
