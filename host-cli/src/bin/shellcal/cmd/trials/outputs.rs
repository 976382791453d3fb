//! Where the tables of a batch go.

use std::path::{Path, PathBuf};

use figures::Format;
use output_file::OutputError;
use shellcal::workflow::batch::Batch;
use shellcal::workflow::figures::{FigureFolder, reduce_trace};
use table_file::write::NamedTable;
use trial::manifest::{CellPosition, Shard};
use trial::tables::{conditions_table, strides_table, trace_table, trials_table};
use trial::{ConditionRow, Profile, TraceExtent, TrialResult};

use super::manifest;
use crate::cmd::choices::one_of;
use crate::cmd::outputs::FigureSize;
use crate::files::{OutputLocation, create_folder};
use crate::printer::Printer;

/// The tables of a batch, which are also the names of their files. A share of the trials has no conditions.
const TABLES: [&str; 3] = ["trials", "strides", "conditions"];

/// The files of the tables in a directory: `trials.csv`, or `trials/part-00003-of-00100.csv` of a share.
fn table_files(directory: &Path, shard: Option<Shard>, extension: &str) -> Vec<PathBuf> {
    let Some(shard) = shard else {
        return TABLES.map(|table| directory.join(format!("{table}.{extension}"))).to_vec();
    };
    let name = format!("{}.{extension}", shard.stem());
    TABLES[..2].iter().map(|table| directory.join(table).join(&name)).collect()
}

/// What is written, and where.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Results as files")]
pub(crate) struct ResultArgs {
    /// Write trials.csv, strides.csv and conditions.csv into a directory
    #[arg(long, value_name = "DIR")]
    csv: Option<OutputLocation>,

    /// Write trials.parquet, strides.parquet and conditions.parquet into a directory
    #[arg(long, value_name = "DIR")]
    parquet: Option<OutputLocation>,

    /// Write what happened in each window, row by row, into a directory: `LOG.LINE.csv`
    #[arg(long, value_name = "DIR")]
    pub(crate) traces: Option<OutputLocation>,

    /// Let traces run over the whole log
    #[arg(long, requires = "traces")]
    whole_logs: bool,

    /// Draw every figure into a directory: `boxes`, `phase`, and of each trial `LOG.LINE.drag` and
    /// `LOG.LINE.telemetry`
    #[arg(long, value_name = "DIR")]
    pub(crate) figures: Option<OutputLocation>,

    #[command(flatten)]
    figure_size: FigureSize,

    /// The formats of figures
    #[arg(long, value_name = "FORMATS", value_parser = one_of(&FORMATS), value_delimiter = ',', default_values = ["svg", "png"], requires = "figures")]
    figure_format: Vec<Format>,
}

/// Formats of figures.
const FORMATS: [(&str, &str, Format); 3] = [
    ("svg", "Scalable, for print", Format::Svg),
    ("pdf", "Scalable, with its letters, for LaTeX and Word", Format::Pdf),
    ("png", "Pixels, for slides and messages", Format::Png),
];

impl ResultArgs {
    /// Makes the directories and finds out whether tables can be written, before any work.
    pub(crate) fn prepare(&self, printer: &Printer, shard: Option<Shard>) -> anyhow::Result<()> {
        self.traces.iter().try_for_each(OutputLocation::create)?;
        for (directory, extension) in [(&self.csv, "csv"), (&self.parquet, "parquet")] {
            let Some(directory) = directory else { continue };
            for file in table_files(directory, shard, extension) {
                create_folder(file.parent().unwrap_or(directory))?;
                printer.files.probe(&file)?;
            }
        }
        Ok(())
    }

    /// The directory of figures, made if it is not there.
    pub(crate) fn figure_folder<'a>(
        &self,
        printer: &'a Printer,
    ) -> anyhow::Result<Option<FigureFolder<'a>>> {
        let Some(directory) = &self.figures else { return Ok(None) };
        let (formats, size) = (&self.figure_format, self.figure_size.size);
        Ok(Some(FigureFolder::create(&printer.files, directory, formats, size)?))
    }

    /// What has to be kept of a log for the outputs.
    pub(crate) fn trace_extent(&self) -> TraceExtent {
        match &self.traces {
            _ if self.whole_logs || self.figures.is_some() => TraceExtent::Log,
            Some(_) => TraceExtent::Window,
            None => TraceExtent::Nothing,
        }
    }

    /// Writes figures and trace of a trial, and lets the trace go.
    pub(crate) fn write_trial(
        &self,
        printer: &Printer,
        position: CellPosition,
        result: &mut TrialResult,
        figures: Option<&FigureFolder<'_>>,
        profile: &Profile,
    ) -> Result<(), OutputError> {
        if let (Some(figures), Some(trace)) = (figures, &result.trace) {
            figures.write_trial(&manifest::stem(position, result), &result.row, trace, profile)?;
        }
        if let (Some(directory), Some(trace)) = (&self.traces, &result.trace) {
            let path = directory.join(format!("{}.csv", manifest::stem(position, result)));
            let table = match self.whole_logs {
                true => trace_table(trace),
                false => trace_table(&trace.within(result.row.t_enter_s, result.row.t_exit_s)),
            };
            printer.files.write(path, &table.to_csv())?;
        }
        match figures {
            Some(_) => reduce_trace(result, profile, false),
            None => result.trace = None,
        }
        Ok(())
    }

    /// Writes the tables.
    pub(crate) fn write_tables(
        &self,
        printer: &Printer,
        batch: &Batch,
        conditions: &[ConditionRow],
        shard: Option<Shard>,
    ) -> anyhow::Result<()> {
        if self.csv.is_none() && self.parquet.is_none() {
            return Ok(());
        }
        let results = batch.trials.iter().map(|trial| &trial.evaluated.result);
        let tables: [NamedTable; 3] =
            [trials_table(results.clone()), strides_table(results), conditions_table(conditions)];
        for (directory, extension) in [(&self.csv, "csv"), (&self.parquet, "parquet")] {
            let Some(directory) = directory else { continue };
            for (file, table) in table_files(directory, shard, extension).iter().zip(&tables) {
                let bytes = if extension == "csv" { table.to_csv() } else { table.to_parquet()? };
                printer.files.write(file, &bytes)?;
            }
        }
        Ok(())
    }
}
