//! The file formats of a finished picture.

use std::path::{Path, PathBuf};

use super::canvas::Figure;
use super::pdf;
use super::pixels;

/// A file format for pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Scalable: for print.
    Svg,
    /// Scalable, with its letters: for LaTeX and Word.
    Pdf,
    /// Pixels, two per CSS pixel: for slides and messages.
    Png,
}

/// A picture that cannot be made as asked.
#[derive(Debug, thiserror::Error)]
pub enum PlotError {
    /// The extension names no known format.
    #[error("cannot tell the picture format of `{}`: expected `.svg`, `.pdf` or `.png`", path.display())]
    UnknownFormat {
        /// The file that was to be written.
        path: PathBuf,
    },
    /// The renderer refused the picture.
    #[error("cannot render the picture: {reason}")]
    Render {
        /// What the renderer said.
        reason: String,
    },
}

impl Format {
    /// The format that the extension of `path` names, in upper or lower case.
    ///
    /// # Errors
    /// [`PlotError::UnknownFormat`] if it is none of `svg`, `pdf` and `png`.
    pub fn from_path(path: impl AsRef<Path>) -> Result<Self, PlotError> {
        let path = path.as_ref();
        match path.extension() {
            Some(extension) if extension.eq_ignore_ascii_case("svg") => Ok(Self::Svg),
            Some(extension) if extension.eq_ignore_ascii_case("pdf") => Ok(Self::Pdf),
            Some(extension) if extension.eq_ignore_ascii_case("png") => Ok(Self::Png),
            _ => Err(PlotError::UnknownFormat { path: path.to_owned() }),
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
            Format::Png => pixels::png(self).map_err(|reason| PlotError::Render { reason }),
        }
    }
}

#[cfg(test)]
mod tests {
    use tiny_skia::Pixmap;

    use super::super::canvas::Style;
    use super::super::size::Size;
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
