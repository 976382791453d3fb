//! `shellcal eval --against`: the errors of two calibrations on the same logs.

use calibration::fit::{Better, PairedErrors, Workers, paired_errors};
use calibration::quality::significant;
use calibration_file::CalibrationFile;
use log_file::{Log, ReadOptions, Wanted, read_logs};
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, Axis};
use shellcal::workflow::check_channels;
use shellcal::workflow::gates::Gate;
use shellcal::workflow::remark::found_groups;

use super::mapping::MappingArgs;
use crate::files::InputPath;
use crate::printer::{Outcome, Printer, TableColumn};

/// Two calibrations with their paths, and the axes to compare, if they are named.
pub(super) struct ComparedCalibrations<'a> {
    pub(super) first: (&'a InputPath, &'a CalibrationFile),
    pub(super) second: (&'a InputPath, &'a CalibrationFile),
    pub(super) named: Option<Axes>,
}

impl ComparedCalibrations<'_> {
    /// Compares both calibrations on the logs, with a warning for each log that one of them was fitted to.
    pub(super) fn run(
        &self,
        mut logs: Vec<Log>,
        mapping: &MappingArgs,
        printer: &Printer,
    ) -> anyhow::Result<Outcome> {
        let ((first_path, first), (second_path, second)) = (self.first, self.second);
        let of = [first, second].map(|of| of.calibration.axes);
        let asked = self.named.unwrap_or_else(|| of[0].iter().chain(of[1].iter()).collect());
        let axes = asked.and(of[0]).and(of[1]);
        anyhow::ensure!(!axes.is_empty(), "the calibrations have none of the axes in common");
        for log in &mut logs {
            check_channels(log, first.calibration.channels())?;
            check_channels(log, second.calibration.channels())?;
            log.require_axes(axes)?;
            log.keep_axes(axes)?;
        }
        let has_groups = logs.iter().all(Log::has_groups);
        let calibrations = [first, second].map(|of| &of.calibration);
        let by_time = calibrations.iter().any(|of| of.needs_time())
            || calibrations.iter().any(|of| of.lag.is_some()) && logs.iter().all(Log::has_time);
        let wanted = Wanted {
            readings: true,
            wrench: true,
            groups: has_groups,
            time: by_time || !has_groups && logs.len() == 1 && logs[0].has_time(),
            ..Wanted::default()
        };
        let read = ReadOptions { checksum: true, ..mapping.read_options() };
        let data = read_logs(&logs, &wanted, &read)?;
        let trained_on = self.trained_on(&data);
        for (path, log) in &trained_on {
            printer.warning(format!(
                "`{log}` was used for the fit of `{path}`, which errs less there than on new loads: \
                 compare on other logs"
            ));
        }
        let workers = Workers::new(mapping.threads.map_or(0, usize::from));
        let mut gate = Gate::default();
        for log in &data.logs {
            let name = format!("`{}`", log.name.display());
            let subject = gate.ask(&name, asked);
            for (path, given) in [first_path, second_path].into_iter().zip(of) {
                let path = path.display();
                subject.lacks(asked.without(given), |axes| {
                    format!("{axes}, which `{path}` does not give")
                });
            }
            subject.has_rows(log.rows(), log.rows() + log.summary.skipped_rows);
            subject.hold();
        }
        let outcome = printer.judge(&gate);
        let found = paired_errors(calibrations, &data, workers)?;
        if let Some(groups) = found.group_by.found() {
            printer.remarks([found_groups(groups)]);
        }
        self.report(&found, axes, &trained_on, printer)?;
        Ok(outcome)
    }

    /// Pairs: the path of a calibration, and a log that it was fitted to.
    fn trained_on(&self, data: &Dataset) -> Vec<(String, String)> {
        let of = |(path, file): (&InputPath, &CalibrationFile)| {
            let path = path.display().to_string();
            let sources = file.origin.sources.clone();
            let logs = data.logs.iter().filter(move |log| {
                sources.iter().any(|of| of.is_training_log(log.summary.checksum.as_deref()))
            });
            logs.map(move |log| (path.clone(), log.name.display().to_string()))
        };
        of(self.first).chain(of(self.second)).collect()
    }

    fn report(
        &self,
        found: &PairedErrors,
        axes: Axes,
        trained_on: &[(String, String)],
        printer: &Printer,
    ) -> anyhow::Result<()> {
        if printer.json() {
            let compared = axes.iter().map(|axis| {
                let of = &found.axes[axis.index()];
                document! {
                    axis: axis.column(),
                    // RMS of both, N or N·m, and the first minus the second.
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
                // Pairs of a calibration and a log that it was fitted to.
                trained_on,
            });
        }
        printer.line(format!(
            "A = `{}`, B = `{}`, on {} rows of {} {}",
            self.first.0.display(),
            self.second.0.display(),
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
