//! `shellcal batch`: all trials of a manifest, with tables and figures as files.

use std::path::{Path, PathBuf};

use figures::Format;
use output_file::OutputError;
use shellcal::workflow::batch::{Batch, BatchOptions};
use shellcal::workflow::figures::{FigureFolder, reduce_trace};
use table_file::write::NamedTable;
use trial::manifest::{CellPosition, Shard};
use trial::tables::{conditions_table, strides_table, trace_table, trials_table};
use trial::{ConditionRow, Profile, TraceExtent, TrialResult};

use super::evaluation::{self, BOOTSTRAP_SEED, Equipment, EvaluationArgs, ReferenceArg, stem};
use super::show;
use crate::cmd::choices::one_of;
use crate::cmd::outputs::FigureSize;
use crate::files::{InputPath, OutputLocation, create_folder};
use crate::printer::{Outcome, Printer};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal batch manifest.csv --calibration calibration.json --csv results
  shellcal batch manifest.csv --calibration calibration.json --reference free --traces traces
  shellcal batch manifest.toml --calibration calibration.json --json > results.json
  shellcal batch manifest.csv --calibration calibration.json --shard 3/100 --parquet results

A manifest is CSV with the columns file, condition, t_enter_s, t_exit_s and, if wanted,
velocity_m_s, mass_kg, channel_length_m, notes, exclude; or TOML with the same keys in [[trial]]
tables. Times are in s on the log's clock, or `auto`. Files are relative to the manifest.")]
pub(crate) struct BatchArgs {
    /// Table of trials: CSV or `.toml`
    #[arg(value_name = "MANIFEST")]
    manifest: InputPath,

    #[command(flatten)]
    compared: ReferenceArg,

    /// Evaluate one of N equal shares of the trials, and write `trials/part-K-of-N` and `strides/part-K-of-N`
    /// into the directories of `--csv` and `--parquet`; together, all shares give the results of the whole
    #[arg(long, value_name = "K/N", value_parser = parse_shard)]
    shard: Option<Shard>,

    #[command(flatten)]
    output: ResultArgs,

    #[command(flatten)]
    evaluation: EvaluationArgs,
}

impl BatchArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        self.output.prepare(printer, self.shard)?;
        let equipment = self.evaluation.equipment(self.output.trace_extent(), printer)?;
        let manifest = evaluation::read(&self.manifest, printer)?;
        evaluation::check_reference(&manifest, self.compared.reference.as_deref())?;
        let figures = self.output.figure_folder(printer)?;
        let options = BatchOptions { shard: self.shard, ..equipment.batch_options() };
        let (path, profile) = (&self.manifest, &equipment.profile);
        let keep = |position, result: &mut _| {
            self.output.write_trial(printer, position, result, figures.as_ref(), profile)
        };
        let batch = equipment.evaluate(printer, (path, &manifest), options, keep);
        let conditions = match self.shard {
            // Statistics need all trials.
            Some(_) => Vec::new(),
            None => batch.statistics(self.compared.reference.as_deref(), BOOTSTRAP_SEED),
        };
        let outcome = printer.decide(batch.failures.is_empty());
        self.output.write_tables(printer, &batch, &conditions, self.shard)?;
        if let Some(figures) = &figures {
            if self.shard.is_none() {
                figures.write_batch(&conditions, &batch.phases())?;
            }
            if let Some(note) = equipment.slow_filter(&batch) {
                printer.warning(note);
            }
        }
        // Probable mistakes in the manifest.
        let path = path.display();
        let suspicious = manifest.suspicious().into_iter();
        let warnings: Vec<_> = suspicious.map(|problem| format!("{path}:{problem}")).collect();
        self.show(printer, &equipment, &batch, &conditions, &warnings)?;
        Ok(outcome)
    }

    fn show(
        &self,
        printer: &Printer,
        equipment: &Equipment,
        batch: &Batch,
        conditions: &[ConditionRow],
        warnings: &[String],
    ) -> anyhow::Result<()> {
        let manifest = self.manifest.display();
        let results: Vec<_> = batch
            .trials
            .iter()
            .map(|trial| (format!("{manifest}:{}", trial.position.line), &trial.evaluated.result))
            .collect();
        equipment.note_forces(printer);
        show::diagnostics(printer, &results);
        warnings.iter().for_each(|warning| printer.warning(warning));
        evaluation::tell_failures(printer, &self.manifest, batch);
        let bad = batch.failures.len();
        if bad > 0 {
            let of = batch.trials.len() + bad;
            printer.failure(format!("{bad} of {of} trials could not be evaluated"));
        }
        if batch.excluded > 0 {
            printer.note(format!("{} trials are left out, as the manifest says", batch.excluded));
        }
        if printer.json() {
            let trials = batch.trials.iter().map(|trial| {
                document! {
                    line: trial.position.line,
                    checksum: &trial.evaluated.checksum,
                    ..result: &trial.evaluated.result,
                }
            });
            return printer.document(&document! {
                manifest: &self.manifest,
                calibration: &self.evaluation.calibration,
                profile: &equipment.profile,
                options: equipment.options,
                trials: trials.collect::<Vec<_>>(),
                failures: &batch.failures,
                excluded: batch.excluded,
                // Name of the share, unless all trials were evaluated.
                shard?: self.shard.map(Shard::stem),
                warnings, conditions,
            });
        }
        let results: Vec<&TrialResult> = results.into_iter().map(|(_, result)| result).collect();
        show::trials(printer, &results);
        if self.shard.is_none() {
            show::conditions(printer, conditions);
        }
        Ok(())
    }
}

fn parse_shard(text: &str) -> Result<Shard, String> {
    let parts = text
        .split_once('/')
        .and_then(|(number, of)| Shard::new(number.trim().parse().ok()?, of.trim().parse().ok()?));
    let most = Shard::MOST;
    parts.ok_or_else(|| format!("a share of at most {most}, from 1, such as `3/100`"))
}

/// The tables of a batch, by the names of their files. A share of the trials has no conditions.
const TABLES: [&str; 3] = ["trials", "strides", "conditions"];

/// The files of the tables in a directory: `trials.csv`, or `trials/part-00003-of-00100.csv` for a share.
fn table_files(directory: &Path, shard: Option<Shard>, extension: &str) -> Vec<PathBuf> {
    let Some(shard) = shard else {
        return TABLES.map(|table| directory.join(format!("{table}.{extension}"))).to_vec();
    };
    let name = format!("{}.{extension}", shard.stem());
    TABLES[..2].iter().map(|table| directory.join(table).join(&name)).collect()
}

/// Files of results.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Results as files")]
struct ResultArgs {
    /// Write trials.csv, strides.csv and conditions.csv into a directory
    #[arg(long, value_name = "DIR")]
    csv: Option<OutputLocation>,

    /// Write trials.parquet, strides.parquet and conditions.parquet into a directory
    #[arg(long, value_name = "DIR")]
    parquet: Option<OutputLocation>,

    /// Write the time series in each window, row by row, into a directory: `LOG.LINE.csv`
    #[arg(long, value_name = "DIR")]
    traces: Option<OutputLocation>,

    /// Draw every figure into a directory: `boxes`, `phase`, and for each trial `LOG.LINE.drag` and
    /// `LOG.LINE.telemetry`
    #[arg(long, value_name = "DIR")]
    figures: Option<OutputLocation>,

    #[command(flatten)]
    figure_size: FigureSize,

    /// Formats of figures
    #[arg(long, value_name = "FORMATS", value_parser = one_of(&FORMATS), value_delimiter = ',', default_values = ["svg", "png"], requires = "figures")]
    figure_format: Vec<Format>,
}

const FORMATS: [(&str, &str, Format); 3] = [
    ("svg", "Scalable, for print", Format::Svg),
    ("pdf", "Scalable, with its letters, for LaTeX and Word", Format::Pdf),
    ("png", "Pixels, for slides and messages", Format::Png),
];

impl ResultArgs {
    /// Creates the directories and checks that tables can be written, before any work.
    fn prepare(&self, printer: &Printer, shard: Option<Shard>) -> anyhow::Result<()> {
        self.traces.iter().try_for_each(|directory| create_folder(directory))?;
        for (directory, extension) in [(&self.csv, "csv"), (&self.parquet, "parquet")] {
            let Some(directory) = directory else { continue };
            for file in table_files(directory, shard, extension) {
                create_folder(file.parent().unwrap_or(directory))?;
                printer.files.probe(&file)?;
            }
        }
        Ok(())
    }

    fn figure_folder<'a>(
        &'a self,
        printer: &'a Printer,
    ) -> anyhow::Result<Option<FigureFolder<'a>>> {
        let Some(directory) = &self.figures else { return Ok(None) };
        create_folder(directory)?;
        let (outputs, formats, size) = (&printer.files, &self.figure_format, self.figure_size.size);
        Ok(Some(FigureFolder { outputs, directory, formats, size }))
    }

    fn trace_extent(&self) -> TraceExtent {
        match &self.traces {
            _ if self.figures.is_some() => TraceExtent::Log,
            Some(_) => TraceExtent::Window,
            None => TraceExtent::Nothing,
        }
    }

    fn write_trial(
        &self,
        printer: &Printer,
        position: CellPosition,
        result: &mut TrialResult,
        figures: Option<&FigureFolder<'_>>,
        profile: &Profile,
    ) -> Result<(), OutputError> {
        if let (Some(figures), Some(trace)) = (figures, &result.trace) {
            figures.write_trial(&stem(position, result), &result.row, trace, profile)?;
        }
        if let (Some(directory), Some(trace)) = (&self.traces, &result.trace) {
            let path = directory.join(format!("{}.csv", stem(position, result)));
            let table = trace_table(&trace.within(result.row.t_enter_s, result.row.t_exit_s));
            printer.files.write(path, &table.to_csv())?;
        }
        match figures {
            Some(_) => reduce_trace(result, profile, false),
            None => result.trace = None,
        }
        Ok(())
    }

    fn write_tables(
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
