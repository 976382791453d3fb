//! The keys of curves: beside the panels, or below them where a figure is narrow.

use super::size::Size;
use super::svg::{Anchor, Canvas, Rect, Style, text_width};

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

    /// The width of panels that begin at `left` and are `usual` wide on a screen.
    pub(super) fn panels(&self, left: f64, usual: f64) -> f64 {
        match self.size {
            Size::Screen => usual,
            print => print.width(0.0) - left - self.width(),
        }
    }

    /// Width and height of a drawing with panels within `panels`, whose labels end at `bottom`.
    pub(super) fn canvas(&self, panels: Rect, bottom: f64) -> (f64, f64) {
        let entries = PITCH * self.labels.len() as f64;
        let height = match self.size.is_narrow() {
            true => bottom + entries,
            false => bottom.max(panels.top + entries + 16.0),
        };
        (panels.right() + self.width(), height)
    }

    /// Names the curves; `draw` draws a key from one point to another for the curve of that position.
    pub(super) fn draw(
        &self,
        canvas: &mut Canvas,
        panels: Rect,
        bottom: f64,
        mut draw: impl FnMut(&mut Canvas, usize, [(f64, f64); 2]),
    ) {
        let (left, top) = match self.size.is_narrow() {
            true => (panels.left, bottom + 4.0),
            false => (panels.right() + 12.0, panels.top + 10.0),
        };
        for (i, label) in self.labels.iter().enumerate() {
            let y = top + PITCH * i as f64;
            draw(canvas, i, [(left, y), (left + KEY, y)]);
            canvas.text((left + KEY + 6.0, y + 4.0), label, Style::LABEL.anchored(Anchor::Start));
        }
    }
}
