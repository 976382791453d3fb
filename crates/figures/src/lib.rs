//! Figures: from data to a finished picture, as SVG text, PDF or PNG bytes.
//!
//! Data are added block by block to accumulators of fixed size ([`FitPlot`], [`WrenchTrace`]): ten
//! million rows take no more memory than ten thousand. Their content does not depend on the blocks
//! or the order of merging. The drawing is deterministic to the byte.
//!
//! This crate draws the figures of this program and accesses no files. Text in the SVG stays text
//! (DejaVu Sans or another sans-serif); PDF and PNG have the font built in.

mod axes;
mod canvas;
mod chart;
mod coverage;
mod density;
mod fit;
mod histogram;
mod lettering;
mod matching;
mod palette;
mod pdf;
mod pixels;
mod svg;
mod trace;
pub mod trial;

use std::path::{Path, PathBuf};

pub use axes::{PlotAxis, Spacing};
pub use canvas::{Figure, Size};
pub use chart::{ChannelCurve, Chart, ChartMark, Series, channel_figure};
pub use coverage::coverage_figure;
pub use fit::{FitPlot, RowsName, fit_figure};
pub use matching::match_figure;
pub use trace::{WrenchTrace, trace_figure};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Scalable: for print.
    Svg,
    /// Scalable, with embedded fonts: for LaTeX and Word.
    Pdf,
    /// Pixels, two per CSS pixel: for slides and messages.
    Png,
}

#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    #[error("cannot tell the picture format of `{}`: expected `.svg`, `.pdf` or `.png`", .0.display())]
    UnknownFormat(PathBuf),
    #[error("cannot render the picture: {0}")]
    Render(String),
}

impl Format {
    /// The format named by the extension of `path`, in upper or lower case.
    ///
    /// # Errors
    /// [`PlotError::UnknownFormat`] if it is not `svg`, `pdf` or `png`.
    pub fn from_path(path: impl AsRef<Path>) -> Result<Self, PlotError> {
        let path = path.as_ref();
        match path.extension() {
            Some(extension) if extension.eq_ignore_ascii_case("svg") => Ok(Self::Svg),
            Some(extension) if extension.eq_ignore_ascii_case("pdf") => Ok(Self::Pdf),
            Some(extension) if extension.eq_ignore_ascii_case("png") => Ok(Self::Png),
            _ => Err(PlotError::UnknownFormat(path.to_owned())),
        }
    }
}

impl Figure {
    /// The picture as the content of a file.
    ///
    /// # Errors
    /// [`PlotError::Render`] if the picture is too large to be drawn as pixels.
    pub fn render(&self, format: Format) -> Result<Vec<u8>, PlotError> {
        match format {
            Format::Svg => Ok(self.svg().into_bytes()),
            Format::Pdf => Ok(pdf::pdf(self)),
            Format::Png => pixels::png(self).map_err(PlotError::Render),
        }
    }
}

pub fn decompressed(asset: &[u8]) -> Vec<u8> {
    zrip::decompress(asset).expect("an asset of the program is as it was put there")
}

#[cfg(test)]
mod tests {
    use tiny_skia::Pixmap;

    use super::canvas::Style;
    use super::*;

    fn ink(text: &str) -> usize {
        let mut canvas = Figure::new(Size::Screen, 200.0, 40.0);
        canvas.text((100.0, 25.0), text, Style::TITLE);
        let png = canvas.render(Format::Png).unwrap();
        let pixels = Pixmap::decode_png(&png).unwrap();
        assert_eq!((pixels.width(), pixels.height()), (400, 80));
        pixels.pixels().iter().filter(|pixel| pixel.red() < 128).count()
    }

    #[test]
    fn png_has_text_from_the_built_in_font_alone() {
        assert_eq!(ink(""), 0);
        for text in ["Fx", "N·m", "10⁻³", "μ ≤ −5 °", "é"] {
            assert!(ink(text) > 50, "{text}");
        }
    }

    #[test]
    fn the_extension_names_the_format() {
        assert_eq!(Format::from_path("fit.svg").unwrap(), Format::Svg);
        assert_eq!(Format::from_path("fit.pdf").unwrap(), Format::Pdf);
        assert_eq!(Format::from_path("a.b/FIT.PNG").unwrap(), Format::Png);
        let error = Format::from_path("fit.jpg").unwrap_err();
        let expected =
            "cannot tell the picture format of `fit.jpg`: expected `.svg`, `.pdf` or `.png`";
        assert_eq!(error.to_string(), expected);
        assert!(Format::from_path("svg").is_err());
    }
}
