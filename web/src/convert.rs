//! Conversion of a log of readings to a table of forces.

use std::path::Path;
use std::sync::Arc;

use calibration_file::CalibrationFile;
use figures::{Size, WrenchTrace, trace_figure};
use log_file::ReadOptions;
use serde::Deserialize;
use serde_json::json;
use shellcal::workflow::convert::{Conversion, ConvertOptions, OutputPlan, convert, table_name};
use shellcal::workflow::remark::Remark;

use crate::request::{ColumnsGiven, FileRef};
use crate::{Answer, Failure};

#[derive(Deserialize)]
pub(crate) struct Convert {
    calibration: FileRef,
    log: FileRef,
    #[serde(default)]
    columns: ColumnsGiven,
}

impl Convert {
    pub(crate) fn run(
        &self,
        files: &[Arc<[u8]>],
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<Answer, Failure> {
        let CalibrationFile { calibration, origin } =
            self.calibration.parsed(files, CalibrationFile::parse)?;
        let log = self.log.log(files, &self.columns.mapping(origin.columns))??;
        let options = ConvertOptions::new(&log, &calibration);
        let read = ReadOptions { threads: 1, progress: Some(progress), ..ReadOptions::default() };
        let conversion =
            Conversion { log: &log, calibration: &calibration, options: &options, read };
        let (mut table, mut trace) = (Vec::new(), WrenchTrace::default());
        let has_time = log.has_time();
        let traced = has_time.then_some(&mut trace);
        let summary = convert(&conversion, &OutputPlan::default(), &mut table, traced)?;
        let path = Path::new(&self.log.name);
        let mut remarks = summary.remarks(path);
        let doubt = summary.tare_doubt(path, origin.diagnostics.as_ref());
        remarks.extend(doubt.map(Remark::Warning));
        let figure = has_time.then(|| trace_figure(Size::Screen, &self.log.name, &trace));
        Ok(Answer {
            document: json!({
                "frames": summary.frames,
                "remarks": remarks,
                "figure": figure.as_ref().map(figures::Figure::svg),
            }),
            files: vec![(table_name(path), table)],
        })
    }
}
