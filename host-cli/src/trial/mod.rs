//! Trials: drag, lift, energies and specific resistance of a robot in a channel, per trial and per
//! stride, and their statistics by condition.

mod phase;
mod profile;
mod remark;
mod results;
mod statistics;
mod toml_place;
mod window;

pub use phase::{PHASES, PhaseForce, PhaseProfile};
pub use profile::{Channel, Motor, Profile, Robot, TelemetryScales, VELOCIROACH};
pub use remark::{Remark, Severity};
pub use results::{ConditionRow, Per, Quantity, StrideRow, Trace, TrialResult, TrialRow};
pub use statistics::{Difference, Interval, RESAMPLES, Sample, Statistics};
pub use toml_place::TomlError;
pub use window::{GOOD_CONFIDENCE, NoWindow, Proposal, propose_window};
