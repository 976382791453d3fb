//! `--edited`, of every command that uses a calibration or partial fits.

use std::io::BufRead;
use std::path::Path;

use calibration_file::{CalibrationFile, CalibrationFileError, PartialFit, PartialStream};

#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct EditedArg {
    /// Use a calibration or partial fit although it is not what `shellcal` wrote: its checksum is not verified
    #[arg(long)]
    edited: bool,
}

impl EditedArg {
    /// Reads a calibration file.
    pub(crate) fn read(self, path: &Path) -> Result<CalibrationFile, CalibrationFileError> {
        match self.edited {
            true => CalibrationFile::read_edited(path),
            false => CalibrationFile::read(path),
        }
    }

    /// Reads a partial fit.
    pub(crate) fn partial(self, path: &Path) -> Result<PartialFit, CalibrationFileError> {
        match self.edited {
            true => PartialFit::read_edited(path),
            false => PartialFit::read(path),
        }
    }

    /// The partial fits of a stream.
    pub(crate) fn partials<R: BufRead>(self, reader: R, name: &Path) -> PartialStream<R> {
        let partials = PartialStream::new(reader, name);
        if self.edited { partials.edited() } else { partials }
    }
}
