//! What a manifest says.

use crate::cell_position::CellPosition;

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
    /// Entry into the channel.
    pub enter: Placed<Moment>,
    /// Exit from it.
    pub exit: Placed<Moment>,
    /// Mean velocity, m/s.
    pub velocity_m_s: Option<Placed<f64>>,
    /// Mass, kg.
    pub mass_kg: Option<Placed<f64>>,
    /// Length of the channel, m.
    pub channel_length_m: Option<Placed<f64>>,
    /// Notes.
    pub notes: Option<String>,
    /// Whether it is left out.
    pub exclude: bool,
}

/// When something happens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Moment {
    /// At this time, s on the log's clock.
    At(f64),
    /// To be found in the forces.
    Auto,
}

/// A value and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed<T> {
    /// The value.
    pub value: T,
    /// Where it stands.
    pub position: CellPosition,
}

/// What is wrong at some position of a manifest.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{position}: {message}")]
pub struct ManifestProblem {
    /// Where.
    pub position: CellPosition,
    /// What.
    pub message: String,
}

impl ManifestProblem {
    pub(crate) fn new(position: CellPosition, message: String) -> Self {
        Self { position, message }
    }
}
