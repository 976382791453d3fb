//! The origin of a calibration, and the quality of its fit.

use std::path::{Path, PathBuf};

use calibration::fit::Promise;
use calibration::quality::AxisQuality;
use calibration::solver::SolverKind;
use calibration::validation::cross_validation::CrossValidation;
use calibration::validation::excitation::Excitation;
use calibration::validation::selection::Selection;
use serde::{Deserialize, Serialize, Serializer};
use shell_data::ColumnNames;
use shell_data::by_axis;
use shell_data::wrench::PerAxis;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Origin {
    pub made_by: String,
    /// Date and time, UTC, RFC 3339.
    pub date: String,
    pub sensor_serial: Option<String>,
    pub solver: Option<SolverRecord>,
    /// Quality of the fit; `None` for an imported matrix.
    pub diagnostics: Option<Diagnostics>,
    pub sources: Vec<SourceFile>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub columns: Option<ColumnNames>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SolverRecord {
    pub name: SolverKind,
    pub ridge: f64,
    /// Directions with a singular value below this share of the largest are omitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truncate: Option<f64>,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Diagnostics {
    pub rows: u64,
    pub skipped_rows: u64,
    pub repeated_rows: u64,
    pub rank: usize,
    /// Condition number of the features, with columns scaled to norm one; `None` if infinite.
    pub condition: Option<f64>,
    #[serde(with = "by_axis")]
    pub train: PerAxis<AxisQuality>,
    #[serde(with = "by_axis::option")]
    pub test: Option<PerAxis<AxisQuality>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cross_validation: Option<CrossValidation>,
    /// The factor by which these errors may be larger in a new file, if files were held out.
    #[serde(with = "by_axis::option", default, skip_serializing_if = "Option::is_none")]
    pub spread: Option<PerAxis<f64>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub selection: Option<Selection>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub excitation: Option<Excitation>,
    /// The share of test rows at training poses, if too many to assess new poses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test_leak: Option<f64>,
    /// The share of training rows whose pose also occurs in other groups, if held-out groups then
    /// cannot assess new poses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group_leak: Option<f64>,
    /// The verdict of the fit, if it was not to be used; the text begins with `NOT OK`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub not_ok: Option<String>,
}

impl Diagnostics {
    /// The errors that the fit promises on new rows.
    pub fn promise(&self) -> Promise {
        let held_out = (self.cross_validation.as_ref(), self.spread);
        Promise::new(&self.train, held_out, self.excitation.as_ref())
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SourceFile {
    pub role: Role,
    #[serde(serialize_with = "as_unicode")]
    pub path: PathBuf,
    pub checksum: Option<String>,
    /// Identity of the rows in any format, by
    /// [`Fingerprint`](shell_data::fingerprint::Fingerprint).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<String>,
    pub rows: u64,
}

impl SourceFile {
    /// Returns true if the calibration was fitted to this file, and it has this checksum.
    pub fn is_training_log(&self, checksum: Option<&str>) -> bool {
        self.role == Role::Train && checksum.is_some() && self.checksum.as_deref() == checksum
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    Train,
    Test,
    /// The wrench for the previous source, row by row.
    Wrench,
    Matrix,
    Calibration,
}

/// Serializes a path. Characters that are not Unicode, which JSON cannot hold, are replaced.
pub(crate) fn as_unicode<S: Serializer>(path: &Path, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&path.to_string_lossy())
}
