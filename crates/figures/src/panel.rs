//! One pair of axes with its frame, grid and labels.

use super::canvas::{Figure, Pen, Rect, Style, number, point};
use super::palette;
use super::scale::{PlotAxis, Tick};

/// A pair of axes and the rectangle that they span.
#[derive(Clone, Debug)]
pub(super) struct Panel {
    pub(super) area: Rect,
    pub(super) x: PlotAxis,
    pub(super) y: PlotAxis,
}

/// Room for tick labels and title left of a panel.
pub(super) const LEFT_MARGIN: f64 = 60.0;
/// Room for tick labels and title below a panel.
pub(super) const BOTTOM_MARGIN: f64 = 40.0;

/// The area of a panel that is as wide as a figure of this width allows.
pub(super) fn wide_area(width: f64, top: f64, height: f64) -> Rect {
    Rect { left: LEFT_MARGIN + 8.0, top, width: width - LEFT_MARGIN - 24.0, height }
}

const TICK: f64 = 4.0;
/// Pixels between two labels that look right.
const TICK_PITCH: [f64; 2] = [44.0, 28.0];

impl Panel {
    /// Where the point (x, y) is on the canvas.
    pub(super) fn place(&self, x: f64, y: f64) -> (f64, f64) {
        (
            self.area.left + self.area.width * self.x.position(x),
            self.area.bottom() - self.area.height * self.y.position(y),
        )
    }

    /// Draws the panel with its data, which are cut off at the frame.
    pub(super) fn draw(&self, canvas: &mut Figure, data: impl FnOnce(&mut Figure)) {
        self.draw_grid(canvas);
        canvas.clipped(self.area, data);
        self.draw_frame(canvas);
    }

    /// Draws the grid lines: first of all, under the data. An axis without a name has none.
    pub(super) fn draw_grid(&self, canvas: &mut Figure) {
        let Rect { left, top, .. } = self.area;
        let [right, bottom] = [self.area.right(), self.area.bottom()].map(number);
        let mut path = String::new();
        for tick in self.x_ticks().iter().filter(|tick| !tick.label.is_empty()) {
            let (x, _) = self.place(tick.value, self.y.range.low);
            path += &format!("M{}V{bottom}", point(x, top));
        }
        for tick in self.y_ticks().iter().filter(|tick| !tick.label.is_empty()) {
            let (_, y) = self.place(self.x.range.low, tick.value);
            path += &format!("M{}H{right}", point(left, y));
        }
        canvas.stroke(path, palette::GRID, Pen::Round(1.0));
    }

    /// Draws the line at which y is zero, under the data.
    pub(super) fn draw_zero(&self, canvas: &mut Figure) {
        let (_, zero) = self.place(self.x.range.low, 0.0);
        canvas.line((self.area.left, zero), (self.area.right(), zero), palette::ZERO, 1.0);
    }

    /// Draws frame, ticks and labels: last of all, over the data.
    pub(super) fn draw_frame(&self, canvas: &mut Figure) {
        canvas.frame(self.area, palette::INK);
        self.draw_x_labels(canvas);
        self.draw_y_labels(canvas);
    }

    /// As [`Self::draw_frame`] in a column of panels with one horizontal axis, which the last one names.
    pub(super) fn draw_stacked_frame(&self, canvas: &mut Figure, is_last: bool) {
        canvas.frame(self.area, palette::INK);
        self.draw_y_labels(canvas);
        if is_last {
            self.draw_x_labels(canvas);
        }
    }

    fn draw_x_labels(&self, canvas: &mut Figure) {
        let bottom = self.area.bottom();
        for tick in self.x_ticks() {
            let (x, _) = self.place(tick.value, self.y.range.low);
            let length = if tick.label.is_empty() { TICK / 2.0 } else { TICK };
            canvas.line((x, bottom), (x, bottom + length), palette::INK, 1.0);
            canvas.text((x, bottom + 16.0), &tick.label, Style::LABEL);
        }
        let middle = self.area.left + self.area.width / 2.0;
        canvas.text((middle, bottom + 33.0), &self.x.title(), Style::LABEL);
    }

    pub(super) fn draw_y_labels(&self, canvas: &mut Figure) {
        let left = self.area.left;
        for tick in self.y_ticks() {
            let (_, y) = self.place(self.x.range.low, tick.value);
            let length = if tick.label.is_empty() { TICK / 2.0 } else { TICK };
            canvas.line((left - length, y), (left, y), palette::INK, 1.0);
            canvas.text((left - 7.0, y + 4.0), &tick.label, Style::END);
        }
        let middle = self.area.top + self.area.height / 2.0;
        let style = Style { upright: true, ..Style::LABEL };
        canvas.text((left - LEFT_MARGIN + 14.0, middle), &self.y.title(), style);
    }

    fn x_ticks(&self) -> Vec<Tick> {
        match self.x.title().is_empty() {
            true => Vec::new(),
            false => self.x.ticks((self.area.width / TICK_PITCH[0]) as usize),
        }
    }

    fn y_ticks(&self) -> Vec<Tick> {
        self.y.ticks((self.area.height / TICK_PITCH[1]) as usize)
    }
}
