//! Every combination of parameter values.

use std::collections::BTreeMap;
use std::io::Write;

use anyhow::ensure;
use serde::Serialize;
use simulation::channel_study::{GridAxis, GridCell, Parameter, grid};

use super::args::SimulateArgs;
use crate::printer::Printer;
use crate::tables::or_dash;

const MOST_CELLS: f64 = 1e8;

impl SimulateArgs {
    pub(super) fn run_grid(&self, printer: &Printer) -> anyhow::Result<()> {
        let (base, axes) = self.axes();
        let count: f64 = axes.iter().map(|axis| axis.values.len() as f64).product();
        ensure!(count <= MOST_CELLS, "the grid would have {count:.1e} combinations");
        for (i, axis) in axes.iter().enumerate() {
            let twice = axes[..i].iter().any(|other| other.parameter.name == axis.parameter.name);
            ensure!(!twice, "`--grid {}` is given twice", axis.parameter.name);
        }
        let mut output = printer.create(self.output.as_ref())?;
        let names: Vec<String> = axes.iter().map(|axis| axis.parameter.column()).collect();
        if let Some(file) = &mut output {
            let names = names.join(",");
            writeln!(file, "{names},mean_drag_n,minimum_drag_n,peak_drag_n,energy_j,error")?;
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
        match output {
            Some(file) => file.commit()?,
            None => printer.finish(&reports, |printer| {
                let figures = ["mean drag (N)", "minimum (N)", "peak (N)", "energy (mJ)"];
                let header: Vec<&str> = names.iter().map(String::as_str).chain(figures).collect();
                printer.table(&header, rows);
            })?,
        }
        if refused > 0 {
            printer.warning(format!("{refused} combinations make no sense, or the body jams"));
        }
        Ok(())
    }

    /// The axes of the grid. The channels' widths are an axis, too, unless the user gave one.
    fn axes(&self) -> (beam_channel::Setup, Vec<GridAxis>) {
        let setups = self.setups();
        let mut axes = self.grid.clone();
        if axes.iter().all(|axis| axis.parameter.name != Parameter::WIDTH.name) {
            let values = setups.iter().map(|setup| setup.channel.width_m).collect();
            axes.insert(0, GridAxis { parameter: Parameter::WIDTH, values });
        }
        (setups[0], axes)
    }
}

/// Mean, minimum and peak of the drag in N, and the energy in J, if available.
fn figures(cell: &GridCell) -> [Option<f64>; 4] {
    let summary = cell.outcome.as_ref().ok();
    let figures =
        summary.map(|of| [of.mean_drag_n, of.minimum_drag_n, of.peak_drag_n, Some(of.energy_j)]);
    figures.unwrap_or_default()
}

fn csv_row(cell: &GridCell) -> String {
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
    let error = cell.outcome.as_ref().err().map(|error| format!("\"{error}\""));
    let values = cell.values.iter().copied().map(Some).chain(figures(cell)).map(number);
    values.chain([error.unwrap_or_default()]).collect::<Vec<_>>().join(",")
}

fn table_row(cell: &GridCell) -> Vec<String> {
    let [drags @ .., energy] = figures(cell);
    let mut row: Vec<String> = cell.values.iter().map(|value| rounded(*value)).collect();
    row.extend(drags.map(|drag: Option<f64>| or_dash(drag, 4)));
    row.push(or_dash(energy.map(|energy| 1e3 * energy), 3));
    row
}

/// A value rounded to twelve digits, to remove rounding errors.
fn rounded(value: f64) -> String {
    let text = format!("{value:.11e}");
    text.parse::<f64>().map_or(text, |value| value.to_string())
}

fn report<'a>(names: &'a [String], cell: GridCell) -> impl Serialize + use<'a> {
    document! {
        parameters: names.iter().zip(cell.values).collect::<BTreeMap<_, _>>(),
        ..summary: cell.outcome.as_ref().ok().cloned(),
        error: cell.outcome.err().map(|error| error.to_string()),
    }
}
