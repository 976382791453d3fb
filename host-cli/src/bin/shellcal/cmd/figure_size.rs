//! The figure of a command: its width, and the file that it goes to.

use std::io::Write;

use anyhow::Context;
use figures::{Figure, Format, Size};
use output_file::{AtomicFile, Outputs};

use super::choices::one_of;
use crate::files::OutputPath;

#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct FigureSize {
    /// How wide the figure is: screen, or single or double for columns of a paper (89 and 183 mm, letters of 5
    /// to 7 pt)
    #[arg(long, value_name = "WIDTH", value_parser = one_of(&SIZES), default_value = "screen", hide_possible_values = true)]
    size: Size,
}

/// Widths of figures.
const SIZES: [(&str, &str, Size); 3] = [
    ("screen", "As wide as its content suits", Size::Screen),
    ("single", "A column of a paper, 89 mm", Size::Single),
    ("double", "Two columns, 183 mm", Size::Double),
];

/// The file of a figure, which is open before the work begins.
pub(super) struct FigureFile {
    file: AtomicFile,
    format: Format,
    /// How wide the figure is.
    pub(super) size: Size,
}

impl FigureFile {
    pub(super) fn write(mut self, figure: &Figure) -> anyhow::Result<()> {
        let bytes = figure.render(self.format)?;
        self.file.write_all(&bytes).context("cannot write the picture")?;
        Ok(self.file.commit()?)
    }
}

impl FigureSize {
    /// Opens the file of a figure, if one is to be drawn; its name says the format.
    pub(super) fn create(
        self,
        path: Option<&OutputPath>,
        outputs: &Outputs,
    ) -> anyhow::Result<Option<FigureFile>> {
        let Some(path) = path else { return Ok(None) };
        let format = Format::from_path(path)?;
        Ok(Some(FigureFile { file: outputs.create(path)?, format, size: self.size() }))
    }

    pub(super) fn size(self) -> Size {
        self.size
    }
}
