//! `shellcal merge`: from partial fits to a calibration.

use std::io::Write;

use anyhow::Context;
use calibration::exact::PartitionedMoments;
use calibration::solver::{SolverKind, solve_moments};
use calibration::uncertainty::Covariance;
use calibration::{Calibration, FitError};
use serde::Serialize;
use shell_data::wrench::{Axis, PerAxis};
use shellcal::calibration_file::stored::{Stored, StoredQuality};
use shellcal::calibration_file::{CalibrationFile, Diagnostics, Origin, PartialFit, SolverRecord};
use shellcal::output::Outputs;

use super::origin;
use super::quality::{significant, table_row};
use crate::files::{InputPath, OutputPath};
use crate::outcome::Outcome;
use crate::printer::Printer;

#[derive(Debug, clap::Args)]
pub(crate) struct MergeArgs {
    /// Partial fits
    #[arg(required = true, value_name = "PARTIAL")]
    partials: Vec<InputPath>,

    /// Write the calibration (JSON)
    #[arg(long, short, value_name = "CAL.json")]
    output: Option<OutputPath>,

    /// Write what has been merged as one partial fit, and fit nothing
    #[arg(long, value_name = "FILE.json", conflicts_with_all = ["output", "ridge"])]
    partial: Option<OutputPath>,

    /// Penalise large coefficients: λ, relative to features of norm one, such as 1e-6
    #[arg(long, value_name = "LAMBDA", default_value_t = 0.0, hide_default_value = true)]
    ridge: f64,

    /// Leave the covariance out of the calibration: smaller, but without standard errors
    #[arg(long)]
    no_covariance: bool,

    /// The label of the sensor, for the calibration file
    #[arg(long, value_name = "SERIAL")]
    serial: Option<String>,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    model: String,
    partial_fits: usize,
    files: usize,
    rows: u64,
    skipped_rows: u64,
    repeated_rows: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    condition: Option<f64>,
    axes: PerAxis<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    train: Option<PerAxis<StoredQuality>>,
}

impl MergeArgs {
    pub(crate) fn run(&self, printer: &mut Printer, outputs: &Outputs) -> anyhow::Result<Outcome> {
        let open =
            |path: &Option<OutputPath>| path.as_ref().map(|path| outputs.create(path)).transpose();
        let (output, partial) = (open(&self.output)?, open(&self.partial)?);
        let merged = self.merged()?;
        if let Some(mut partial) = partial {
            partial.write_all(merged.to_json().as_bytes())?;
            partial.commit()?;
            self.report(printer, &merged, None)?;
            return Ok(Outcome::Done);
        }
        let file = self.calibration_file(merged.clone())?;
        if let Some(mut output) = output {
            output.write_all(file.to_json().as_bytes())?;
            output.commit()?;
        }
        self.report(printer, &merged, file.origin.diagnostics.as_ref())?;
        Ok(Outcome::Done)
    }

    fn merged(&self) -> anyhow::Result<PartialFit> {
        let mut partials = self.partials.iter();
        let first = partials.next().context("no partial fits were given")?;
        let mut merged = PartialFit::read(first)?;
        for path in partials {
            let partial = PartialFit::read(path)?;
            merged.merge(&partial).with_context(|| format!("`{}`", path.display()))?;
        }
        merged.made_by = origin::program();
        merged.date = origin::date()?;
        Ok(merged)
    }

    fn calibration_file(&self, merged: PartialFit) -> anyhow::Result<CalibrationFile> {
        let (model, moments) = (merged.model, &merged.moments);
        let ranges = moments.reading_ranges();
        let solution = solve_moments(moments, &model, self.ridge, &ranges)?;
        let mut calibration = Calibration::of_solution(&solution, &ranges);
        if !self.no_covariance {
            calibration.covariance = Covariance::of_rows(&solution);
        }
        let train =
            PartitionedMoments::new(moments, &model).and_then(|parts| parts.in_sample(self.ridge));
        Ok(CalibrationFile {
            calibration,
            origin: Origin {
                made_by: merged.made_by,
                date: merged.date,
                sensor_serial: self.serial.clone(),
                solver: Some(SolverRecord {
                    name: SolverKind::Exact,
                    ridge: self.ridge,
                    truncate: None,
                }),
                diagnostics: Some(Diagnostics {
                    rows: solution.rows,
                    skipped_rows: merged.skipped_rows,
                    repeated_rows: merged.repeated_rows,
                    rank: solution.rank,
                    condition: solution.condition.is_finite().then_some(solution.condition),
                    train: train.map_err(|_| FitError::NearlyDependent)?,
                    test: None,
                    cross_validation: None,
                    selection: None,
                    excitation: None,
                }),
                sources: merged.sources,
            },
        })
    }

    fn report(
        &self,
        printer: &mut Printer,
        merged: &PartialFit,
        fit: Option<&Diagnostics>,
    ) -> anyhow::Result<()> {
        let (rows, files) = (merged.moments.rows(), merged.sources.len());
        if printer.json() {
            return printer.document(&Report {
                model: merged.model.name(),
                partial_fits: self.partials.len(),
                files,
                rows,
                skipped_rows: merged.skipped_rows,
                repeated_rows: merged.repeated_rows,
                condition: fit.and_then(|fit| fit.condition),
                axes: Axis::ALL.map(Axis::column),
                train: fit.map(|fit| Stored::of(&fit.train)),
            });
        }
        let mut summary = format!("{}: {rows} rows of {files} files", merged.model.name());
        if let Some(fit) = fit {
            let rows = Axis::ALL.map(|axis| table_row(axis, &[&fit.train])).to_vec();
            printer.table(&["axis", "RMS train", "max train", "R² train", "unit"], &rows)?;
            let condition = fit.condition.map_or("infinite".into(), |c| significant(c, 3));
            summary += &format!(", rank {}, condition {condition}", fit.rank);
        }
        printer.line(summary)
    }
}
