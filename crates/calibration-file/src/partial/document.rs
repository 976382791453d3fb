//! The document of a partial fit.
//!
//! | field | content |
//! |---|---|
//! | `partial_schema_version` | `PARTIAL_SCHEMA_VERSION`. Earlier documents have 1, or 2 if they have groups, or 3 if they have triangles; none has `summed` |
//! | `made_by`, `date` | program and version, UTC |
//! | `model` | features and intercept |
//! | `skipped_rows`, `repeated_rows` | invalid rows that were skipped, rows with repeated readings |
//! | `sources` | files, their checksums, digests and numbers of rows |
//! | `columns` | optional: columns that were specified, by name, as in a calibration's document |
//! | `axes` | optional: the axes of the summed wrench, if fewer than six |
//! | `summed` | the columns of the sensors and of the wrench, in order |
//! | `sensor_serial` | optional: the label of the sensor |
//! | `moments` | rows, the range of each channel, and the sums, as decimal integers |
//! | `triangle` | in place of `moments`: rows, centre and scale, the range of each channel, and the columns of the R factor |
//! | `groups` | optional: the sums of each group and of each random fold |
//! | `checksum` | 128-bit XXH3 of all bytes before it |

use std::collections::HashSet;
use std::path::Path;

use super::super::document::read;
use super::super::layout::to_json;
use super::super::{CalibrationFileError, Problem, Role};
use super::{PartialFit, PartialGroup, PartialGroups, Sums};
use crate::checksum;
use crate::input::{self, DocumentKind};
use calibration::model::Model;
use calibration::validation::grouped::{MAX_GROUPS, RandomSplit, SumsByGroup};
use serde::{Deserialize, Serialize};
use shell_data::by_axis::Among;

pub(crate) const PARTIAL_SCHEMA_VERSION: u64 = 4;

#[derive(Serialize)]
struct PartialDocument<'p> {
    partial_schema_version: u64,
    #[serde(flatten)]
    partial: &'p PartialFit,
}

#[derive(Deserialize)]
struct PartialHeader {
    partial_schema_version: u64,
}

impl PartialFit {
    /// # Errors
    /// [`CalibrationFileError`] if it cannot be read, or as [`Self::parse`].
    pub fn read(path: &Path) -> Result<Self, CalibrationFileError> {
        input::document(path, DocumentKind::Json, Self::parse)
    }

    /// Reads the JSON document at `path` although it was edited, or written by a program without checksums.
    ///
    /// # Errors
    /// As for [`Self::read`], except for the checksum.
    pub fn read_edited(path: &Path) -> Result<Self, CalibrationFileError> {
        input::document(path, DocumentKind::Json, Self::parse_edited)
    }

    /// # Errors
    /// [`Problem`] if it is not a partial fit of a known version, or its checksum does not match.
    pub fn parse(text: &[u8]) -> Result<Self, Problem> {
        let partial = Self::parse_edited(text)?;
        // Check the checksum last: an error that names a field is more informative.
        checksum::check(text).map_err(Problem::Checksum)?;
        Ok(partial)
    }

    /// Reads a JSON document and ignores its checksum.
    ///
    /// # Errors
    /// [`Problem`] if it is not a partial fit of a known version.
    pub fn parse_edited(text: &[u8]) -> Result<Self, Problem> {
        let found = serde_json::from_slice::<PartialHeader>(text)?.partial_schema_version;
        if !(1..=PARTIAL_SCHEMA_VERSION).contains(&found) {
            return Err(Problem::SchemaVersion { found });
        }
        let partial: Self = read(text)?;
        partial.check().map_err(Problem::Inconsistent)?;
        Ok(partial)
    }

    pub fn to_json(&self) -> String {
        let version = PARTIAL_SCHEMA_VERSION;
        let document = PartialDocument { partial_schema_version: version, partial: self };
        checksum::add(&to_json(&Among(self.axes, document)))
    }

    fn check(&self) -> Result<(), String> {
        let (model, sums, axes) = (&self.model, &self.sums, self.axes);
        let field = sums.field();
        ensure!(sums.suit(model), "`{field}` are not those of `model`");
        let (columns, found) = (model.channels + axes.count(), self.summed.as_ref().map(Vec::len));
        let found = found.unwrap_or(columns);
        ensure!(found == columns, "`summed` has {found} columns, expected {columns}");
        let logs = self.sources.iter().filter(|source| source.role != Role::Wrench);
        let rows = logs.fold(0, |rows: u64, source| rows.saturating_add(source.rows));
        let summed = sums.rows();
        ensure!(rows == summed, "`sources` have {rows} rows, `{field}` are of {summed}");
        let sources = self.sources.len();
        self.groups.as_ref().map_or(Ok(()), |groups| groups.check_parts(model, sums, sources))
    }
}

impl PartialGroups {
    /// Checks that these are groups of a fit of `model`, with sums that add up to `total`.
    fn check_parts(&self, model: &Model, total: &Sums, sources: usize) -> Result<(), String> {
        let (mut moments_of, mut rows) = (Vec::new(), 0_u64);
        let (mut labels, mut places) = (HashSet::new(), HashSet::new());
        ensure!(self.groups.len() <= MAX_GROUPS, "`groups` has more than {MAX_GROUPS}");
        for PartialGroup { label, source, position, sums } in &self.groups {
            let (suits, field) = (sums.suit(model) && sums.kind() == total.kind(), sums.field());
            ensure!(suits, "group `{label}`: `{field}` are not those of `model`");
            let is_free = places.insert((source, position)) && labels.insert(label);
            ensure!(
                *source < sources && is_free,
                "group `{label}`: its label or place is taken, or it is of no source"
            );
            rows = rows.saturating_add(sums.rows());
            if let Sums::Exact(moments) = sums {
                moments_of.push((label.clone(), moments.clone()));
            }
        }
        let is_whole = match total {
            Sums::Exact(total) => {
                let sums = SumsByGroup::new(moments_of, Vec::new());
                sums.map_err(|error| error.to_string())?.total() == Some(total)
            }
            // The last digits of R factors depend on the order of merging: compare rows only.
            Sums::Factored(total) => rows == total.rows(),
        };
        ensure!(is_whole, "the sums of the groups do not add up to `{}`", total.field());
        let RandomSplit { folds, held_out, .. } = self.split;
        let assigned = match total {
            Sums::Exact(_) => (1..=folds).contains(&held_out),
            Sums::Factored(_) => held_out == 0,
        };
        let found = self.random.len();
        ensure!(
            assigned && found == held_out,
            "`random` has {found} sums, for {held_out} folds of {folds} that are held out"
        );
        for moments in &self.random {
            let is_part = matches!(total, Sums::Exact(total) if moments.can_be_part_of(total));
            let suits = (moments.channels(), moments.basis()) == (model.channels, model.basis);
            ensure!(suits && is_part, "`random` are not sums of some of the rows");
        }
        Ok(())
    }
}
