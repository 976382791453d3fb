//! Where a partial fit is written: a file, or the standard output.

use std::io::Write;

use calibration_file::PartialFit;
use output_file::{AtomicFile, Outputs};

use crate::files::OutputOrStdout;
use crate::printer::Printer;

/// A destination that is open before the work begins.
pub(super) enum Destination {
    File(AtomicFile),
    Stdout,
}

impl Destination {
    pub(super) fn open(
        path: &OutputOrStdout,
        printer: &Printer,
        outputs: &Outputs,
    ) -> anyhow::Result<Self> {
        if !path.is_stdout() {
            return Ok(Self::File(outputs.create(path)?));
        }
        anyhow::ensure!(
            !printer.json(),
            "`--partial -` writes the partial fit to the standard output: leave out `--json`"
        );
        Ok(Self::Stdout)
    }

    pub(super) fn write(self, partial: &PartialFit, printer: &Printer) -> anyhow::Result<()> {
        let document = partial.to_json();
        match self {
            Self::File(mut file) => {
                file.write_all(document.as_bytes())?;
                file.commit()?;
            }
            Self::Stdout => printer.stream().write_all(document.as_bytes())?,
        }
        Ok(())
    }
}
