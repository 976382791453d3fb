//! Common parts of requests: files, and assignments of their columns.

use std::error::Error;
use std::path::Path;
use std::sync::Arc;

use log_file::{ColumnRef, Log, LogError, Mapping, MomentUnit};
use serde::Deserialize;
use shell_data::ColumnNames;
use shell_data::wrench::PerAxis;

use crate::Failure;

#[derive(Deserialize)]
pub(crate) struct FileRef {
    pub(crate) name: String,
    /// Its position among the files of the request, from 0.
    file: usize,
}

impl FileRef {
    pub(crate) fn bytes(&self, files: &[Arc<[u8]>]) -> Result<Arc<[u8]>, Failure> {
        let missing = || format!("`{}` did not come with the request", self.name);
        files.get(self.file).cloned().ok_or_else(|| missing().into())
    }

    /// Parses the file with `parse`; an error contains the file's name.
    pub(crate) fn parsed<T, E: Error>(
        &self,
        files: &[Arc<[u8]>],
        parse: impl Fn(&[u8]) -> Result<T, E>,
    ) -> Result<T, Failure> {
        let told = |problem| Failure::new(&problem, None).about(&format!("`{}`", self.name));
        parse(&self.bytes(files)?).map_err(told)
    }

    pub(crate) fn log(
        &self,
        files: &[Arc<[u8]>],
        mapping: &Mapping,
    ) -> Result<Result<Log, LogError>, Failure> {
        Ok(Log::in_memory(Path::new(&self.name), self.bytes(files)?, mapping))
    }
}

/// The user's assignments of columns, by position from 1. Columns that are `None` are detected.
#[derive(Default, Deserialize)]
#[serde(default)]
pub(crate) struct ColumnsGiven {
    sensors: Option<Vec<usize>>,
    /// In the order Fx … Mz; `None` for missing axes.
    wrench: Option<PerAxis<Option<usize>>>,
    time: Option<usize>,
    group: Option<usize>,
    moments_in_mnm: Option<bool>,
}

impl ColumnsGiven {
    pub(crate) fn mapping(&self, usual: Option<ColumnNames>) -> Mapping {
        let position = ColumnRef::Position;
        let unit = |is_milli| match is_milli {
            true => MomentUnit::MillinewtonMetre,
            false => MomentUnit::NewtonMetre,
        };
        Mapping {
            sensors: self.sensors.as_ref().map(|all| all.iter().copied().map(position).collect()),
            wrench: self.wrench.map(|axes| axes.map(|column| column.map(position))),
            time: self.time.map(position),
            group: self.group.map(position),
            moment_unit: self.moments_in_mnm.map(unit),
            usual,
            ..Mapping::default()
        }
    }
}
