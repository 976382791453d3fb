//! Calibrations as files: a JSON document, and the coefficient matrices that labs exchange.
//!
//! The document holds all that is needed to apply, judge and reproduce a calibration. Numbers have the fewest digits
//! that read back as the same `f64`.
//!
//! | field | content |
//! |---|---|
//! | `schema_version` | [`SCHEMA_VERSION`]; versions 1 (six axes), 2 (physics) and 3 (fewer axes) had no checksum |
//! | `made_by`, `date`, `sensor_serial` | program and version, UTC, the label of the sensor |
//! | `model`, `terms` | features and intercept; the name of each term |
//! | `scaling` | `z = (s − centre) / scale` for each channel, counts |
//! | `axes`, `coefficients` | one row per term of `z`, one column per axis, N and N·m; with fewer than six axes, all per-axis values are for these only |
//! | `solver` | its name and the ridge parameter; absent for an imported matrix |
//! | `diagnostics` | rows, condition number, rank, errors on training and test data; optional: held-out errors, model selection, excitation |
//! | `covariance` | see [`calibration::uncertainty`] |
//! | `valid_range` | the smallest and largest reading of each channel in the training data |
//! | `sources` | files, their checksums and rows |
//! | `columns` | optional: columns of the training logs that were specified, by name, and their units; also used for other logs that have these columns |
//! | `checksum` | last: 128-bit XXH3 of all bytes before it |
//!
//! The document of a physics model replaces terms, scaling, coefficients and covariance by:
//!
//! | field | content |
//! |---|---|
//! | `model` | `physics` |
//! | `physics` | see [`calibration::physics::PhysicsModel`]; parameters in the order of [`calibration::physics::response`]; a sensor without `loadings` has none |
//! | `standard_error_scale` | factor on the model's standard errors for each axis; 1 if absent |
//! | `intervals` | standard errors of an interval by level and axis, see docs/validation.md |

#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "reads files")]

macro_rules! ensure {
    ($holds:expr, $($text:tt)+) => {
        let holds: bool = $holds;
        if !holds {
            return Err(format!($($text)+));
        }
    };
}

mod ati;
mod checksum;
pub mod code;
mod document;
pub mod input;
mod layout;
pub mod matrix;
mod origin;
mod partial;
pub mod payload_file;

use shell_data::hint::Hint;
use std::io;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::IgnoredAny;

use self::matrix::MatrixError;
pub use self::origin::{Diagnostics, Origin, Role, SolverRecord, SourceFile};
pub use self::partial::{MergeError, PartialFit, PartialGroup, PartialGroups, PartialStream, Sums};
pub use calibration::model::LARGEST;
use calibration::plausibility::Implausible;
use calibration::{Calibration, Kind};
use input::DocumentKind;
use shell_data::wrench::{Axis, PerAxis};

/// The version of the documents that this program writes: any model, with a checksum.
pub const SCHEMA_VERSION: u64 = 4;

/// Last version without a checksum: six-axis polynomials.
pub(crate) const SIX_AXES_SCHEMA_VERSION: u64 = 1;

/// Last version without a checksum: physics models.
pub(crate) const PHYSICS_SCHEMA_VERSION: u64 = 2;

/// Last version without a checksum: polynomials with fewer than six axes.
pub(crate) const FEWER_AXES_SCHEMA_VERSION: u64 = 3;

#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationFile {
    pub calibration: Calibration,
    pub origin: Origin,
}

#[derive(Debug, thiserror::Error)]
#[error("`{}`", path.display())]
pub struct CalibrationFileError {
    pub path: PathBuf,
    #[source]
    pub problem: Problem,
}

impl Hint for CalibrationFileError {
    fn hint(&self) -> Option<String> {
        let text = match &self.problem {
            Problem::NotJson(_) => {
                "calibrations and partial fits are JSON files of `shellcal fit` or `shellcal import`"
            }
            Problem::Field(fault) if fault.message.contains("`partial_schema_version`") => {
                "give partial fits, which `shellcal fit --partial` writes"
            }
            Problem::Field(fault) if fault.message.contains("`schema_version`") => {
                "give a calibration; `shellcal merge` makes one of partial fits"
            }
            Problem::SchemaVersion { found } if *found > SCHEMA_VERSION => {
                "use the version of shellcal that wrote it, or a later one"
            }
            Problem::SchemaVersion { .. } => "make it again with `shellcal fit`",
            Problem::Checksum(_) => {
                "copy it again from where it was made; if you have edited it, say so with `--edited`"
            }
            Problem::Unsealed { .. } => {
                "fit it again; if you know that nobody has edited it, say so with `--edited`"
            }
            Problem::Matrix(MatrixError::Variable { .. }) => "choose one with `--variable`",
            _ => return None,
        };
        Some(text.to_owned())
    }
}

#[derive(Debug, thiserror::Error)]
pub enum Problem {
    #[error("cannot read it: {0}")]
    Io(io::Error),
    #[error("line {}, column {}: not valid JSON: {}", .0.line, .0.column, .0.message)]
    NotJson(JsonFault),
    #[error("line {}, column {}: {}", .0.line, .0.column, .0.message)]
    Field(JsonFault),
    #[error("its schema version is `{found}`, this program reads up to `{SCHEMA_VERSION}`")]
    SchemaVersion { found: u64 },
    #[error("{0}")]
    Inconsistent(String),
    #[error("it is not what was written: {0}")]
    Checksum(&'static str),
    /// The version predates checksums, or was edited to claim so.
    #[error("version `{version}` has no checksum, so damage cannot be detected")]
    Unsealed { version: u64 },
    #[error("it cannot be a calibration: {0}")]
    Implausible(Implausible),
    #[error("{0}")]
    Matrix(matrix::MatrixError),
}

#[derive(Debug)]
pub struct JsonFault {
    pub line: usize,
    pub column: usize,
    /// The parser's message; for a field, its name and the expected type.
    pub message: String,
}

impl From<&serde_json::Error> for JsonFault {
    fn from(error: &serde_json::Error) -> Self {
        let text = error.to_string();
        let message = text.split(" at line ").next().unwrap_or(&text).to_owned();
        Self { line: error.line(), column: error.column(), message }
    }
}

impl Problem {
    fn after_lines(mut self, before: usize) -> Self {
        if let Self::NotJson(fault) | Self::Field(fault) = &mut self {
            fault.line += before;
        }
        self
    }
}

impl From<serde_json::Error> for Problem {
    fn from(error: serde_json::Error) -> Self {
        let kind = if error.is_data() { Self::Field } else { Self::NotJson };
        kind(JsonFault::from(&error))
    }
}

#[derive(Deserialize)]
struct DocumentHeader {
    schema_version: u64,
    /// The name of a model, or the features of a polynomial.
    model: Option<serde_json::Value>,
    checksum: Option<IgnoredAny>,
}

impl CalibrationFile {
    /// Verdict of the fit, if the calibration was not to be used.
    pub fn not_ok(&self) -> Option<&str> {
        self.origin.diagnostics.as_ref()?.not_ok.as_deref()
    }

    /// The unexplained share of the loads' variance, 1 − R² per axis, if known, from the training loads or, for a
    /// physics model, from held-out loads.
    pub fn unexplained(&self) -> Option<PerAxis<f64>> {
        let diagnostics = self.origin.diagnostics.as_ref()?;
        let train = diagnostics.train;
        let has = |axis: Axis| train[axis.index()].r_squared.is_some();
        let known = self.calibration.axes.iter().all(has);
        // A physics model has no coefficients from which to estimate the error on new loads.
        let is_physics = self.calibration.polynomial().is_none();
        let held_out = diagnostics.cross_validation.as_ref().filter(|_| is_physics);
        let share = |axis: usize| {
            let of = train[axis];
            let new = held_out.map_or(of.rms, |held_out| held_out.grouped[axis].rms);
            let more = if of.rms > 0.0 { (new / of.rms).powi(2) } else { 1.0 };
            (more * (1.0 - of.r_squared.unwrap_or(0.0))).max(0.0)
        };
        known.then(|| std::array::from_fn(share))
    }

    /// # Errors
    /// [`CalibrationFileError`] if it cannot be read, or as [`Self::parse`].
    pub fn read(path: &Path) -> Result<Self, CalibrationFileError> {
        input::document(path, DocumentKind::Json, Self::parse)
    }

    /// Reads the JSON document at `path` although it was edited.
    ///
    /// # Errors
    /// As for [`Self::read`], except for the checksum.
    pub fn read_edited(path: &Path) -> Result<Self, CalibrationFileError> {
        input::document(path, DocumentKind::Json, Self::parse_edited)
    }

    /// # Errors
    /// [`Problem`] if the version is unknown, the checksum does not match, or the content is implausible.
    pub fn parse(text: &[u8]) -> Result<Self, Problem> {
        let file = Self::parse_edited(text)?;
        let DocumentHeader { schema_version, checksum, .. } = serde_json::from_slice(text)?;
        // Check the checksum last: an error that names a field is more informative.
        if schema_version < SCHEMA_VERSION && checksum.is_none() {
            return Err(Problem::Unsealed { version: schema_version });
        }
        checksum::check(text).map_err(Problem::Checksum)?;
        Ok(file)
    }

    /// Reads a JSON document although it was edited.
    ///
    /// # Errors
    /// As for [`Self::parse`], except for the checksum.
    pub fn parse_edited(text: &[u8]) -> Result<Self, Problem> {
        // Check the version first: any other field may differ between versions.
        let DocumentHeader { schema_version, model, .. } = serde_json::from_slice(text)?;
        let is_physics = model.is_some_and(|model| model.is_string());
        let file = match schema_version {
            SIX_AXES_SCHEMA_VERSION | FEWER_AXES_SCHEMA_VERSION => document::parse(text),
            PHYSICS_SCHEMA_VERSION => document::parse_physics(text),
            SCHEMA_VERSION if is_physics => document::parse_physics(text),
            SCHEMA_VERSION => document::parse(text),
            found => Err(Problem::SchemaVersion { found }),
        }?;
        let largest = file.largest_loads().and_then(|loads| loads.into_iter().reduce(f64::max));
        let check = file.calibration.check_plausible(largest);
        check.map_err(Problem::Implausible)?;
        Ok(file)
    }

    /// The largest absolute training load of each axis, N and N·m, if known.
    pub fn largest_loads(&self) -> Option<PerAxis<f64>> {
        let excitation = self.origin.diagnostics.as_ref()?.excitation.as_ref()?;
        Some(excitation.largest_loads())
    }

    pub fn to_json(&self) -> String {
        checksum::add(&match &self.calibration.kind {
            Kind::Polynomial(polynomial) => document::format(self, polynomial),
            Kind::Physics(physics) => document::format_physics(self, physics),
        })
    }

    /// Imports the coefficient matrix at `path`: CSV, a calibration of ATI, or MATLAB 5, as its beginning shows.
    /// `options` supplies what the file lacks. The origin names the file and is otherwise empty. The flag says
    /// that the file names its units; without them and without `options.moment_unit` moments are taken as mN·m.
    ///
    /// # Errors
    /// [`CalibrationFileError`] if the file cannot be read or is not such a matrix.
    pub fn import(
        path: &Path,
        options: &matrix::ImportOptions,
    ) -> Result<(Self, bool), CalibrationFileError> {
        let parse = |bytes: &[u8]| {
            let read = match ati::is_one(bytes) {
                true => ati::parse(bytes, options)
                    .map(|calibration| (calibration, true))
                    .map_err(MatrixError::Unusable),
                false => matrix::parse(bytes, options),
            };
            read.map_err(Problem::Matrix)
        };
        let (calibration, has_units) = input::document(path, DocumentKind::Matrix, parse)?;
        let rows = calibration.polynomial().map_or(0, |p| p.coefficients.len()) as u64;
        let (role, path) = (Role::Matrix, path.into());
        let source = SourceFile { role, path, checksum: None, digest: None, rows };
        let origin = Origin { sources: vec![source], ..Origin::default() };
        Ok((Self { calibration, origin }, has_units))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_schema_version_is_reported_before_other_faults() {
        let text = b"{\"schema_version\": 5}";
        let found = CalibrationFile::parse(text);
        assert!(matches!(found, Err(Problem::SchemaVersion { found: 5 })), "{found:?}");
    }
}
