//! Studies of the beam channel ([`beam_channel`]): sweeps and grids of parameters.

mod parameter;
mod summary;
mod sweep;

pub use parameter::{Dimension, GridAxis, GridCell, Parameter, grid};
pub use summary::{ChannelDiagnostic, ChannelSummary, summarise};
pub use sweep::{Course, SweepRow};
