//! Where a result is written: a file, or the standard output.

use std::io::{self, Write};

use calibration_file::PartialFit;
use output_file::AtomicFile;

use crate::files::{OutputOrStdout, OutputPath};
use crate::printer::Printer;

/// A destination that is open before the work begins.
pub(super) enum OpenOutput {
    File(AtomicFile),
    Stdout,
}

impl OpenOutput {
    pub(super) fn open(path: &OutputOrStdout, printer: &Printer) -> anyhow::Result<Self> {
        if !path.is_stdout() {
            return Ok(Self::File(printer.files.create(path)?));
        }
        anyhow::ensure!(
            !printer.json(),
            "`--partial -` writes the partial fit to the standard output: leave out `--json`"
        );
        Ok(Self::Stdout)
    }

    /// The file at `path`, or without one the standard output.
    pub(super) fn create(path: Option<&OutputPath>, printer: &Printer) -> anyhow::Result<Self> {
        Ok(printer.create(path)?.map_or(Self::Stdout, Self::File))
    }

    /// The same for rows, which `--json` would mix with its document.
    pub(super) fn for_rows(path: Option<&OutputPath>, printer: &Printer) -> anyhow::Result<Self> {
        anyhow::ensure!(
            path.is_some() || !printer.json(),
            "`--json` needs `--output`: standard output has the rows"
        );
        Self::create(path, printer)
    }

    pub(super) fn write(mut self, partial: &PartialFit) -> anyhow::Result<()> {
        self.write_all(partial.to_json().as_bytes())?;
        self.finish()
    }

    /// Puts the file in its place; all of it has been written.
    pub(super) fn finish(mut self) -> anyhow::Result<()> {
        match self {
            Self::File(file) => file.commit()?,
            Self::Stdout => self.flush()?,
        }
        Ok(())
    }
}

impl Write for OpenOutput {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.write(bytes),
            Self::Stdout => io::stdout().write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::File(file) => file.flush(),
            Self::Stdout => io::stdout().flush(),
        }
    }
}
