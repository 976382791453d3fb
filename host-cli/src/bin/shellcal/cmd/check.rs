//! `shellcal check`: a calibration compared with known weights on the sensor.

use calibration::quality::significant;
use report::CheckedLoad;
use shell_data::hint::quoted;
use shell_data::wrench::{Axes, Axis};
use shellcal::workflow::check::{CheckedWeights, check_weights};

use super::eval::AxesArg;
use super::mapping::{EditedArg, MappingArgs};
use super::plan::read_table;
use crate::files::InputPath;
use crate::printer::{Outcome, Printer, TableColumn};

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal check calibration.json weight.csv morning.csv
  shellcal check calibration.json weight.csv morning.csv --quiet || echo calibrate again")]
pub(crate) struct CheckArgs {
    #[arg(value_name = "CAL.json")]
    calibration: InputPath,

    /// Table of weights, one a line: mass or force, point and direction, with their errors. A line with the
    /// mass 0 is the zero that is subtracted
    #[arg(value_name = "LOADS.csv")]
    loads: InputPath,

    /// Logs of readings, matched by the group column, otherwise pose by pose, in order
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<InputPath>,

    #[command(flatten)]
    axes: AxesArg,

    #[command(flatten)]
    edited: EditedArg,

    #[command(flatten)]
    mapping: MappingArgs,
}

impl CheckArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        let file = self.edited.usable(&self.calibration, printer)?;
        let table = read_table(&self.loads)?.without(&self.mapping.exclude_group);
        let calibration = Some((&self.calibration, &file));
        let logs = self.mapping.open(&self.logs, &[], calibration, printer)?;
        let named = self.axes.named();
        let axes = named.map_or(file.calibration.axes, |axes| axes.and(file.calibration.axes));
        let read = self.mapping.read_options();
        let CheckedWeights { loads, gate } = check_weights(&file, &logs, &table, named, &read)?;
        let outcome = printer.judge(&gate);
        let holds = loads.iter().all(|of| of.off.is_empty());
        let verdict = match () {
            () if gate.passes() => {
                "passes: every difference is within what errors of sensor and weights explain"
            }
            () if holds && loads.iter().all(|of| of.cannot_tell) => {
                "cannot tell: a weight of nothing would pass as well; hang heavier ones"
            }
            () if holds => "fails: not all was compared",
            () => "fails: the sensor has changed, or the weights are not what the table says",
        };
        let light: Vec<&String> =
            loads.iter().filter(|of| of.cannot_tell).map(|of| &of.group).collect();
        if (1..loads.len()).contains(&light.len()) {
            let labels = quoted(light, ", ");
            printer.warning(format!("too light to tell anything: {labels}"));
        }
        for of in &loads {
            if let Some(degrees) = of.turned_deg {
                printer.warning(format!(
                    "`{}`: the force is {degrees:.0}° from the stated direction, and of the stated size",
                    of.group
                ));
            }
        }
        let document = document! {
            passes: gate.passes(),
            axes: axes.columns(),
            loads: &loads,
            failures: gate.failures().iter().map(ToString::to_string).collect::<Vec<_>>(),
        };
        printer.finish(&document, |printer| {
            print(printer, &loads, axes);
            printer.line(verdict)
        })?;
        Ok(outcome)
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
