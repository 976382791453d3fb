//! What a manifest says.

use crate::cell_position::{CellPosition, ManifestProblem};

/// A manifest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Manifest {
    /// Its rows in order: trials, or what is wrong with them.
    pub rows: Vec<Result<Entry, ManifestProblem>>,
    /// All the conditions that there may be, if it says.
    pub conditions: Option<Vec<String>>,
}

/// A trial as the manifest has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Where it starts.
    pub position: CellPosition,
    /// The log, relative to the manifest's folder.
    pub file: Placed<String>,
    /// The condition.
    pub condition: Placed<String>,
    /// Entry into the channel, s on the log's clock; `None` if it is to be found in the forces.
    pub enter: Placed<Option<f64>>,
    /// Exit from it, likewise.
    pub exit: Placed<Option<f64>>,
    /// Mean velocity, m/s.
    pub velocity_m_s: Option<f64>,
    /// Mass, kg.
    pub mass_kg: Option<f64>,
    /// Length of the channel, m.
    pub channel_length_m: Option<f64>,
    /// Notes.
    pub notes: Option<String>,
    /// Whether it is left out.
    pub exclude: bool,
}

/// A value and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed<T> {
    /// The value.
    pub value: T,
    /// Where it stands.
    pub position: CellPosition,
}
