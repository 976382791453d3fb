//! The keys of curves: beside the panels, or below them where a figure is narrow.

use super::canvas::{Figure, Rect, Style, text_width};
use super::panel::{BOTTOM_MARGIN, LEFT_MARGIN};
use super::size::Size;

const TOP: f64 = 44.0;
const KEY: f64 = 24.0;
const PITCH: f64 = 19.0;
/// Right of panels without a legend.
const MARGIN: f64 = 16.0;

/// Where each curve is named.
#[derive(Clone, Copy, Debug)]
pub(super) struct Legend<'a> {
    size: Size,
    labels: &'a [&'a str],
}

impl<'a> Legend<'a> {
    pub(super) fn new(size: Size, labels: &'a [&'a str]) -> Self {
        Self { size, labels }
    }

    /// What it takes beside the panels.
    fn width(&self) -> f64 {
        if self.size.is_narrow() {
            return MARGIN;
        }
        let letters = self.size.letters(Style::LABEL.size);
        let labels = self.labels.iter().map(|label| text_width(label, letters));
        KEY + 24.0 + labels.fold(0.0, f64::max)
    }

    /// The uppermost panel, `usual` wide on a screen.
    pub(super) fn panel(&self, usual: f64, height: f64) -> Rect {
        let left = LEFT_MARGIN + 4.0;
        let width = match self.size {
            Size::Screen => usual,
            print => print.width(0.0) - left - self.width(),
        };
        Rect { left, top: TOP, width, height }
    }

    /// A figure with a title above a column of panels, from the uppermost to the lowest.
    pub(super) fn figure(&self, title: &str, [upper, lowest]: [Rect; 2]) -> Figure {
        let (bottom, entries) = (below(lowest), PITCH * self.labels.len() as f64);
        let height = match self.size.is_narrow() {
            true => bottom + entries,
            false => bottom.max(TOP + entries + 16.0),
        };
        let mut figure = Figure::new(self.size, upper.right() + self.width(), height);
        figure.title((upper.left, TOP - 16.0), title);
        figure
    }

    /// Names the curves; `draw` draws a key from one point to another for the curve of that position.
    pub(super) fn draw(
        &self,
        canvas: &mut Figure,
        [upper, lowest]: [Rect; 2],
        mut draw: impl FnMut(&mut Figure, usize, [(f64, f64); 2]),
    ) {
        let (left, top) = match self.size.is_narrow() {
            true => (upper.left, below(lowest) + 4.0),
            false => (upper.right() + 12.0, TOP + 10.0),
        };
        for (i, label) in self.labels.iter().enumerate() {
            let y = top + PITCH * i as f64;
            draw(canvas, i, [(left, y), (left + KEY, y)]);
            canvas.text((left + KEY + 6.0, y + 4.0), label, Style::START);
        }
    }
}

/// Where the labels below the lowest panel end.
fn below(lowest: Rect) -> f64 {
    lowest.bottom() + BOTTOM_MARGIN + 6.0
}
