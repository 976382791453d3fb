//! Where the tables of a batch go.

use std::path::PathBuf;

use anyhow::Context;
use shellcal::figures::Format;
use shellcal::output::{OutputError, write_atomically};
use shellcal::table::Table;
use shellcal::trial::manifest::Place;
use shellcal::trial::tables::{conditions_table, strides_table, trace_table, trials_table};
use shellcal::trial::{ConditionRow, Profile, TraceExtent, TrialResult};
use shellcal::workflow::batch::Batch;
use shellcal::workflow::figures::{FigureFolder, reduce_trace};

use super::manifest;

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

    /// Let traces run over the whole log
    #[arg(long, requires = "traces")]
    whole_logs: bool,

    /// Draw every figure into a directory: `boxes`, `phase`, and of each trial `LOG.LINE.drag` and
    /// `LOG.LINE.telemetry`
    #[arg(long, value_name = "DIR")]
    pub(crate) figures: Option<PathBuf>,

    /// The formats of figures
    #[arg(long, value_name = "FORMATS", value_enum, value_delimiter = ',', default_values_t = [FormatArg::Svg, FormatArg::Png], requires = "figures")]
    figure_format: Vec<FormatArg>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum FormatArg {
    /// Scalable, for print
    Svg,
    /// Pixels, for slides and messages
    Png,
}

impl From<FormatArg> for Format {
    fn from(format: FormatArg) -> Self {
        match format {
            FormatArg::Svg => Self::Svg,
            FormatArg::Png => Self::Png,
        }
    }
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

    /// The directory of figures, made if it is not there.
    pub(crate) fn figure_folder(&self) -> anyhow::Result<Option<FigureFolder>> {
        let Some(directory) = &self.figures else { return Ok(None) };
        let formats: Vec<Format> = self.figure_format.iter().map(|&format| format.into()).collect();
        Ok(Some(FigureFolder::create(directory, &formats)?))
    }

    /// What has to be kept of a log for the outputs.
    pub(crate) fn trace_extent(&self) -> TraceExtent {
        match (&self.figures, &self.traces) {
            _ if self.whole_logs => TraceExtent::Log,
            (Some(_), _) => TraceExtent::Log,
            (None, Some(_)) => TraceExtent::Window,
            (None, None) => TraceExtent::Nothing,
        }
    }

    /// Writes figures and trace of a trial, and lets the trace go.
    pub(crate) fn write_trial(
        &self,
        place: Place,
        result: &mut TrialResult,
        figures: Option<&FigureFolder>,
        profile: &Profile,
    ) -> Result<(), OutputError> {
        if let (Some(figures), Some(trace)) = (figures, &result.trace) {
            figures.write_trial(&manifest::stem(place, result), &result.row, trace, profile)?;
        }
        self.write_trace(place, result)?;
        match figures {
            Some(_) => reduce_trace(result, profile, false),
            None => result.trace = None,
        }
        Ok(())
    }

    /// Writes the trace of a trial.
    fn write_trace(&self, place: Place, result: &TrialResult) -> Result<(), OutputError> {
        let (Some(directory), Some(trace)) = (&self.traces, &result.trace) else {
            return Ok(());
        };
        let path = directory.join(format!("{}.csv", manifest::stem(place, result)));
        let table = match self.whole_logs {
            true => trace_table(trace),
            false => trace_table(&trace.within(result.row.t_enter_s, result.row.t_exit_s)),
        };
        write_atomically(path, &table.to_csv())
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
