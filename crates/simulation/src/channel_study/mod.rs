//! Studies of the beam channel: sweeps, grids of parameters, uncertain parameters.
//!
//! The model itself is the crate [`beam_channel`].

mod grid;
mod monte_carlo;
mod parameter;
mod summary;
mod sweep;

pub use grid::{GridAxis, GridCell, grid};
pub use monte_carlo::{DrawStatistics, MonteCarlo, ParameterSpread, Uncertain, monte_carlo};
pub use parameter::{Dimension, Parameter};
pub use summary::{ChannelDiagnostic, ChannelSummary, summarise};
pub use sweep::{BeamRow, Course, SweepRow, beam_rows};
