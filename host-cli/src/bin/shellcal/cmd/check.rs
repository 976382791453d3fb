//! `shellcal check`: whether a calibration holds, with known weights on the sensor.

use calibration::quality::significant;
use report::CheckedLoad;
use shell_data::wrench::{Axes, Axis};
use shellcal::workflow::check::check_weights;

use super::mapping::{EditedArg, MappingArgs};
use super::plan::read_table;
use crate::files::InputPath;
use crate::printer::{Outcome, Printer, TableColumn};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal check calibration.json weight.csv morning.csv
  shellcal check calibration.json weight.csv morning.csv --quiet || echo calibrate again")]
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

impl CheckArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        let file = self.edited.read(&self.calibration)?;
        let table = read_table(&self.loads)?;
        let calibration = Some((&self.calibration, &file));
        let logs = self.mapping.open(&self.logs, &[], calibration, printer)?;
        let axes = file.calibration.axes;
        let checked = check_weights(&file, &logs, &table, &self.mapping.read_options())?;
        let passes = checked.iter().all(|of| of.off.is_empty());
        let verdict = match passes {
            true => "passes: every difference is within what errors of sensor and weights explain",
            false => "fails: the sensor has changed, or the weights are not what the table says",
        };
        let document = document! { passes: passes, axes: axes.columns(), loads: &checked };
        printer.finish(&document, |printer| {
            print(printer, &checked, axes);
            printer.line(verdict)
        })?;
        Ok(if passes { Outcome::Done } else { Outcome::CheckFailed })
    }
}

fn print(printer: &Printer, checked: &[CheckedLoad], axes: Axes) {
    let difference = |of: &CheckedLoad, axis: usize| of.measured[axis] - of.stated[axis];
    let columns: [TableColumn<'_, (&CheckedLoad, Axis)>; 8] = [
        ("load", &|(of, _)| of.group.clone()),
        ("axis", &|(_, axis)| axis.name().to_owned()),
        ("stated", &|(of, axis)| significant(of.stated[axis.index()], 3)),
        ("measured", &|(of, axis)| significant(of.measured[axis.index()], 3)),
        ("difference", &|(of, axis)| significant(difference(of, axis.index()), 2)),
        ("allowed", &|(of, axis)| significant(of.allowed[axis.index()], 2)),
        ("unit", &|(_, axis)| axis.unit().to_owned()),
        ("", &|(of, axis)| if of.off.contains(*axis) { "off".to_owned() } else { String::new() }),
    ];
    printer.records(&columns, checked.iter().flat_map(|of| axes.iter().map(move |axis| (of, axis))))
}
