//! Measured trials and traces beside the model of the beam channel.

mod compare;
mod csv_columns;
mod curve;

pub use compare::{MeasuredCondition, read_trials};
pub use csv_columns::CsvTableError;
pub use curve::{SteadyPassage, curve, read_trace};
