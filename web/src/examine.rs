//! Detection of a file's kind, its columns, and its faults.

use std::sync::Arc;

use calibration_file::CalibrationFile;
use doctor::examine_log;
use load_table::HungLoads;
use log_file::{Column, Log, ReadOptions};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::request::{ColumnsGiven, FileRef};
use crate::{Answer, Failure};

#[derive(Deserialize)]
pub(crate) struct Examine {
    log: FileRef,
    #[serde(default)]
    columns: ColumnsGiven,
}

impl Examine {
    pub(crate) fn run(
        &self,
        files: &[Arc<[u8]>],
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<Answer, Failure> {
        let bytes = self.log.bytes(files)?;
        let text = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&bytes);
        if text.trim_ascii_start().starts_with(b"{") {
            return calibration(text);
        }
        let log = self.log.log(files, &self.columns.mapping(None))?;
        let has_readings = log.as_ref().is_ok_and(|log| log.channels() > 0);
        if let (false, Some(plan)) = (has_readings, plan(text)) {
            return Ok(plan);
        }
        let (kind, columns) = log.as_ref().map(described).unwrap_or_default();
        let fits = has_readings && log.as_ref().is_ok_and(Log::has_wrench);
        let read = ReadOptions { progress: Some(progress), ..ReadOptions::default() };
        let document = json!({
            "kind": kind,
            "columns": columns,
            "has_readings": has_readings,
            "fits": fits,
            "findings": examine_log(log, &read, None),
        });
        Ok(document.into())
    }
}

fn described(log: &Log) -> (String, Value) {
    let packed = log.compression().map_or_else(String::new, |name| format!(", {name}"));
    let column = |column: &Column| json!({ "name": column.name, "meaning": column.in_words() });
    (log.kind() + &packed, log.columns().iter().map(column).collect())
}

fn calibration(text: &[u8]) -> Result<Answer, Failure> {
    let file = CalibrationFile::parse(text).map_err(|problem| Failure::new(&problem, None))?;
    let (calibration, origin) = (&file.calibration, &file.origin);
    let kind = format!(
        "calibration of {} channels: {}, made by {} on {}",
        calibration.channels(),
        calibration.name(),
        origin.made_by,
        origin.date
    );
    Ok(json!({ "kind": kind, "is_calibration": true, "columns": [], "findings": [] }).into())
}

fn plan(text: &[u8]) -> Option<Answer> {
    let loads = HungLoads::parse(str::from_utf8(text).ok()?).ok()?;
    let kind = format!("table of {} loads", loads.loads().len());
    Some(json!({ "kind": kind, "is_plan": true, "columns": [], "findings": [] }).into())
}
