//! Fit of training logs: a calibration with its report.

use std::sync::Arc;

use calibration::FitError;
use calibration::fit::{FitOptions, HeldOut, ModelRule, Workers};
use calibration_file::Origin;
use log_file::{Log, Mapping, ReadOptions};
use serde::Deserialize;
use serde_json::json;
use shell_data::hint::quoted;
use shellcal::PROGRAM;
use shellcal::workflow::fit::{FitData, FittedLogs};
use shellcal::workflow::{WorkflowError, agree_on_axes};

use crate::request::{ColumnsGiven, FileRef};
use crate::{Answer, Failure, Progress};

const CALIBRATION: &str = "calibration.json";
const REPORT: &str = "report.html";

#[derive(Deserialize)]
pub(crate) struct FitRequest {
    train: Vec<FileRef>,
    #[serde(default)]
    test: Vec<FileRef>,
    #[serde(default)]
    columns: ColumnsGiven,
    model: String,
    /// As for `--cv`.
    #[serde(default)]
    hold_out: Option<String>,
    /// The current time in UTC, RFC 3339 to the second.
    date: String,
}

impl FitRequest {
    pub(crate) fn run(
        &self,
        files: &[Arc<[u8]>],
        progress: Progress<'_>,
    ) -> Result<Answer, Failure> {
        let model = ModelRule::from_name(&self.model)
            .ok_or_else(|| format!("there is no model `{}`", self.model))?;
        let options = FitOptions {
            model,
            dynamics: model.usual_dynamics(),
            cross_validation: self.hold_out.as_deref().map(str::parse::<HeldOut>).transpose()?,
            workers: Workers { folds: Some(progress.folds), ..Workers::ONE },
            ..FitOptions::default()
        };
        let mapping = self.columns.mapping(None);
        let [train, test] = self.logs(files, &mapping)?;
        let read = ReadOptions {
            threads: 1,
            checksum: true,
            progress: Some(progress.bytes),
            ..ReadOptions::default()
        };
        let mut data = FitData::read(&train, &test, (&options, true), &read)?;
        let fitted = data.fit(&options);
        let fitted = fitted.map_err(|error| self.failure(error))?;
        let specified = train.first().map(|log| log.specified(&mapping));
        let origin = Origin {
            made_by: PROGRAM.to_owned(),
            date: self.date.clone(),
            columns: specified.filter(|names| !names.is_empty()),
            ..Origin::default()
        };
        let origin = (origin, options.outliers);
        let fitted = FittedLogs::new(fitted, (&train, &test), &data, origin)?;
        let command = self.command();
        let report = fitted.report(CALIBRATION, &command)?;
        let verdict = fitted.fit.verdict();
        Ok(Answer {
            document: json!({
                "verdict": verdict.screen(&format!("{CALIBRATION}, {REPORT}")).lines(),
                "ok": verdict.is_ok(),
                "remarks": fitted.remarks(),
                "command": command,
            }),
            files: vec![
                (CALIBRATION.to_owned(), fitted.file.to_json().into_bytes()),
                (REPORT.to_owned(), report.into_bytes()),
            ],
        })
    }

    fn logs(&self, files: &[Arc<[u8]>], mapping: &Mapping) -> Result<[Vec<Log>; 2], Failure> {
        let open = |logs: &[FileRef]| {
            let logs = logs.iter().map(|log| log.log(files, mapping));
            logs.map(|log| Ok(log??)).collect::<Result<Vec<Log>, Failure>>()
        };
        let (train, mut test) = (open(&self.train)?, open(&self.test)?);
        agree_on_axes(&train, &mut test)?;
        Ok([train, test])
    }

    /// Names the files if their rows are the reason.
    fn failure(&self, error: FitError) -> Failure {
        let is_about_rows = error.is_about_rows();
        let failure = Failure::from(WorkflowError::from(error));
        match is_about_rows {
            true => failure.about(&quoted(self.train.iter().map(|file| &file.name), ", ")),
            false => failure,
        }
    }

    /// Returns the equivalent command line, without assigned columns.
    fn command(&self) -> String {
        let names = |files: &[FileRef]| -> String {
            files.iter().map(|file| format!(" '{}'", file.name.replace('\'', r"'\''"))).collect()
        };
        let mut command = format!("shellcal fit{} --model {}", names(&self.train), self.model);
        if !self.test.is_empty() {
            command += &format!(" --test{}", names(&self.test));
        }
        if let Some(held_out) = &self.hold_out {
            command += &format!(" --cv={held_out}");
        }
        command + &format!(" --output {CALIBRATION} --report {REPORT}")
    }
}
