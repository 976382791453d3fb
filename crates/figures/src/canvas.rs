//! Canvas of figures: a few basic shapes in drawing order, in CSS pixels, y down.
//!
//! Widths and letter sizes for print follow Nature (research-figure-guide.nature.com, "Building and
//! exporting figure panels": 89 and 183 mm, text from 5 to 7 pt), which suits most journals. A
//! figure for print is laid out again: scaled down, its letters would be too small.

use super::palette::Colour;

/// Points and CSS pixels per inch, and mm per inch.
const POINTS: f64 = 72.0;
const PIXELS: f64 = 96.0;
const MM: f64 = 25.4;

/// Largest letters in a drawing (titles, drawing units), largest and smallest on paper (pt).
const LARGEST: f64 = 13.0;
const LARGEST_PT: f64 = 7.0;
const LEAST_PT: f64 = 5.0;

const PRINT_DPI: f64 = 600.0;

const SCREEN_PIXELS: f64 = 2.0;

#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    pub(super) size: Size,
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) shapes: Vec<Shape>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Size {
    /// A width that suits the content, in CSS pixels.
    #[default]
    Screen,
    Single,
    Double,
}

impl Size {
    pub(super) fn width_mm(self) -> Option<f64> {
        match self {
            Self::Screen => None,
            Self::Single => Some(89.0),
            Self::Double => Some(183.0),
        }
    }

    pub(super) fn scale(self) -> f64 {
        if self == Self::Screen { 1.0 } else { LARGEST_PT / LARGEST * PIXELS / POINTS }
    }

    /// The drawing's width in its units; `usual` is the width on a screen.
    pub(super) fn width(self, usual: f64) -> f64 {
        self.width_mm().map_or(usual, |width_mm| width_mm / MM * PIXELS / self.scale())
    }

    pub(super) fn mm(self, length: f64) -> f64 {
        length * self.scale() * MM / PIXELS
    }

    /// The size, in units of the drawing, of letters of this size on a screen.
    pub(super) fn letters(self, size: f64) -> f64 {
        if self == Self::Screen { size } else { size.max(LEAST_PT / LARGEST_PT * LARGEST) }
    }

    pub(super) fn pixels(self) -> f64 {
        if self == Self::Screen { SCREEN_PIXELS } else { self.scale() * PRINT_DPI / PIXELS }
    }

    pub(super) fn is_narrow(self) -> bool {
        self == Self::Single
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shape {
    /// A line with a pen, or an area without one.
    Drawn {
        outline: Outline,
        colour: Colour,
        pen: Option<Pen>,
    },
    Text {
        at: (f64, f64),
        text: String,
        title: Option<String>,
        style: Style,
    },
    Clip(Rect),
    EndClip,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Outline {
    /// In SVG path syntax, lines only.
    Path(String),
    Circle((f64, f64), f64),
    Rect(Rect),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step {
    Move(f32, f32),
    Line(f32, f32),
    Close,
}

impl Outline {
    /// The steps of an outline; `None` if it has anything but lines.
    pub(super) fn steps(&self) -> Option<Vec<Step>> {
        let path = match self {
            Self::Path(path) => path,
            Self::Rect(rect) => &rect.path(),
            Self::Circle(..) => return None,
        };
        let (mut x, mut y) = (0.0, 0.0);
        let mut steps = Vec::new();
        for (command, numbers) in commands_of(path) {
            match (command, numbers.as_slice()) {
                ('M' | 'L', &[to_x, to_y]) => (x, y) = (to_x, to_y),
                ('l', &[by_x, by_y]) => (x, y) = (x + by_x, y + by_y),
                ('H', &[to_x]) => x = to_x,
                ('h', &[by_x]) => x += by_x,
                ('V', &[to_y]) => y = to_y,
                ('v', &[by_y]) => y += by_y,
                ('Z', []) => {
                    steps.push(Step::Close);
                    continue;
                }
                _ => return None,
            }
            steps.push(if command == 'M' { Step::Move(x, y) } else { Step::Line(x, y) });
        }
        Some(steps)
    }
}

fn commands_of(path: &str) -> impl Iterator<Item = (char, Vec<f32>)> + '_ {
    let starts = path.char_indices().filter(|(_, c)| c.is_ascii_alphabetic());
    starts.map(|(at, command)| {
        let rest = &path[at + 1..];
        let end = rest.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(rest.len());
        let numbers = rest[..end].split([' ', ',']).filter_map(|number| number.parse().ok());
        (command, numbers.collect())
    })
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Pen {
    /// Frames and rings: one pixel wide, with mitred corners.
    Fine,
    Round(f64),
    /// Five pixels drawn, three omitted.
    Dashed(f64),
    /// Snapped to pixels, without smooth edges: rows of cells that must meet without seams.
    Crisp(f64),
}

impl Pen {
    pub(super) fn width(self) -> f64 {
        match self {
            Self::Fine => 1.0,
            Self::Round(width) | Self::Dashed(width) | Self::Crisp(width) => width,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rect {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) width: f64,
    pub(super) height: f64,
}

impl Rect {
    pub(super) fn right(&self) -> f64 {
        self.left + self.width
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height
    }

    pub(super) fn path(&self) -> String {
        let [right, bottom, left] = [self.right(), self.bottom(), self.left].map(number);
        format!("M{}H{right}V{bottom}H{left}Z", point(self.left, self.top))
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

impl Anchor {
    /// Offset of the text's start from the position, in widths of the text.
    pub(super) fn start(self) -> f32 {
        match self {
            Self::Start => 0.0,
            Self::Middle => -0.5,
            Self::End => -1.0,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Style {
    pub(super) size: f64,
    pub(super) anchor: Anchor,
    pub(super) bold: bool,
    /// Rotated by a quarter turn to the left, so that it reads upwards.
    pub(super) upright: bool,
}

impl Style {
    pub(super) const LABEL: Self =
        Self { size: 11.0, anchor: Anchor::Middle, bold: false, upright: false };
    pub(super) const START: Self = Self { anchor: Anchor::Start, ..Self::LABEL };
    pub(super) const END: Self = Self { anchor: Anchor::End, ..Self::LABEL };
    pub(super) const TITLE: Self = Self { size: 13.0, bold: true, ..Self::LABEL };
}

/// The maximum width of a text, px: the font's digits are 0.636 em wide, running text less.
pub(super) fn text_width(text: &str, size: f64) -> f64 {
    0.64 * size * text.chars().count() as f64
}

impl Figure {
    pub(super) fn new(size: Size, width: f64, height: f64) -> Self {
        Self { size, width, height, shapes: Vec::new() }
    }

    pub(super) fn titled(size: Size, width: f64, height: f64, title: &str) -> Self {
        let mut figure = Self::new(size, width, height);
        figure.title((16.0, 24.0), title);
        figure
    }

    fn draw(&mut self, outline: Outline, colour: Colour, pen: Option<Pen>) {
        self.shapes.push(Shape::Drawn { outline, colour, pen });
    }

    pub(super) fn stroke(&mut self, path: impl Into<String>, colour: Colour, pen: Pen) {
        self.draw(Outline::Path(path.into()), colour, Some(pen));
    }

    pub(super) fn fill(&mut self, path: impl Into<String>, colour: Colour) {
        self.draw(Outline::Path(path.into()), colour, None);
    }

    pub(super) fn line(&mut self, from: (f64, f64), to: (f64, f64), colour: Colour, width: f64) {
        let end = match from.1 == to.1 {
            true => format!("H{}", number(to.0)),
            false => format!("L{}", point(to.0, to.1)),
        };
        self.stroke(format!("M{}{end}", point(from.0, from.1)), colour, Pen::Round(width));
    }

    pub(super) fn frame(&mut self, rect: Rect, colour: Colour) {
        self.draw(Outline::Rect(rect), colour, Some(Pen::Fine));
    }

    pub(super) fn circle(&mut self, centre: (f64, f64), radius: f64, colour: Colour) {
        self.draw(Outline::Circle(centre, radius), colour, None);
    }

    pub(super) fn ring(&mut self, centre: (f64, f64), radius: f64, colour: Colour) {
        self.draw(Outline::Circle(centre, radius), colour, Some(Pen::Fine));
    }

    pub(super) fn text(&mut self, at: (f64, f64), text: &str, style: Style) {
        self.explained_text(at, (text, None), style);
    }

    pub(super) fn title(&mut self, at: (f64, f64), text: &str) {
        self.text(at, text, Style { anchor: Anchor::Start, ..Style::TITLE });
    }

    pub(super) fn explained_text(
        &mut self,
        at: (f64, f64),
        (text, title): (&str, Option<&str>),
        style: Style,
    ) {
        let style = Style { size: self.size.letters(style.size), ..style };
        let (text, title) = (text.to_owned(), title.map(str::to_owned));
        self.shapes.push(Shape::Text { at, text, title, style });
    }

    pub(super) fn clipped(&mut self, rect: Rect, draw: impl FnOnce(&mut Self)) {
        self.shapes.push(Shape::Clip(rect));
        draw(self);
        self.shapes.push(Shape::EndClip);
    }
}

pub(super) fn number(value: f64) -> String {
    let hundredths = (value * 100.0).round();
    let text = format!("{:.2}", hundredths / 100.0 + 0.0);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

pub(super) fn point(x: f64, y: f64) -> String {
    format!("{} {}", number(x), number(y))
}

pub(super) fn polyline(points: impl IntoIterator<Item = (f64, f64)>) -> String {
    let mut path = String::new();
    for (x, y) in points {
        path.push(if path.is_empty() { 'M' } else { 'L' });
        path.push_str(&point(x, y));
    }
    path
}

#[cfg(test)]
mod tests {
    use super::Step::{Close, Line, Move};
    use super::*;

    #[test]
    fn numbers_are_short_and_zero_has_no_sign() {
        let written = [1.0, 10.0, 0.5, -0.001, 12.345678, -3.10].map(number);
        assert_eq!(written, ["1", "10", "0.5", "0", "12.35", "-3.1"]);
    }

    #[test]
    fn paths_equal_those_of_the_syntax() {
        let absolute =
            vec![Move(1.0, 2.0), Line(5.0, 2.0), Line(5.0, -3.0), Line(1.0, -3.0), Close];
        let steps = |path: &str| Outline::Path(path.to_owned()).steps();
        assert_eq!(steps("M1 2H5V-3L1 -3Z"), Some(absolute.clone()));
        assert_eq!(steps("M1 2h4v-5l-4 0Z"), Some(absolute));
        assert_eq!(steps("M1 2C3 4"), None);
        assert_eq!(steps(""), Some(Vec::new()));
    }
}
