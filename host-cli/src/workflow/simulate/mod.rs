//! Studies of the beam channel: sweeps, grids of parameters, uncertain parameters, and measured
//! trials beside the model.
//!
//! The model itself is the crate [`beam_channel`].

mod compare;
mod csv_columns;
mod curve;
mod grid;
mod monte_carlo;
mod parameter;
mod summary;
mod sweep;

pub use compare::{ConditionChannel, MeasuredCondition, read_trials};
pub use csv_columns::TableError;
pub use curve::{Passage, curve, read_trace};
pub use grid::{Cell, GridAxis, grid};
pub use monte_carlo::{DrawStatistics, MonteCarlo, Spread, Uncertain, monte_carlo};
pub use parameter::{Dimension, Parameter};
pub use summary::{ChannelDiagnostic, Summary, summarise};
pub use sweep::{BeamRow, Course, SweepRow, beam_rows};
