//! How wide a figure is: on a screen, or in a column of a paper.
//!
//! Widths and sizes of letters for print are those of Nature (research-figure-guide.nature.com, "Building
//! and exporting figure panels": 89 and 183 mm, text from 5 to 7 pt), which suit most journals. A figure for
//! print is laid out anew for its width: made smaller as a whole, its letters would be too small to read.

/// Points, and CSS pixels, to the inch, and mm.
const POINTS: f64 = 72.0;
pub(super) const PIXELS: f64 = 96.0;
const MM: f64 = 25.4;

/// The largest letters in a drawing (titles) and on paper, and the smallest on paper: drawing units, pt, pt.
const LARGEST: f64 = 13.0;
const LARGEST_PT: f64 = 7.0;
const LEAST_PT: f64 = 5.0;

/// Pixels of a PNG to the inch on paper.
const PRINT_DPI: f64 = 600.0;

/// Pixels of a PNG to a CSS pixel on a screen.
const SCREEN_PIXELS: f64 = 2.0;

/// How wide a figure is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Size {
    /// As wide as its content suits, in CSS pixels.
    #[default]
    Screen,
    /// A column of a paper.
    Single,
    /// Two columns.
    Double,
}

impl Size {
    /// Its width on paper, mm.
    pub(super) fn width_mm(self) -> Option<f64> {
        match self {
            Self::Screen => None,
            Self::Single => Some(89.0),
            Self::Double => Some(183.0),
        }
    }

    /// CSS pixels to a unit of the drawing.
    pub(super) fn scale(self) -> f64 {
        if self == Self::Screen { 1.0 } else { LARGEST_PT / LARGEST * PIXELS / POINTS }
    }

    /// The width of the drawing in its units, where `usual` is that on a screen.
    pub(super) fn width(self, usual: f64) -> f64 {
        self.width_mm().map_or(usual, |width_mm| width_mm / MM * PIXELS / self.scale())
    }

    /// A length in units of the drawing, mm.
    pub(super) fn mm(self, length: f64) -> f64 {
        length * self.scale() * MM / PIXELS
    }

    /// The size of letters that are so large on a screen, in units of the drawing.
    pub(super) fn letters(self, size: f64) -> f64 {
        if self == Self::Screen { size } else { size.max(LEAST_PT / LARGEST_PT * LARGEST) }
    }

    /// Pixels of a PNG to a unit of the drawing.
    pub(super) fn pixels(self) -> f64 {
        if self == Self::Screen { SCREEN_PIXELS } else { self.scale() * PRINT_DPI / PIXELS }
    }

    /// Whether what stands beside each other has to be made narrow.
    pub(super) fn is_narrow(self) -> bool {
        self == Self::Single
    }
}
