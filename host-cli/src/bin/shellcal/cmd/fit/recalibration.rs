//! `shellcal fit --from`: update of a calibration with a few new loads.

use std::path::Path;

use calibration::quality::significant;
use calibration::recalibration::{Change, ChangedQuantity, Recalibration};
use calibration_file::{Origin, Role, SourceFile};
use log_file::{ReadOptions, checksum};
use serde::Serialize;
use shell_data::wrench::{Axes, Axis, PerAxis};
use shellcal::workflow::fit::log_sources;
use shellcal::workflow::recalibration::{Recalibrated, recalibrate};

use super::super::plan::read_table;
use super::super::quality::in_line;
use super::FitArgs;
use crate::files::InputPath;
use crate::printer::{Outcome, Printer};

fn change(of: &Change) -> impl Serialize {
    document! {
        zeros: of.channels.iter().map(|channel| channel.zero).collect::<Vec<_>>(),
        gains: of.channels.iter().map(|channel| channel.gain).collect::<Vec<_>>(),
        of.{lever_m, turn_rad},
    }
}

impl FitArgs {
    pub(super) fn recalibrate(
        &self,
        path: &InputPath,
        printer: &Printer,
    ) -> anyhow::Result<Outcome> {
        let before = self.edited.read(path)?;
        let from = Some((path, &before));
        let logs = self.mapping.open(&self.train, &self.companions.wrench_from, from, printer)?;
        let table = self.loads.as_ref().map(read_table).transpose()?;
        let excluded = &self.mapping.exclude_group;
        let table = table.map(|table| table.without(excluded));
        let output = printer.create(self.output.as_ref())?;
        let read = ReadOptions { checksum: self.keeps(), ..self.mapping.read_options() };
        let recalibrated = recalibrate(&before, &logs, table.as_ref(), &read)?;
        let mut outcome = printer.judge(&recalibrated.gate);
        let is_contradicted = recalibrated.found.is_contradicted();
        if is_contradicted {
            outcome = printer.decide(false);
        }
        // The old calibration has smaller errors than one fitted to contradictory loads.
        if let Some(output) = output.filter(|_| !is_contradicted) {
            let was = SourceFile {
                role: Role::Calibration,
                path: path.to_path_buf(),
                checksum: Some(checksum::of(&std::fs::read(path)?)),
                digest: None,
                rows: before.origin.diagnostics.as_ref().map_or(0, |of| of.rows),
            };
            let read = &recalibrated.rows.logs;
            let rows: Vec<u64> = read.iter().map(|log| log.summary.rows).collect();
            let mut sources = log_sources(Role::Train, &logs, read, &rows)?;
            sources.insert(0, was);
            let origin = Origin { sources, ..self.origin(&logs)? };
            output.commit_with(recalibrated.file(&before, origin).to_json().as_bytes())?;
        }
        report(printer, path, &recalibrated)?;
        Ok(outcome)
    }
}

fn report(printer: &Printer, path: &Path, of: &Recalibrated) -> anyhow::Result<()> {
    let (found, axes) = (&of.found, of.found.calibration.axes);
    let name = path.display().to_string();
    let text = lines(&name, of);
    if printer.json() {
        return printer.document(&document! {
            text,
            loads: of.loads,
            rows: of.rows.rows(),
            // The parts that have changed: some of `zeros`, `gains`, `lever` and `turn`.
            changed: found.quantities.iter().map(|of| of.name()).collect::<Vec<_>>(),
            // Logarithm of the factor by which the change makes the loads more probable, and the RMS of the
            // differences before and after the change, in stated errors.
            found.{ln_evidence, disagreement},
            change: change(&found.change),
            standard_errors: change(&found.standard_errors),
            contradicted: found.is_contradicted(),
            axes: axes.columns(),
            // RMS errors on the new loads, N and N·m.
            rms_before: axes.of(&found.before),
            rms_after: axes.of(&found.after),
            // RMS errors on held-out loads.
            rms_held_out?: found.held_out.map(|of| axes.of(&of.map(|axis| axis.rms))),
        });
    }
    text.iter().for_each(|line| printer.line(line));
    printer.line("");
    if !found.quantities.is_empty() {
        print_change(printer, found);
    }
    print_errors(printer, found, axes);
    if found.is_worse_held_out() {
        printer.warning(format!(
            "not written: `{name}` has smaller errors on held-out loads; find the wrong load, or hang more"
        ));
    } else if found.is_contradicted() {
        printer.warning(format!(
            "the loads contradict `{name}` by {} stated errors; not written: find the wrong load, or fit anew",
            significant(found.disagreement[1], 2),
        ));
    }
    if !found.quantities.is_empty() {
        printer.note(
            "it has no 95 % intervals: those of `convert` come from many loads that were held out",
        );
    }
    Ok(())
}

fn lines(name: &str, of: &Recalibrated) -> Vec<String> {
    let (found, loads) = (&of.found, of.loads);
    let [before, after] = found.disagreement.map(|x| significant(x, 2));
    if found.quantities.is_empty() {
        return vec![format!(
            "unchanged: `{name}` explains the {loads} loads as well as any change of zeros, gains, lever or turn \
             (differences of {before} stated errors)"
        )];
    }
    let names: Vec<&str> = found.quantities.iter().map(|of| of.name()).collect();
    let mut said = vec![format!(
        "changed: {} (differences of {before} stated errors before, {after} after; ln evidence {})",
        names.join(", "),
        significant(found.ln_evidence, 3),
    )];
    said.extend(found.held_out.map(|errors| {
        let errors = in_line(found.calibration.axes, &errors.map(|axis| axis.rms), true);
        format!("error on loads that were held out: {errors}")
    }));
    said
}

fn print_change(printer: &Printer, found: &Recalibration) {
    let (change, errors) = (&found.change, &found.standard_errors);
    let is_in = |of: ChangedQuantity| found.quantities.contains(&of);
    let with_error = |scale: f64, value: f64, error: f64| {
        format!("{:+.2} ± {:.2}", scale * value, scale * error)
    };
    let of_channels = [(ChangedQuantity::Zero, "zero, counts"), (ChangedQuantity::Gain, "gain, %")];
    let of_channels: Vec<_> = of_channels.into_iter().filter(|(of, _)| is_in(*of)).collect();
    if !of_channels.is_empty() {
        let header: Vec<&str> =
            ["channel"].into_iter().chain(of_channels.iter().map(|(_, name)| *name)).collect();
        let pairs = change.channels.iter().zip(&errors.channels).enumerate();
        let rows = pairs.map(|(channel, (of, error))| {
            let cell = |(quantity, _): &(ChangedQuantity, &str)| match quantity {
                ChangedQuantity::Zero => with_error(1.0, of.zero, error.zero),
                _ => with_error(100.0, of.gain, error.gain),
            };
            let cells = of_channels.iter().map(cell);
            [format!("s{}", channel + 1)].into_iter().chain(cells).collect()
        });
        printer.table(&header, rows);
    }
    let vector = |scale: f64, value: [f64; 3], error: [f64; 3]| {
        let axes = ["x", "y", "z"].into_iter().zip(value.into_iter().zip(error));
        let part = |(axis, (value, error))| format!("{axis} {}", with_error(scale, value, error));
        axes.map(part).collect::<Vec<_>>().join(", ")
    };
    if is_in(ChangedQuantity::Lever) {
        let lever = vector(1e3, change.lever_m, errors.lever_m);
        printer.line(format!("lever: the calibrated origin lies at {lever} mm"));
    }
    if is_in(ChangedQuantity::Turn) {
        let degrees = 1_f64.to_degrees();
        let turn = vector(degrees, change.turn_rad, errors.turn_rad);
        printer.line(format!("turn of the calibrated axes: {turn} °"));
    }
}

fn print_errors(printer: &Printer, found: &Recalibration, axes: Axes) {
    let mut header = vec!["axis", "RMS before", "RMS after"];
    header.extend(found.held_out.map(|_| "RMS held out"));
    header.push("unit");
    let row = |axis: Axis| {
        let of = |values: &PerAxis<f64>| significant(values[axis.index()], 3);
        let mut row = vec![axis.name().to_owned(), of(&found.before), of(&found.after)];
        row.extend(found.held_out.map(|held| significant(held[axis.index()].rms, 3)));
        row.push(axis.unit().to_owned());
        row
    };
    printer.table(&header, axes.iter().map(row))
}
