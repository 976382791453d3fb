//! Studies of the beam channel: sweeps, grids of parameters, uncertain parameters.
//!
//! The model itself is the crate [`beam_channel`].

mod monte_carlo;
mod parameter;
mod summary;
mod sweep;

pub use monte_carlo::{DrawStatistics, MonteCarlo, ParameterSpread, Uncertain, monte_carlo};
pub use parameter::{Dimension, GridAxis, GridCell, Parameter, grid};
pub use summary::{ChannelDiagnostic, ChannelSummary, summarise};
pub use sweep::{BeamRow, Course, SweepRow, beam_rows};
