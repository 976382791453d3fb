//! Every combination of parameter values.

use std::io::Write;

use anyhow::ensure;
use serde::Serialize;
use simulation::channel_study::{ChannelSummary, GridAxis, GridCell, Parameter, grid};

use super::args::SimulateArgs;
use crate::outcome::Outcome;
use crate::printer::Printer;
use crate::tables::or_dash;

/// Combinations at most.
const MOST_CELLS: f64 = 1e8;

/// What `--json` says of a combination.
#[derive(Debug, Serialize)]
struct CellReport {
    parameters: serde_json::Map<String, serde_json::Value>,
    #[serde(flatten)]
    summary: Option<ChannelSummary>,
    error: Option<String>,
}

impl SimulateArgs {
    pub(super) fn run_grid(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        let (base, axes) = self.axes();
        let count: f64 = axes.iter().map(|axis| axis.values.len() as f64).product();
        ensure!(count <= MOST_CELLS, "the grid would have {count:.1e} combinations");
        for (i, axis) in axes.iter().enumerate() {
            let twice = axes[..i].iter().any(|other| other.parameter.name == axis.parameter.name);
            ensure!(!twice, "`--grid {}` is given twice", axis.parameter.name);
        }
        let mut output = printer.create(self.sweep.output.as_ref())?;
        let names: Vec<String> = axes.iter().map(|axis| axis.parameter.column()).collect();
        if let Some(file) = &mut output {
            writeln!(
                file,
                "{},mean_drag_n,minimum_drag_n,peak_drag_n,energy_j,error",
                names.join(",")
            )?;
        }
        let bar = printer.count("combinations", count as u64);
        let (mut rows, mut reports, mut refused) = (Vec::new(), Vec::new(), 0);
        for cell in grid(&base, &axes) {
            refused += usize::from(cell.outcome.is_err());
            match &mut output {
                Some(file) => writeln!(file, "{}", csv_row(&cell))?,
                None if printer.json() => reports.push(report(&names, cell)),
                None => rows.push(table_row(&cell)),
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        let written = output.is_some();
        if let Some(file) = output {
            file.commit()?;
        }
        if printer.json() && !written {
            printer.document(&reports)?;
        } else if !written {
            let figures = ["mean drag (N)", "minimum (N)", "peak (N)", "energy (mJ)"];
            let header: Vec<&str> = names.iter().map(String::as_str).chain(figures).collect();
            printer.table(&header, rows)?;
        }
        if refused > 0 {
            printer.warning(format!("{refused} combinations make no sense, or the body jams"));
        }
        Ok(Outcome::Done)
    }

    /// The channels' widths are an axis too, unless one was asked for.
    fn axes(&self) -> (beam_channel::Setup, Vec<GridAxis>) {
        let setups = self.setups();
        let mut axes = self.study.grid.clone();
        if axes.iter().all(|axis| axis.parameter.name != Parameter::WIDTH.name) {
            let values = setups.iter().map(|setup| setup.channel.width_m).collect();
            axes.insert(0, GridAxis { parameter: Parameter::WIDTH, values });
        }
        (setups[0], axes)
    }
}

fn csv_row(cell: &GridCell) -> String {
    let mut fields: Vec<String> = cell.values.iter().map(f64::to_string).collect();
    match &cell.outcome {
        Ok(summary) => {
            let energy = Some(summary.energy_j);
            let drags = [summary.mean_drag_n, summary.minimum_drag_n, summary.peak_drag_n];
            let figures = drags.into_iter().chain([energy]);
            fields.extend(figures.map(|value| value.map_or_else(String::new, |v| v.to_string())));
            fields.push(String::new());
        }
        Err(error) => {
            fields.extend([""; 4].map(str::to_owned));
            fields.push(format!("\"{error}\""));
        }
    }
    fields.join(",")
}

fn table_row(cell: &GridCell) -> Vec<String> {
    let summary = cell.outcome.as_ref().ok();
    let figure =
        |of: fn(&ChannelSummary) -> Option<f64>, decimals| or_dash(summary.and_then(of), decimals);
    let mut row: Vec<String> = cell.values.iter().map(|value| rounded(*value)).collect();
    row.extend([
        figure(|summary| summary.mean_drag_n, 4),
        figure(|summary| summary.minimum_drag_n, 4),
        figure(|summary| summary.peak_drag_n, 4),
        figure(|summary| Some(1e3 * summary.energy_j), 3),
    ]);
    row
}

/// A value without the digits that arithmetic made: twelve places.
fn rounded(value: f64) -> String {
    let text = format!("{value:.11e}");
    text.parse::<f64>().map_or(text, |value| value.to_string())
}

fn report(names: &[String], cell: GridCell) -> CellReport {
    let values = cell.values.iter().map(|&value| value.into());
    let parameters = names.iter().cloned().zip(values).collect();
    match cell.outcome {
        Ok(summary) => CellReport { parameters, summary: Some(summary), error: None },
        Err(error) => CellReport { parameters, summary: None, error: Some(error.to_string()) },
    }
}
