//! Studies of the beam channel: sweeps and grids of parameters.
//!
//! The model itself is the crate [`beam_channel`].

mod parameter;
mod summary;
mod sweep;

pub use parameter::{Dimension, GridAxis, GridCell, Parameter, grid};
pub use summary::{ChannelDiagnostic, ChannelSummary, summarise};
pub use sweep::{Course, SweepRow};
