//! Where a calibration comes from, and how well it was fitted.

use std::path::{Path, PathBuf};

use calibration::quality::AxisQuality;
use calibration::solver::SolverKind;
use calibration::validation::cross_validation::CrossValidation;
use calibration::validation::excitation::Excitation;
use calibration::validation::selection::Selection;
use serde::{Deserialize, Serialize, Serializer};
use shell_data::ColumnNames;
use shell_data::by_axis;
use shell_data::wrench::PerAxis;

/// Where a calibration comes from.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Origin {
    /// Program and version.
    pub made_by: String,
    /// When, in UTC, RFC 3339.
    pub date: String,
    /// The label of the sensor.
    pub sensor_serial: Option<String>,
    /// The solver; `None` for an imported matrix.
    pub solver: Option<SolverRecord>,
    /// How well the fit went; `None` for an imported matrix.
    pub diagnostics: Option<Diagnostics>,
    /// The files it was made from.
    pub sources: Vec<SourceFile>,
    /// Which of their columns are what, where that was specified.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub columns: Option<ColumnNames>,
}

/// Which solver was used, and how.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SolverRecord {
    /// Its name.
    pub name: SolverKind,
    /// The ridge parameter, 0 for none.
    pub ridge: f64,
    /// Directions are left out whose singular value is below this share of the largest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truncate: Option<f64>,
}

/// How well a fit went.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Diagnostics {
    /// Rows fitted.
    pub rows: u64,
    /// Wrong rows that were left out.
    pub skipped_rows: u64,
    /// Rows whose readings repeat those of the row before.
    pub repeated_rows: u64,
    /// Independent features.
    pub rank: usize,
    /// Condition number of the features, columns scaled to norm one; `None` if infinite.
    pub condition: Option<f64>,
    /// Errors on the training data, per axis.
    #[serde(with = "by_axis")]
    pub train: PerAxis<AxisQuality>,
    /// Errors on the test data, per axis.
    #[serde(with = "by_axis::option")]
    pub test: Option<PerAxis<AxisQuality>>,
    /// Errors on training groups that were held out, if that was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cross_validation: Option<CrossValidation>,
    /// What models were compared, if that was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub selection: Option<Selection>,
    /// How well the training loads cover the six axes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub excitation: Option<Excitation>,
    /// The share of test rows at poses of the training data, where the test says nothing of new poses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test_leak: Option<f64>,
    /// The share of training rows whose pose other groups have rows of, where held-out groups say nothing of new poses.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group_leak: Option<f64>,
}

/// A file that a calibration was made from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SourceFile {
    /// What it was used for.
    pub role: Role,
    /// The file as it was named.
    #[serde(serialize_with = "as_unicode")]
    pub path: PathBuf,
    /// As `log_file::checksum` gives it.
    pub checksum: Option<String>,
    /// What tells its rows from others, as [`Fingerprint`](shell_data::fingerprint::Fingerprint) is written: of the
    /// values that were parsed, whatever the file looks like.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub digest: Option<String>,
    /// Rows used.
    pub rows: u64,
}

/// What a source file was used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Fitted to.
    Train,
    /// Tested on.
    Test,
    /// The wrench of the source before it, row by row.
    Wrench,
    /// A coefficient matrix that was imported.
    Matrix,
    /// The calibration that was brought up to date.
    Calibration,
}

/// Writes names that are not Unicode, which JSON cannot hold, with replacement characters.
pub(crate) fn as_unicode<S: Serializer>(path: &Path, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&path.to_string_lossy())
}
