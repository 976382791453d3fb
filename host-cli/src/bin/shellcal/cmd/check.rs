//! `shellcal check`: known weights on a calibrated sensor, pass or fail.

use calibration::quality::significant;
use report::CheckedLoad;
use serde::Serialize;
use shell_data::wrench::{Axes, PerAxis};
use shellcal::workflow::check::check_weights;

use super::edited::EditedArg;
use super::mapping::{MappingArgs, open_logs, tell_remembered};
use super::plan::read_table;
use crate::files::InputPath;
use crate::outcome::Outcome;
use crate::printer::Printer;

const EXAMPLES: &str = "\
Examples:
  shellcal check calibration.json weight.csv morning.csv
  shellcal check calibration.json weight.csv morning.csv --quiet || echo calibrate again";

#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CheckArgs {
    /// The calibration
    #[arg(value_name = "CAL.json")]
    calibration: InputPath,

    /// The weights, one a line: mass or force, point and direction, with their errors. A line with the mass 0 is the
    /// zero that is subtracted
    #[arg(value_name = "LOADS.csv")]
    loads: InputPath,

    /// Logs of readings, matched by the group column, otherwise in order by stretches of still readings
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<InputPath>,

    #[command(flatten)]
    edited: EditedArg,

    #[command(flatten)]
    mapping: MappingArgs,
}

/// What `--json` prints.
#[derive(Serialize)]
struct CheckReport<'a> {
    passes: bool,
    axes: Vec<&'static str>,
    loads: &'a [CheckedLoad],
}

impl CheckArgs {
    pub(crate) fn run(&self, printer: &mut Printer) -> anyhow::Result<Outcome> {
        let file = self.edited.read(&self.calibration)?;
        let table = read_table(&self.loads)?;
        let mapping = self.mapping.mapping_for(&file);
        let logs = open_logs(&self.logs, ("--wrench-from", &[]), &mapping)?;
        tell_remembered(printer, &self.calibration, &mapping, &logs);
        let axes = file.calibration.axes;
        let checked = check_weights(&file, &logs, &table, &self.mapping.read_options())?;
        let passes = checked.iter().all(|of| of.off.is_empty());
        if printer.json() {
            printer.document(&CheckReport { passes, axes: axes.columns(), loads: &checked })?;
        } else {
            print(printer, &checked, axes)?;
            printer.line(match passes {
                true => {
                    "passes: every difference is within what errors of sensor and weights explain"
                }
                false => {
                    "fails: the sensor has changed, or the weights are not what the table says"
                }
            })?;
        }
        Ok(if passes { Outcome::Done } else { Outcome::CheckFailed })
    }
}

fn print(printer: &mut Printer, checked: &[CheckedLoad], axes: Axes) -> anyhow::Result<()> {
    let mut rows = Vec::new();
    for of in checked {
        for axis in axes.iter() {
            let value = |values: &PerAxis<f64>| significant(values[axis.index()], 3);
            let difference = of.measured[axis.index()] - of.stated[axis.index()];
            rows.push(vec![
                of.group.clone(),
                axis.name().to_owned(),
                value(&of.stated),
                value(&of.measured),
                significant(difference, 2),
                significant(of.allowed[axis.index()], 2),
                axis.unit().to_owned(),
                if of.off.contains(axis) { "off".to_owned() } else { String::new() },
            ]);
        }
    }
    let header = ["load", "axis", "stated", "measured", "difference", "allowed", "unit", ""];
    printer.table(&header, rows)
}
