//! `shellcal bench`: every solver on the same rows.

use std::path::Path;

use calibration::Basis;
use calibration::solver::SolverKind;
use log_file::{Wanted, read_logs};
use shell_data::block::Block;
use shellcal::workflow::bench::{self, ErrorKind, ModelBench};
use simulation::synthetic_log::training_blocks;

use super::choices;
use super::mapping::{MappingArgs, open_logs};
use super::outputs::{FigureArgs, FigureFile};
use crate::files::InputPath;
use crate::printer::{Printer, TableColumn};
use crate::tables::shown;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal bench train.csv
  shellcal bench train.csv --model cubic --solver exact,tsqr,gram --plot solvers.svg
  shellcal bench --rows 10000 --json")]
pub(crate) struct BenchArgs {
    /// Training logs, plain or gzip [default: rows of the sensor model]
    #[arg(value_name = "TRAIN")]
    train: Vec<InputPath>,

    /// Rows of the sensor model, where no logs are given
    #[arg(long, value_name = "N", default_value_t = 77_522, conflicts_with = "train")]
    rows: usize,

    /// Models to fit [default: all]
    #[arg(long, value_name = "MODEL", value_delimiter = ',', value_parser = choices::basis())]
    model: Vec<Basis>,

    /// Fit no constant beside the features
    #[arg(long)]
    no_intercept: bool,

    /// Solvers to run [default: all]
    #[arg(long, value_name = "SOLVER", value_delimiter = ',', value_parser = choices::any_solver())]
    solver: Vec<SolverKind>,

    #[command(flatten)]
    figure: FigureArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

impl BenchArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let opened = self.open_plots(printer)?;
        let blocks = self.blocks(printer)?;
        let bases = if self.model.is_empty() { &Basis::ALL[..] } else { &self.model };
        let kinds = if self.solver.is_empty() { &SolverKind::ALL[..] } else { &self.solver };
        let mut benches = Vec::new();
        printer.note(format!("{} models by {} solvers", bases.len(), kinds.len()));
        for (model, bench) in bench::walk(&blocks, bases, !self.no_intercept, kinds) {
            match bench {
                Ok(bench) => benches.push(bench),
                Err(error) => printer.warning(format!("{}: {error}", model.name())),
            }
        }
        anyhow::ensure!(!benches.is_empty(), "the rows determine none of the models");
        for (kind, plot) in opened {
            plot.draw(|size| bench::figure(size, &benches, kind))?;
        }
        printer.finish(&benches, |printer| {
            benches.iter().for_each(|bench| print(printer, bench));
            printer.note("`*`: no other solver is both faster and more accurate");
        })
    }

    fn open_plots(&self, printer: &Printer) -> anyhow::Result<Vec<(ErrorKind, FigureFile)>> {
        let Some(path) = &self.figure.plot else { return Ok(Vec::new()) };
        let open =
            |kind, path: &Path| anyhow::Ok((kind, self.figure.figure_size.open(path, printer)?));
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        let beside = path.with_file_name(format!("{stem}-prediction.{extension}"));
        Ok(vec![open(ErrorKind::Coefficients, path)?, open(ErrorKind::Prediction, &beside)?])
    }

    fn blocks(&self, printer: &Printer) -> anyhow::Result<Vec<Block>> {
        if self.train.is_empty() {
            printer.note(format!("{} rows of the sensor model", self.rows));
            return Ok(training_blocks(self.rows));
        }
        let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
        let logs = open_logs(&self.train, ("", &[]), &self.mapping.mapping())?;
        let rows = read_logs(&logs, &wanted, &self.mapping.read_options())?;
        let alike = rows.logs.iter().all(|log| log.channels == rows.channels());
        anyhow::ensure!(alike, "the logs differ in their number of channels");
        Ok(rows.blocks().map(|(_, block)| Block::clone(&block.rows)).collect())
    }
}

fn print(printer: &Printer, bench: &ModelBench) {
    printer.line(format!(
        "{}: {} features, {} rows, condition {:.1e}; errors relative to `{}`",
        bench.model, bench.features, bench.rows, bench.condition, bench.reference
    ));
    let error = |error: Option<f64>| shown(error, |e| format!("{e:.1e}"));
    let columns: [TableColumn<'_, &bench::Measurement>; 4] = [
        ("solver", &|m| format!("{}{}", m.solver, if m.on_front { " *" } else { "" })),
        ("time (ms)", &|m| format!("{:.2}", 1e3 * m.seconds)),
        ("coefficient error", &|m| match m.refused {
            Some(_) => "refused".to_owned(),
            None => error(m.coefficient_error),
        }),
        ("prediction error", &|m| error(m.prediction_error)),
    ];
    printer.records(&columns, &bench.solvers);
    for m in &bench.solvers {
        if let Some(reason) = &m.refused {
            printer.note(format!("{}, {}: {reason}", bench.model, m.solver));
        }
    }
}
