//! The figure of a command: its width, and the file that it goes to.

use std::path::Path;

use figures::{Figure, Format, Size};
use output_file::AtomicFile;

use super::choices::one_of;
use crate::files::OutputPath;
use crate::printer::Printer;

#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct FigureSize {
    /// How wide the figure is: screen, or single or double for columns of a paper (89 and 183 mm, letters of 5
    /// to 7 pt)
    #[arg(long, value_name = "WIDTH", value_parser = one_of(&SIZES), default_value = "screen", hide_possible_values = true)]
    pub(super) size: Size,
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
    size: Size,
}

impl FigureFile {
    /// Writes what `draw` makes for a width.
    pub(super) fn draw(self, draw: impl FnOnce(Size) -> Figure) -> anyhow::Result<()> {
        Ok(self.file.commit_with(&draw(self.size).render(self.format)?)?)
    }
}

impl FigureSize {
    /// The same, if a figure is to be drawn.
    pub(super) fn create(
        self,
        path: Option<&OutputPath>,
        printer: &Printer,
    ) -> anyhow::Result<Option<FigureFile>> {
        path.map(|path| self.open(path, printer)).transpose()
    }

    /// Opens the file of a figure; its name says the format.
    pub(super) fn open(self, path: &Path, printer: &Printer) -> anyhow::Result<FigureFile> {
        let format = Format::from_path(path)?;
        Ok(FigureFile { file: printer.files.create(path)?, format, size: self.size })
    }
}
