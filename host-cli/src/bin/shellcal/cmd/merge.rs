//! `shellcal merge`: a calibration from partial fits.

use std::io;

use anyhow::Context;
use calibration::fit::{
    CovarianceRule, Fit, FitOptions, HeldOut, ModelRule, RANDOM_FOLDS, contradicting_sums,
};
use calibration::quality::significant;
use calibration_file::{CalibrationFile, CalibrationFileError, PartialFit, Sums};
use shell_data::by_axis::Among;
use shell_data::hint::quoted;
use shellcal::workflow::partial::{fit_merged, merged_file};

use super::choices::{self, COVARIANCES, one_of};
use super::mapping::EditedArg;
use super::outputs::{self, CalibrationOutput};
use super::quality::{print_cross_validation, print_errors, print_selection};
use crate::files::{InputPath, OutputPath, is_standard};
use crate::printer::Printer;
use crate::tables::counted;

#[derive(Debug, clap::Args)]
pub(crate) struct MergeArgs {
    /// Partial fits; `-` reads any number of them, one after the other, from the standard input
    #[arg(required = true, value_name = "PARTIAL")]
    partials: Vec<InputPath>,

    #[command(flatten)]
    written: CalibrationOutput,

    /// Write the merged sums as one partial fit, and fit nothing (`-` for the standard output)
    #[arg(long, value_name = "FILE.json",
        conflicts_with_all = ["output", "ridge", "model", "cv", "covariance"])]
    partial: Option<OutputPath>,

    /// Leave out partial fits whose files have all been counted already, and report them; for queues that
    /// deliver twice
    #[arg(long)]
    skip_counted: bool,

    /// Features of the readings: those that were summed, some of them, or `auto` for the smallest model among
    /// them that predicts new groups as well as the best [default: those that were summed]
    #[arg(long, value_name = "MODEL", value_parser = choices::model())]
    model: Option<ModelRule>,

    /// Cross-validate over groups of rows, for partial fits with `--groups`; a number K assigns the groups to
    /// K folds
    #[arg(long, value_name = "K", num_args = 0..=1, require_equals = true, default_missing_value = "auto",
        value_parser = parse_folds)]
    cv: Option<HeldOut>,

    /// Penalise large coefficients: λ, relative to features of norm one, such as 1e-6
    #[arg(long, value_name = "LAMBDA", default_value_t = 0.0, hide_default_value = true)]
    ridge: f64,

    /// Rows with independent errors, for the standard errors and intervals of `convert`
    #[arg(long, value_name = "OF", value_parser = one_of(&COVARIANCES), default_value = "auto")]
    covariance: CovarianceRule,

    #[command(flatten)]
    edited: EditedArg,
}

/// Parses the number of folds of groups; `auto` holds out each group alone.
fn parse_folds(text: &str) -> Result<HeldOut, &'static str> {
    match text.parse() {
        _ if text == "auto" => Ok(HeldOut::from(None)),
        Ok(folds @ 2..) => Ok(HeldOut::from(Some(folds))),
        _ => Err("expected a number of folds from 2 up; what a group is, the partial fits say"),
    }
}

/// Most partial fits whose sums are kept for comparison with each other. Any number is merged in constant memory.
const MOST_COMPARED: usize = 100;

struct Merged {
    sum: PartialFit,
    read: usize,
    skipped: usize,
    /// Descriptions of the partial fits that contradict the others.
    contradictions: Vec<String>,
}

impl MergeArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let output = printer.create(self.written.output.as_ref())?;
        let partial = self.partial.as_ref();
        let destination = partial.map(|path| printer.create_or_stdout(Some(path)));
        let destination = destination.transpose()?;
        let merged = self.merged(printer)?;
        let sum = &merged.sum;
        if let Some(destination) = destination {
            let to_stdout = partial.is_some_and(|path| is_standard(path));
            destination.commit_with(sum.to_json().as_bytes())?;
            return self.report(printer, &merged, None, to_stdout);
        }
        anyhow::ensure!(
            self.model != Some(ModelRule::Physics),
            "`physics` is fitted to rows, and partial fits have none"
        );
        let options = FitOptions {
            ridge: self.ridge,
            cross_validation: self.cv,
            covariance: self.covariance,
            ..FitOptions::default()
        };
        let fitted = fit_merged(sum, self.model, &options)?;
        self.warn(&fitted, matches!(sum.sums, Sums::Exact(_)), printer);
        let file = merged_file(&fitted, sum);
        output.map(|output| output.commit_with(file.to_json().as_bytes())).transpose()?;
        self.report(printer, &merged, Some(&file), false)
    }

    fn read(
        &self,
        path: &InputPath,
    ) -> Box<dyn Iterator<Item = Result<PartialFit, CalibrationFileError>> + '_> {
        match is_standard(path) {
            true => Box::new(self.edited.partials(io::stdin().lock(), path)),
            false => Box::new(std::iter::once(self.edited.partial(path))),
        }
    }

    fn merged(&self, printer: &Printer) -> anyhow::Result<Merged> {
        let (mut sum, mut read, mut skipped) = (None::<PartialFit>, 0, 0);
        let mut parts: Vec<(String, Sums)> = Vec::new();
        let partials = self.partials.iter();
        for (path, partial) in partials.flat_map(|path| self.read(path).map(move |of| (path, of))) {
            let partial = partial?;
            read += 1;
            let name = match is_standard(path) {
                true => format!("`-`, partial fit {read}"),
                false => format!("`{}`", path.display()),
            };
            let part = (name.clone(), partial.sums.clone());
            match &mut sum {
                None => sum = Some(partial),
                Some(sum) if self.skip_counted && sum.has_counted_all_of(&partial) => {
                    skipped += 1;
                    let files =
                        quoted(partial.sources.iter().map(|file| file.path.display()), ", ");
                    printer.note(format!("{name}: left out, {files} has been counted already"));
                    continue;
                }
                Some(sum) => sum.merge(&partial).context(name)?,
            }
            if parts.len() < MOST_COMPARED {
                parts.push(part);
            }
        }
        let mut sum = sum.context("no partial fits were given")?;
        sum.put_in_order();
        sum.made_by = shellcal::PROGRAM.to_owned();
        sum.date = outputs::date()?;
        let known = sum.sensor_serial.as_ref().filter(|_| self.written.serial.is_some());
        if let Some(serial) = known.filter(|known| Some(*known) != self.written.serial.as_ref()) {
            anyhow::bail!("the partial fits are of the sensor `{serial}`: leave out `--serial`");
        }
        sum.sensor_serial = sum.sensor_serial.take().or_else(|| self.written.serial.clone());
        // Errors of the merged fit are reported by the fit itself.
        let found = contradicting_sums(&parts, (&sum.model, self.ridge), sum.axes);
        let contradictions = found.unwrap_or_default();
        if read - skipped > parts.len() {
            let (compared, all) = (parts.len(), read - skipped);
            printer.note(format!(
                "compared only the first {compared} of {all} partial fits with each other"
            ));
        }
        contradictions.iter().for_each(|of| printer.warning(of.clone()));
        Ok(Merged { sum, read, skipped, contradictions })
    }

    fn warn(&self, fitted: &Fit, is_exact: bool, printer: &Printer) {
        fitted.warnings.iter().for_each(|warning| printer.warning(warning.to_string()));
        if fitted.selection.is_some() {
            printer
                .note("physics was not weighed: it is fitted to rows, and partial fits have none");
        }
        match is_exact {
            _ if fitted.cross_validation.as_ref().is_none_or(|cv| cv.random_folds > 0) => {}
            false => printer.note(
                "no random split: rows that cannot be summed exactly are not assigned at random",
            ),
            true => printer.note(format!(
                "no random split: partial fits have one in {RANDOM_FOLDS} folds, for `--cv` and \
                 `--cv={RANDOM_FOLDS}`"
            )),
        }
    }

    fn report(
        &self,
        printer: &Printer,
        merged: &Merged,
        file: Option<&CalibrationFile>,
        to_stderr: bool,
    ) -> anyhow::Result<()> {
        let sum = &merged.sum;
        let (rows, files, axes) = (sum.sums.rows(), sum.sources.len(), sum.axes);
        let groups = sum.groups.as_ref().map(|groups| groups.groups.len());
        let fit = file.and_then(|file| file.origin.diagnostics.as_ref());
        let name = file.map_or_else(|| sum.model.name(), |file| file.calibration.name());
        if printer.json() {
            return printer.document(&document! {
                model: name,
                partial_fits: merged.read,
                contradictions: &merged.contradictions,
                skipped_partial_fits?: (merged.skipped > 0).then_some(merged.skipped),
                files, rows,
                sum.{skipped_rows, repeated_rows},
                groups?: groups,
                condition?: fit.and_then(|fit| fit.condition),
                axes: axes.columns(),
                train?: fit.map(|fit| axes.of(&fit.train)),
                cross_validation?: fit
                    .and_then(|fit| fit.cross_validation.as_ref())
                    .map(|of| Among(axes, of)),
                selection?: fit.and_then(|fit| fit.selection.as_ref()).map(|of| Among(axes, of)),
            });
        }
        let mut summary = format!("{name}: {rows} rows of {}", counted(files, "file"));
        if let Some(groups) = groups {
            summary += &format!(" in {groups} groups");
        }
        let Some(fit) = fit else {
            if to_stderr {
                printer.note(summary)
            } else {
                printer.line(summary)
            }
            return Ok(());
        };
        if let Some(selection) = &fit.selection {
            print_selection(printer, selection, None, axes);
        }
        print_errors(printer, fit, axes);
        let condition = fit.condition.map_or("infinite".into(), |c| significant(c, 3));
        summary += &format!(", rank {}, condition {condition}", fit.rank);
        printer.line(summary);
        if let Some(cross_validation) = &fit.cross_validation {
            print_cross_validation(printer, cross_validation, axes);
        }
        Ok(())
    }
}
