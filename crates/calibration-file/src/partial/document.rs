//! The document of a partial fit.
//!
//! | field | content |
//! |---|---|
//! | `partial_schema_version` | `PARTIAL_SCHEMA_VERSION`; earlier ones had 1, with groups 2, triangles 3, and did not say what was summed |
//! | `made_by`, `date` | program and version, UTC |
//! | `model` | features and intercept |
//! | `skipped_rows`, `repeated_rows` | wrong rows left out, rows that repeat their readings |
//! | `sources` | files, their checksums, digests of their rows and how many |
//! | `columns` | optional: their columns that were specified, by name, as in a calibration's document |
//! | `axes` | optional: the axes of the wrench that there are sums of, where these are not all six |
//! | `summed` | the columns of the sensors and of the wrench, in order |
//! | `sensor_serial` | optional: the label of the sensor |
//! | `moments` | rows, the range of each channel, and the sums, as decimal integers |
//! | `triangle` | in place of `moments`: rows, centre and scale, the range of each channel, and the columns of the R factor |
//! | `groups` | optional: the same for each group and for rows that were assigned at random |
//! | `checksum` | XXH3 of 128 bits of all bytes before it |

use std::collections::HashSet;
use std::path::Path;

use super::super::document::{column_names, read};
use super::super::layout::to_json;
use super::super::r_factor::RFactorDocument;
use super::super::{CalibrationFileError, Problem, Role, SourceFile};
use super::{PartialFit, PartialGroup, PartialGroups, Sums};
use crate::{checksum, input};
use calibration::exact::{Moments, StoredMoments};
use calibration::model::Model;
use calibration::validation::grouped::{GroupKind, GroupedMoments, MAX_GROUPS, RandomSplit};
use serde::{Deserialize, Serialize};
use shell_data::ColumnNames;
use shell_data::by_axis::Among;
use shell_data::wrench::Axes;

/// The version of the documents that this program writes.
pub(crate) const PARTIAL_SCHEMA_VERSION: u64 = 4;

#[derive(Serialize, Deserialize)]
struct PartialDocument {
    partial_schema_version: u64,
    made_by: String,
    date: String,
    model: Model,
    skipped_rows: u64,
    repeated_rows: u64,
    sources: Vec<SourceFile>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    columns: Option<ColumnNames>,
    /// Absent where there are all six.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    axes: Option<Vec<String>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    summed: Option<Vec<String>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sensor_serial: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    moments: Option<StoredMoments>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    triangle: Option<RFactorDocument>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    groups: Option<GroupsDocument>,
}

#[derive(Serialize, Deserialize)]
struct GroupsDocument {
    by: GroupKind,
    random_folds: usize,
    held_out_folds: usize,
    seed: u64,
    random: Vec<StoredMoments>,
    sums: Vec<GroupDocument>,
}

#[derive(Serialize, Deserialize)]
struct GroupDocument {
    label: String,
    source: usize,
    place: usize,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    moments: Option<StoredMoments>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    triangle: Option<RFactorDocument>,
}

/// What is read before all else.
#[derive(Deserialize)]
struct PartialHeader {
    partial_schema_version: u64,
}

impl PartialFit {
    /// Reads the JSON document at `path`.
    ///
    /// # Errors
    /// [`CalibrationFileError`] if it cannot be read, or as [`Self::parse`].
    pub fn read(path: &Path) -> Result<Self, CalibrationFileError> {
        input::document(path, Self::parse)
    }

    /// Reads the JSON document at `path`, which somebody has edited, or a program that wrote no checksums has written.
    ///
    /// # Errors
    /// Those of [`Self::read`] but for the checksum.
    pub fn read_edited(path: &Path) -> Result<Self, CalibrationFileError> {
        input::document(path, Self::parse_edited)
    }

    /// Reads a JSON document.
    ///
    /// # Errors
    /// [`Problem`] if it is no partial fit of a known version, or not what was written.
    pub fn parse(text: &[u8]) -> Result<Self, Problem> {
        let partial = Self::parse_edited(text)?;
        // Last: what can be named says more.
        checksum::check(text)?;
        Ok(partial)
    }

    /// Reads a JSON document whatever its checksum is.
    ///
    /// # Errors
    /// [`Problem`] if it is no partial fit of a known version.
    pub fn parse_edited(text: &[u8]) -> Result<Self, Problem> {
        let found = serde_json::from_slice::<PartialHeader>(text)?.partial_schema_version;
        if !(1..=PARTIAL_SCHEMA_VERSION).contains(&found) {
            return Err(Problem::SchemaVersion { found });
        }
        let (axes, document): (_, PartialDocument) = read(text)?;
        document.value(axes).map_err(Problem::Inconsistent)
    }

    /// The JSON document.
    pub fn to_json(&self) -> String {
        let (moments, triangle) = stored_sums(&self.sums, self.axes);
        let document = PartialDocument {
            partial_schema_version: PARTIAL_SCHEMA_VERSION,
            made_by: self.made_by.clone(),
            date: self.date.clone(),
            model: self.model,
            skipped_rows: self.skipped_rows,
            repeated_rows: self.repeated_rows,
            sources: self.sources.clone(),
            columns: self.columns.clone(),
            axes: (!self.axes.are_all()).then(|| column_names(self.axes)),
            summed: self.summed.clone(),
            sensor_serial: self.sensor_serial.clone(),
            moments,
            triangle,
            groups: self.groups.as_ref().map(|groups| GroupsDocument::new(groups, self.axes)),
        };
        checksum::add(&to_json(&Among(self.axes, document)))
    }
}

impl PartialDocument {
    /// # Errors
    /// What does not fit together.
    fn value(self, axes: Axes) -> Result<PartialFit, String> {
        let (model, sums) = (self.model, sums(self.moments, self.triangle, axes)?);
        let field = field(&sums);
        ensure!(suits(&sums, &model), "`{field}` are not those of `model`");
        let (columns, found) = (model.channels + axes.count(), self.summed.as_ref().map(Vec::len));
        let found = found.unwrap_or(columns);
        ensure!(found == columns, "`summed` has {found} columns, expected {columns}");
        let logs = self.sources.iter().filter(|source| source.role != Role::Wrench);
        let rows = logs.fold(0, |rows: u64, source| rows.saturating_add(source.rows));
        let summed = sums.rows();
        ensure!(rows == summed, "`sources` have {rows} rows, `{field}` are of {summed}");
        let sources = self.sources.len();
        let groups =
            self.groups.map(|groups| groups.value(&model, &sums, sources, axes)).transpose()?;
        Ok(PartialFit {
            made_by: self.made_by,
            date: self.date,
            model,
            skipped_rows: self.skipped_rows,
            repeated_rows: self.repeated_rows,
            sources: self.sources,
            axes,
            summed: self.summed,
            sensor_serial: self.sensor_serial,
            columns: self.columns,
            sums,
            groups,
        })
    }
}

impl GroupsDocument {
    fn new(groups: &PartialGroups, axes: Axes) -> Self {
        let RandomSplit { folds, held_out, seed } = groups.split;
        let group = |group: &PartialGroup| {
            let (moments, triangle) = stored_sums(&group.sums, axes);
            let (label, source, place) = (group.label.clone(), group.source, group.position);
            GroupDocument { label, source, place, moments, triangle }
        };
        Self {
            by: groups.by,
            random_folds: folds,
            held_out_folds: held_out,
            seed,
            random: groups.random.iter().map(|sums| StoredMoments::of(sums, axes)).collect(),
            sums: groups.groups.iter().map(group).collect(),
        }
    }

    /// The groups of a partial fit of `model` whose sums over all rows are `total`.
    fn value(
        self,
        model: &Model,
        total: &Sums,
        sources: usize,
        axes: Axes,
    ) -> Result<PartialGroups, String> {
        let Self { random_folds: folds, held_out_folds: held_out, seed, .. } = self;
        let (mut moments_of, mut groups, mut rows) = (Vec::new(), Vec::new(), 0_u64);
        let (mut labels, mut places) = (HashSet::new(), HashSet::new());
        ensure!(self.sums.len() <= MAX_GROUPS, "`groups` has more than {MAX_GROUPS}");
        for GroupDocument { label, source, place, moments, triangle } in self.sums {
            let sums = sums(moments, triangle, axes);
            let sums = sums.map_err(|error| format!("group `{label}`: {error}"))?;
            let (suits, field) = (suits(&sums, model) && sums.kind() == total.kind(), field(&sums));
            ensure!(suits, "group `{label}`: `{field}` are not those of `model`");
            let is_free = places.insert((source, place)) && labels.insert(label.clone());
            ensure!(
                source < sources && is_free,
                "group `{label}`: its label or place is taken, or it is of no source"
            );
            rows = rows.saturating_add(sums.rows());
            if let Sums::Exact(moments) = &sums {
                moments_of.push((label.clone(), moments.clone()));
            }
            groups.push(PartialGroup { label, source, position: place, sums });
        }
        let is_whole = match total {
            Sums::Exact(total) => {
                let sums = GroupedMoments::new(moments_of, Vec::new());
                sums.map_err(|error| error.to_string())?.total() == Some(total)
            }
            // Their last digits depend on the order in which they were merged.
            Sums::Factored(total) => rows == total.rows(),
        };
        ensure!(is_whole, "the sums of the groups do not add up to `{}`", field(total));
        let assigned = match total {
            Sums::Exact(_) => (1..=folds).contains(&held_out),
            Sums::Factored(_) => held_out == 0,
        };
        let found = self.random.len();
        ensure!(
            assigned && found == held_out,
            "`random` has {found} sums, for {held_out} folds of {folds} that are held out"
        );
        let mut random = Vec::new();
        for moments in self.random {
            let moments = read_moments(moments, axes)?;
            let is_part = matches!(total, Sums::Exact(total) if moments.can_be_part_of(total));
            let suits = (moments.channels(), moments.basis()) == (model.channels, model.basis);
            ensure!(suits && is_part, "`random` are not sums of some of the rows");
            random.push(moments);
        }
        let split = RandomSplit { folds, held_out, seed };
        Ok(PartialGroups { by: self.by, split, groups, random })
    }
}

fn suits(sums: &Sums, model: &Model) -> bool {
    (sums.channels(), sums.basis()) == (model.channels, model.basis)
}

/// The field that has them.
fn field(sums: &Sums) -> &'static str {
    match sums {
        Sums::Exact(_) => "moments",
        Sums::Factored(_) => "triangle",
    }
}

/// The stored moments, or the stored R factor.
fn stored_sums(sums: &Sums, axes: Axes) -> (Option<StoredMoments>, Option<RFactorDocument>) {
    match sums {
        Sums::Exact(moments) => (Some(StoredMoments::of(moments, axes)), None),
        Sums::Factored(rows) => (None, Some(RFactorDocument::new(rows))),
    }
}

/// # Errors
/// What does not fit together.
fn read_moments(stored: StoredMoments, axes: Axes) -> Result<Moments, String> {
    Moments::from_stored(stored, axes).map_err(|error| format!("`moments`: {error}"))
}

/// What one of the two fields has.
fn sums(
    moments: Option<StoredMoments>,
    triangle: Option<RFactorDocument>,
    axes: Axes,
) -> Result<Sums, String> {
    match (moments, triangle) {
        (Some(moments), None) => Ok(Sums::Exact(read_moments(moments, axes)?)),
        (None, Some(triangle)) => {
            let rows = triangle.value().map_err(|error| format!("`triangle`: {error}"))?;
            Ok(Sums::Factored(rows))
        }
        (None, None) => Err("missing field `moments` or `triangle`".to_owned()),
        (Some(_), Some(_)) => Err("it has both `moments` and `triangle`".to_owned()),
    }
}
