//! Partial fits as files: sums over some rows, which merge with the sums over other rows.
//!
//! A partial fit is a JSON document. Merged exact sums give bit for bit the fit over all rows, in
//! any order and grouping. Rows that cannot be summed exactly leave an R factor: merged R factors
//! give that fit except for the last digits, the same ones for the same order.
//!
//! The documents are described in [`document`], a stream of several in [`stream`].

mod document;
mod groups;
mod stream;

pub use self::groups::{PartialGroup, PartialGroups};
pub use self::stream::PartialStream;
use super::{Role, SourceFile};
use calibration::exact::ExactError;
use calibration::model::Model;
pub use calibration::sums::RowSums as Sums;
use calibration::validation::grouped::MAX_GROUPS;
use serde::{Deserialize, Serialize};
use shell_data::ColumnNames;
use shell_data::hint::Hint;
use shell_data::wrench::Axes;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PartialFit {
    pub made_by: String,
    pub date: String,
    pub model: Model,
    pub skipped_rows: u64,
    pub repeated_rows: u64,
    pub sources: Vec<SourceFile>,
    /// The roles of the sources' columns, if the same roles were specified for all sources.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub columns: Option<ColumnNames>,
    #[serde(default = "all_axes", skip_serializing_if = "are_all")]
    pub axes: Axes,
    /// The summed sensors in channel order, then the wrench, by recognised or specified names.
    /// Unknown in documents of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub summed: Option<Vec<String>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor_serial: Option<String>,
    #[serde(flatten)]
    pub sums: Sums,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub groups: Option<PartialGroups>,
}

fn all_axes() -> Axes {
    Axes::ALL
}

fn are_all(axes: &Axes) -> bool {
    axes.are_all()
}

fn expect<T: PartialEq>(
    expected: T,
    found: T,
    error: fn(T, T) -> MergeError,
) -> Result<(), MergeError> {
    match expected == found {
        true => Ok(()),
        false => Err(error(expected, found)),
    }
}

/// Fields hold the expected value, then the one found.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MergeError {
    #[error("it is for `{1}`, expected `{0}`")]
    Model(String, String),
    #[error("it has `{1}` channels, expected `{0}`")]
    Channels(usize, usize),
    #[error("it has the axes {1}, expected {0}")]
    Axes(Axes, Axes),
    #[error("its column {position} is `{found}`, expected `{expected}`")]
    Columns {
        /// The position among sensors and wrench, from 1.
        position: usize,
        expected: String,
        found: String,
    },
    #[error("it is of the sensor `{1}`, expected `{0}`")]
    Serial(String, String),
    #[error("its rows of `{0}` have been counted already")]
    Twice(String),
    #[error("it has {1}, expected {0}: readings or loads of one are no exact sums")]
    Kind(&'static str, &'static str),
    #[error("it keeps {} sums of groups, expected {}", which(*.0), which(!*.0))]
    Groups(bool),
    #[error("its groups are those of `{1}`, expected `{0}`")]
    GroupsAre(&'static str, &'static str),
    #[error("its rows were assigned at random by the seed `{1}`, expected `{0}`")]
    Split(u64, u64),
    #[error("another file with other rows is called `{0}` as well")]
    SameName(String),
    #[error("both have more than `{MAX_GROUPS}` groups together")]
    TooManyGroups,
    #[error(transparent)]
    NotExact(#[from] ExactError),
}

impl Hint for MergeError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::Model { .. } => "make both with the same `--model` and `--no-intercept`",
            Self::Channels { .. } => "name the same sensor columns with `--sensors`",
            Self::Columns { .. } => {
                "make both with the same `--sensors`, `--wrench` and `--moment-unit`; nothing was merged"
            }
            Self::Serial { .. } => "fit each sensor alone",
            Self::Twice(_) => {
                "leave one of them out; `--skip-counted` leaves out partial fits that were delivered twice"
            }
            Self::Kind { .. } => {
                "make all with `fit --partial --solver tsqr`, which keeps R factors of any numbers"
            }
            Self::Groups { .. } => "make all with `--groups`, or all without",
            Self::GroupsAre { .. } => {
                "make all with `--groups=file`, or all with `--groups=column`"
            }
            Self::Split { .. } => {
                "make all by one release: rows are assigned at random otherwise in another"
            }
            Self::SameName(_) => {
                "groups are files: give them different names, such as those of their folders"
            }
            Self::TooManyGroups => "name a column of fewer groups with `--group`",
            _ => return None,
        };
        Some(text.to_owned())
    }
}

impl PartialFit {
    pub fn new(model: Model, sums: Sums) -> Self {
        Self {
            made_by: String::new(),
            date: String::new(),
            model,
            skipped_rows: 0,
            repeated_rows: 0,
            sources: Vec::new(),
            columns: None,
            axes: Axes::ALL,
            summed: None,
            sensor_serial: None,
            sums,
            groups: None,
        }
    }

    /// Adds the rows of `other`.
    ///
    /// # Errors
    /// [`MergeError`] if the two are not parts of one fit; `self` is then unchanged.
    pub fn merge(&mut self, other: &PartialFit) -> Result<(), MergeError> {
        expect(self.model.channels, other.model.channels, MergeError::Channels)?;
        if self.model != other.model {
            return Err(MergeError::Model(self.model.name(), other.model.name()));
        }
        expect(self.axes, other.axes, MergeError::Axes)?;
        self.check_columns(other)?;
        // Two logs may share one wrench file.
        let mut logs = other.sources.iter().filter(|source| source.role != Role::Wrench);
        if let Some(source) = logs.find(|source| self.has_counted(source)) {
            return Err(MergeError::Twice(source.path.display().to_string()));
        }
        expect(self.sums.kind(), other.sums.kind(), MergeError::Kind)?;
        match (&self.groups, &other.groups) {
            (Some(groups), Some(others)) => groups.check(others)?,
            (None, None) => {}
            (_, others) => return Err(MergeError::Groups(others.is_some())),
        }
        // Parts are consistent if the whole is, so nothing fails from here on.
        self.sums.merge(&other.sums)?;
        let own = self.sources.len();
        self.sources.extend(other.sources.iter().cloned());
        if let (Some(groups), Some(others)) = (&mut self.groups, &other.groups) {
            groups.add(others, &self.sources, own)?;
        }
        if self.columns != other.columns {
            self.columns = None;
        }
        // Later merges are compared with a value taken from `other`.
        self.summed = self.summed.take().or_else(|| other.summed.clone());
        self.sensor_serial = self.sensor_serial.take().or_else(|| other.sensor_serial.clone());
        self.skipped_rows += other.skipped_rows;
        self.repeated_rows += other.repeated_rows;
        Ok(())
    }

    /// Checks that both sum the same columns of one sensor, as far as both know.
    fn check_columns(&self, other: &PartialFit) -> Result<(), MergeError> {
        if let (Some(own), Some(others)) = (&self.summed, &other.summed) {
            let mut pairs = own.iter().zip(others).enumerate();
            if let Some((at, (expected, found))) = pairs.find(|(_, (a, b))| a != b) {
                let (expected, found) = (expected.clone(), found.clone());
                return Err(MergeError::Columns { position: at + 1, expected, found });
            }
        }
        match self.sensor_serial.clone().zip(other.sensor_serial.clone()) {
            Some((expected, found)) => expect(expected, found, MergeError::Serial),
            None => Ok(()),
        }
    }

    /// Returns true if the rows of all files of `other` are included here.
    pub fn has_counted_all_of(&self, other: &PartialFit) -> bool {
        !other.sources.is_empty() && other.sources.iter().all(|source| self.has_counted(source))
    }

    /// Compares digests, which identify rows in any file format, and checksums of files.
    fn has_counted(&self, source: &SourceFile) -> bool {
        let is_same = |known: &SourceFile| {
            let is_equal = |a: &Option<String>, b: &Option<String>| a.is_some() && a == b;
            is_equal(&known.digest, &source.digest) || is_equal(&known.checksum, &source.checksum)
        };
        self.sources.iter().any(is_same)
    }
}

fn which(keeps: bool) -> &'static str {
    if keeps { "the" } else { "no" }
}
