//! Where the tables of a batch go.

use std::path::{Path, PathBuf};

use anyhow::Context;
use shellcal::output::{OutputError, write_atomically};
use shellcal::table::Table;
use shellcal::trial::manifest::Place;
use shellcal::trial::tables::{conditions_table, strides_table, trace_table, trials_table};
use shellcal::trial::{ConditionRow, TrialResult};
use shellcal::workflow::batch::Batch;

/// What is written, and where.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Results as files")]
pub(crate) struct OutputArgs {
    /// Write trials.csv, strides.csv and conditions.csv into a directory
    #[arg(long, value_name = "DIR")]
    csv: Option<PathBuf>,

    /// Write trials.parquet, strides.parquet and conditions.parquet into a directory
    #[arg(long, value_name = "DIR")]
    parquet: Option<PathBuf>,

    /// Write what happened in each window, row by row, into a directory: `LOG.LINE.csv`
    #[arg(long, value_name = "DIR")]
    pub(crate) traces: Option<PathBuf>,
}

impl OutputArgs {
    /// Makes the directories, before any work.
    pub(crate) fn prepare(&self) -> anyhow::Result<()> {
        for directory in [&self.csv, &self.parquet, &self.traces].into_iter().flatten() {
            std::fs::create_dir_all(directory)
                .with_context(|| format!("cannot create `{}`", directory.display()))?;
        }
        Ok(())
    }

    /// Writes the trace of a trial, and lets it go.
    pub(crate) fn write_trace(
        &self,
        place: Place,
        result: &mut TrialResult,
    ) -> Result<(), OutputError> {
        let (Some(directory), Some(trace)) = (&self.traces, result.trace.take()) else {
            return Ok(());
        };
        let stem = Path::new(&result.row.file).file_stem().unwrap_or_default().to_string_lossy();
        let path = directory.join(format!("{stem}.{}.csv", place.line));
        write_atomically(path, &trace_table(&trace).to_csv())
    }

    /// Writes the tables.
    pub(crate) fn write_tables(
        &self,
        batch: &Batch,
        conditions: &[ConditionRow],
    ) -> anyhow::Result<()> {
        if self.csv.is_none() && self.parquet.is_none() {
            return Ok(());
        }
        let results = batch.trials.iter().map(|trial| &trial.evaluated.result);
        let tables: [(&str, Table); 3] = [
            ("trials", trials_table(results.clone())),
            ("strides", strides_table(results)),
            ("conditions", conditions_table(conditions)),
        ];
        for (name, table) in &tables {
            if let Some(directory) = &self.csv {
                write_atomically(directory.join(format!("{name}.csv")), &table.to_csv())?;
            }
            if let Some(directory) = &self.parquet {
                let bytes = table.to_parquet()?;
                write_atomically(directory.join(format!("{name}.parquet")), &bytes)?;
            }
        }
        Ok(())
    }
}
