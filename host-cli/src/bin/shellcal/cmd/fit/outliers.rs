//! What `shellcal fit` does about rows that do not belong.

use anyhow::Context;
use calibration::Basis;
use clap::ValueEnum;
use log_file::Log;
use output_file::Outputs;
use shellcal::workflow::outliers::{OutlierOptions, Outliers, Reason, find};

use super::super::choices::ModelArg;
use super::super::outliers::{warn, write};
use super::FitArgs;
use crate::printer::Printer;

/// What is done about rows that do not belong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum OutliersArg {
    /// Name them, with what they do to the fit, and use them
    Report,
    /// Leave them out, and list them in the file of `--dropped`
    Drop,
    /// Use them, and do not look
    Keep,
}

impl FitArgs {
    /// Whether rows that do not belong are to be named, as they are unless something else is asked for.
    pub(super) fn looks_for_outliers(&self) -> bool {
        // A mean is of no line.
        !self.means && matches!(self.outliers, None | Some(OutliersArg::Report))
    }

    /// Finds the rows that are to be left out, lists them and says so.
    pub(super) fn drop_rows(
        &self,
        train: &[Log],
        printer: &mut Printer,
        outputs: &Outputs,
    ) -> anyhow::Result<Outliers> {
        let drops = self.outliers == Some(OutliersArg::Drop);
        if !drops && self.valid_range.is_none() {
            anyhow::ensure!(
                self.dropped.is_none(),
                "`--dropped` lists the rows that `--outliers drop` or `--valid-range` leave out: give one"
            );
            return Ok(Outliers::default());
        }
        let path = self.dropped.as_ref().context(
            "rows are not left out without a list of them: name a file with `--dropped FILE.csv`",
        )?;
        let mut output = outputs.create(path)?;
        let mut found = find(train, &self.outlier_options())?;
        if !drops {
            found.rows.retain(|row| row.reason == Reason::OutOfRange);
        }
        write(&mut output, &found, train)?;
        output.commit()?;
        let (rows, path) = (found.rows.len(), path.display());
        warn(printer, &found, train);
        printer.note(format!("left out {rows} rows, listed in `{path}`"));
        Ok(found)
    }

    /// Looks for rows that do not belong, where some stand out, and names them.
    pub(super) fn name_outliers(&self, train: &[Log], printer: &mut Printer) -> Option<Outliers> {
        match find(train, &self.outlier_options()) {
            Ok(mut found) => {
                // Those outside the valid range have been left out.
                found.rows.retain(|row| row.reason != Reason::OutOfRange);
                warn(printer, &found, train);
                if !found.rows.is_empty() {
                    printer.note(
                        "`--outliers drop --dropped FILE.csv` fits without them, `--outliers keep` does \
                         not look",
                    );
                }
                Some(found)
            }
            Err(reason) => {
                printer.note(format!("some rows stand out, and were not looked at: {reason}"));
                None
            }
        }
    }

    fn outlier_options(&self) -> OutlierOptions<'static> {
        OutlierOptions {
            basis: match self.model {
                ModelArg::Given(basis) => basis,
                ModelArg::Auto | ModelArg::Physics => Basis::Cubic,
            },
            intercept: !self.no_intercept,
            ridge: self.ridge,
            fresh: self.fresh,
            valid_range: self.valid_range,
            read: self.mapping.read_options(),
        }
    }
}

/// `LO:HI`.
pub(super) fn parse_range(text: &str) -> Result<[f64; 2], String> {
    let ends =
        text.split_once(':').map(|(least, most)| (least.trim().parse(), most.trim().parse()));
    match ends {
        Some((Ok(least), Ok(most))) if least < most => Ok([least, most]),
        _ => Err("expected the least and the largest valid reading, such as 0:4095".to_owned()),
    }
}
