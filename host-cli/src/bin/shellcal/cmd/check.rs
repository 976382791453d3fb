//! Whether a calibration holds: `shellcal check` with known weights on the sensor, and `shellcal compare`, which of two
//! calibrations errs less.

use calibration::fit::{Better, PairedErrors, Workers, paired_errors};
use calibration::quality::significant;
use calibration_file::CalibrationFile;
use log_file::{Log, Wanted, read_logs};
use report::CheckedLoad;
use shell_data::hint::quoted;
use shell_data::wrench::{Axes, Axis};
use shellcal::workflow::check::check_weights;
use shellcal::workflow::check_channels;
use shellcal::workflow::remark::found_groups;

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
        let holds = checked.iter().all(|of| of.off.is_empty());
        let can_tell = !checked.iter().all(|of| of.cannot_tell);
        let passes = holds && can_tell;
        let verdict = match (holds, can_tell) {
            (true, true) => {
                "passes: every difference is within what errors of sensor and weights explain"
            }
            (true, false) => {
                "cannot tell: a weight of nothing would pass as well; hang heavier ones"
            }
            (false, _) => {
                "fails: the sensor has changed, or the weights are not what the table says"
            }
        };
        let light = checked.iter().filter(|of| of.cannot_tell).map(|of| &of.group);
        let light: Vec<&String> = light.collect();
        if can_tell && !light.is_empty() {
            let labels = quoted(light, ", ");
            printer.warning(format!("too light to tell anything: {labels}"));
        }
        for of in &checked {
            if let Some(degrees) = of.turned_deg {
                printer.warning(format!(
                    "`{}`: the force is {degrees:.0}° from the stated direction, and of the stated size",
                    of.group
                ));
            }
        }
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

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal compare monday.json tuesday.json --test poses.csv
  shellcal compare cubic.json physics.json --test test-*.csv --json")]
pub(crate) struct CompareArgs {
    /// One calibration
    #[arg(value_name = "A.json")]
    first: InputPath,

    /// Another
    #[arg(value_name = "B.json")]
    second: InputPath,

    /// Logs with readings and a measured wrench that neither was fitted to
    #[arg(long, required = true, num_args = 1.., value_name = "LOG")]
    test: Vec<InputPath>,

    #[command(flatten)]
    mapping: MappingArgs,
}

impl CompareArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let [first, second] = [&self.first, &self.second].map(|path| CalibrationFile::read(path));
        let (first, second) = (first?, second?);
        let mut logs = self.mapping.open(&self.test, &[], Some((&self.first, &first)), printer)?;
        let axes = first.calibration.axes.and(second.calibration.axes);
        anyhow::ensure!(!axes.is_empty(), "the calibrations have no axis in common");
        for log in &mut logs {
            check_channels(log, first.calibration.channels())?;
            check_channels(log, second.calibration.channels())?;
            log.require_axes(axes)?;
            log.keep_axes(axes)?;
        }
        let has_groups = logs.iter().all(Log::has_groups);
        let calibrations = [&first, &second].map(|of| &of.calibration);
        let by_time = calibrations.iter().any(|of| of.needs_time())
            || calibrations.iter().any(|of| of.lag.is_some()) && logs.iter().all(Log::has_time);
        let wanted = Wanted {
            readings: true,
            wrench: true,
            groups: has_groups,
            time: by_time || !has_groups && logs.len() == 1 && logs[0].has_time(),
            ..Wanted::default()
        };
        let data = read_logs(&logs, &wanted, &self.mapping.read_options())?;
        let workers = Workers::new(self.mapping.threads.map_or(0, usize::from));
        let found = paired_errors(calibrations, &data, workers)?;
        if let Some(groups) = found.group_by.found() {
            printer.remarks([found_groups(groups)]);
        }
        self.report(&found, axes, printer)
    }

    fn report(&self, found: &PairedErrors, axes: Axes, printer: &Printer) -> anyhow::Result<()> {
        if printer.json() {
            let compared = axes.iter().map(|axis| {
                let of = &found.axes[axis.index()];
                document! {
                    axis: axis.column(),
                    // Of both, N or N·m, and the first less the second.
                    of.{rms, difference},
                    // The 95 % interval of the difference.
                    interval_95: of.interval(),
                    better: match of.better() {
                        Better::First => Some("first"),
                        Better::Second => Some("second"),
                        Better::Neither => None,
                    },
                }
            });
            return printer.document(&document! {
                found.{rows, groups},
                axes: compared.collect::<Vec<_>>(),
            });
        }
        printer.line(format!(
            "A = `{}`, B = `{}`, on {} rows of {} {}",
            self.first.display(),
            self.second.display(),
            found.rows,
            found.groups,
            found.group_by.plural(),
        ));
        let of = |axis: &Axis| &found.axes[axis.index()];
        let digits = |value: f64| significant(value, 3);
        let better = |axis: &Axis| match of(axis).better() {
            Better::First => "A errs less",
            Better::Second => "B errs less",
            Better::Neither => "no significant difference",
        };
        let columns: [TableColumn<'_, Axis>; 7] = [
            ("axis", &|axis| axis.name().to_owned()),
            ("RMS A", &|axis| digits(of(axis).rms[0])),
            ("RMS B", &|axis| digits(of(axis).rms[1])),
            ("A − B", &|axis| digits(of(axis).difference)),
            ("95 % CI", &|axis| of(axis).interval().map(digits).join(" … ")),
            ("unit", &|axis| axis.unit().to_owned()),
            ("conclusion", &|axis| better(axis).to_owned()),
        ];
        printer.records(&columns, axes.iter());
        Ok(())
    }
}
