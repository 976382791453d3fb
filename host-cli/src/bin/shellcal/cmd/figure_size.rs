//! How wide figures are: an option of every command that draws for papers.

use figures::Size;

#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(super) struct FigureSize {
    /// How wide the figure is: screen, or single or double for columns of a paper (89 and 183 mm, letters of 5
    /// to 7 pt)
    #[arg(long, value_name = "WIDTH", value_enum, default_value_t = SizeArg::Screen, hide_possible_values = true)]
    size: SizeArg,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum SizeArg {
    /// As wide as its content suits
    #[default]
    Screen,
    /// A column of a paper, 89 mm
    Single,
    /// Two columns, 183 mm
    Double,
}

impl FigureSize {
    pub(super) fn size(self) -> Size {
        match self.size {
            SizeArg::Screen => Size::Screen,
            SizeArg::Single => Size::Single,
            SizeArg::Double => Size::Double,
        }
    }
}
