//! Manifests: which trials there are, in CSV or TOML.
//!
//! ```csv
//! file,condition,t_enter_s,t_exit_s,velocity_m_s,mass_kg,channel_length_m,notes,exclude
//! logs/run1.txt,3 cm,4.2,8.9,,,,,
//! logs/run2.txt,3 cm,auto,auto,,0.091,,new battery,
//! logs/run3.txt,2 cm,3.1,6.0,,,,fell over,yes
//! ```
//!
//! Only the first four columns have to be there. The same in TOML is one `[[trial]]` table for each,
//! with the same keys, and optionally `conditions = ["free", "3 cm"]`, which are then all that there
//! may be.

mod csv;
mod entry;
mod faults;
mod fields;
mod shard;
mod toml;

pub use crate::cell_position::{CellPosition, ManifestProblem};
pub use entry::{Entry, Manifest, Placed};
pub use shard::Shard;

impl Manifest {
    /// Reads a manifest: TOML if `is_toml`, else CSV.
    ///
    /// # Errors
    /// [`ManifestProblem`] if the manifest as a whole makes no sense: no TOML, columns missing or unknown, no
    /// trials. What is wrong with one trial is in its row.
    pub fn parse(text: &str, is_toml: bool) -> Result<Self, ManifestProblem> {
        let manifest = if is_toml { toml::parse(text)? } else { csv::parse(text)? };
        if manifest.rows.is_empty() {
            let message = "the manifest has no trials".to_owned();
            return Err(ManifestProblem::new(CellPosition::START, message));
        }
        Ok(manifest)
    }
}
