//! Outputs of commands besides results: figures, and the date and command line that made them.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::Context;
use figures::{Figure, Format, Size};
use output_file::AtomicFile;
use table_file::iso_of_seconds;

use super::choices::one_of;
use crate::files::{InputPath, OutputPath};
use crate::printer::Printer;

/// Permission to replace files, for commands that write them as data arrive.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct ReplacingArgs {
    /// Replace existing files
    #[arg(long)]
    pub(super) overwrite: bool,
}

#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct FigureSize {
    /// Width of the figure: screen, or single or double for columns of a paper (89 and 183 mm, letters of 5
    /// to 7 pt)
    #[arg(long, value_name = "WIDTH", value_parser = one_of(&SIZES), default_value = "screen", hide_possible_values = true)]
    pub(super) size: Size,
}

/// A calibration that a command writes.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct CalibrationOutput {
    /// Write the calibration (JSON)
    #[arg(long, short, value_name = "CAL.json")]
    pub(super) output: Option<OutputPath>,

    /// Serial number or label of the sensor, for the calibration file
    #[arg(long, value_name = "SERIAL")]
    pub(super) serial: Option<String>,
}

/// A figure of the results of a command.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct FigureArgs {
    /// Draw the results, to .svg, .pdf or .png
    #[arg(long, value_name = "FILE")]
    pub(super) plot: Option<OutputPath>,

    #[command(flatten)]
    pub(super) figure_size: FigureSize,
}

impl FigureArgs {
    pub(super) fn create(&self, printer: &Printer) -> anyhow::Result<Option<FigureFile>> {
        self.plot.as_ref().map(|path| self.figure_size.open(path, printer)).transpose()
    }

    /// As `create`, for a figure of one log.
    pub(super) fn create_of_one(
        &self,
        logs: &[InputPath],
        printer: &Printer,
    ) -> anyhow::Result<Option<FigureFile>> {
        let count = logs.len();
        anyhow::ensure!(
            self.plot.is_none() || count == 1,
            "`--plot` draws one log, `{count}` were given"
        );
        self.create(printer)
    }
}

const SIZES: [(&str, &str, Size); 3] = [
    ("screen", "As wide as its content suits", Size::Screen),
    ("single", "A column of a paper, 89 mm", Size::Single),
    ("double", "Two columns, 183 mm", Size::Double),
];

pub(super) struct FigureFile {
    file: AtomicFile,
    format: Format,
    size: Size,
}

impl FigureFile {
    pub(super) fn draw(self, draw: impl FnOnce(Size) -> Figure) -> anyhow::Result<()> {
        Ok(self.file.commit_with(&draw(self.size).render(self.format)?)?)
    }
}

impl FigureSize {
    pub(super) fn open(self, path: &Path, printer: &Printer) -> anyhow::Result<FigureFile> {
        let format = Format::from_path(path)?;
        Ok(FigureFile { file: printer.files.create(path)?, format, size: self.size })
    }
}

/// The last second with a four-digit year, the limit of RFC 3339: 9999-12-31T23:59:59Z.
const LAST_SECOND: u64 = 253_402_300_799;

/// The time in UTC, RFC 3339 to the second; the value of `SOURCE_DATE_EPOCH` if it is set, so that results
/// can be reproduced byte for byte (reproducible-builds.org).
pub(in crate::cmd) fn date() -> anyhow::Result<String> {
    let seconds = match std::env::var("SOURCE_DATE_EPOCH") {
        Ok(text) => {
            let seconds = text.parse().ok().filter(|&seconds| seconds <= LAST_SECOND);
            seconds.with_context(|| {
                format!(
                    "`SOURCE_DATE_EPOCH` is `{text}`, expected seconds since 1970, at most \
                     {LAST_SECOND}"
                )
            })?
        }
        Err(_) => SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs(),
    };
    Ok(iso_of_seconds(seconds))
}

pub(in crate::cmd) fn command_line() -> String {
    let quoted = |word: String| {
        let is_plain = |c: char| c.is_alphanumeric() || "_-./:=,+@%".contains(c);
        match !word.is_empty() && word.chars().all(is_plain) {
            true => word,
            false => format!("'{}'", word.replace('\'', r"'\''")),
        }
    };
    let words = std::env::args_os().skip(1).map(|word| quoted(word.to_string_lossy().into_owned()));
    ["shellcal".to_owned()].into_iter().chain(words).collect::<Vec<_>>().join(" ")
}
