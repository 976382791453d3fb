//! A canvas that writes SVG: a handful of shapes, coordinates in CSS pixels, y down. It remembers the
//! shapes, to be painted as pixels.

use std::fmt::Write;

use super::palette;
use super::size::Size;
use shell_data::escape;

/// What figures draw on.
#[derive(Debug)]
pub(super) struct Canvas {
    pub(super) size: Size,
    width: f64,
    height: f64,
    body: String,
    clips: usize,
    shapes: Vec<DrawnShape>,
}

/// A finished picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    pub(super) size: Size,
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) svg: String,
    pub(super) shapes: Vec<DrawnShape>,
}

/// A shape, as the SVG has it. Paths are in SVG path syntax, of lines only; colours are `#rrggbb`.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum DrawnShape {
    Stroke {
        path: String,
        colour: String,
        pen: Pen,
    },
    Fill {
        path: String,
        colour: String,
    },
    Disc {
        centre: (f64, f64),
        radius: f64,
        colour: String,
    },
    Ring {
        centre: (f64, f64),
        radius: f64,
        colour: String,
    },
    Text {
        at: (f64, f64),
        text: String,
        style: Style,
    },
    /// All that follows is cut off at the edges of the rectangle.
    Clip(Rect),
    /// And no longer.
    EndClip,
}

/// How a path is stroked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pen {
    pub(super) width: f64,
    pub(super) kind: PenKind,
}

impl Pen {
    /// Of frames and rings.
    pub(super) const FINE: Self = Self { width: 1.0, kind: PenKind::Plain };
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PenKind {
    /// A line with mitred corners.
    Plain,
    /// A line with round corners.
    Round,
    /// Five pixels drawn, three left out.
    Dashed,
    /// Whole pixels, without smooth edges.
    Crisp,
}

/// A rectangle, from its upper left corner.
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

    /// Its edge in path syntax.
    pub(super) fn path(&self) -> String {
        let [right, bottom, left] = [self.right(), self.bottom(), self.left].map(number);
        format!("M{}H{right}V{bottom}H{left}Z", point(self.left, self.top))
    }

    fn attributes(&self) -> String {
        let [x, y, width, height] = [self.left, self.top, self.width, self.height].map(number);
        format!(r#"x="{x}" y="{y}" width="{width}" height="{height}""#)
    }
}

/// Which point of a text is at the position given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

impl Anchor {
    /// How far the text begins from the position, in widths of it.
    pub(super) fn start(self) -> f32 {
        match self {
            Self::Start => 0.0,
            Self::Middle => -0.5,
            Self::End => -1.0,
        }
    }
}

/// How a text is set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Style {
    pub(super) size: f64,
    pub(super) anchor: Anchor,
    pub(super) bold: bool,
    /// Turned a quarter to the left, to be read from below.
    pub(super) upright: bool,
}

impl Style {
    pub(super) const LABEL: Self =
        Self { size: 11.0, anchor: Anchor::Middle, bold: false, upright: false };
    pub(super) const TITLE: Self = Self { size: 13.0, bold: true, ..Self::LABEL };

    pub(super) const fn anchored(self, anchor: Anchor) -> Self {
        Self { anchor, ..self }
    }
}

/// Room that a text takes at most, in pixels: the digits of the font are 0.636 em wide, the average
/// of running text less.
pub(super) fn text_width(text: &str, size: f64) -> f64 {
    0.64 * size * text.chars().count() as f64
}

impl Figure {
    /// The picture as an SVG document.
    pub fn svg(&self) -> &str {
        &self.svg
    }
}

impl Canvas {
    /// For a screen.
    pub(super) fn new(width: f64, height: f64) -> Self {
        Self::sized(Size::Screen, width, height)
    }

    /// For a screen or for print.
    pub(super) fn sized(size: Size, width: f64, height: f64) -> Self {
        Self { size, width, height, body: String::new(), clips: 0, shapes: Vec::new() }
    }

    pub(super) fn line(&mut self, from: (f64, f64), to: (f64, f64), colour: &str, width: f64) {
        let end = match from.1 == to.1 {
            true => format!("H{}", number(to.0)),
            false => format!("L{}", point(to.0, to.1)),
        };
        let path = format!("M{}{end}", point(from.0, from.1));
        self.stroke(&path, colour, width);
    }

    /// Strokes a path given in SVG path syntax.
    pub(super) fn stroke(&mut self, path: &str, colour: &str, width: f64) {
        self.stroke_with(path, colour, Pen { width, kind: PenKind::Round });
    }

    fn stroke_with(&mut self, path: &str, colour: &str, pen: Pen) {
        let (fill, kind) = match pen.kind {
            PenKind::Plain => (r#" fill="none""#, ""),
            PenKind::Round => (r#" fill="none""#, r#" stroke-linejoin="round""#),
            PenKind::Dashed => (r#" fill="none""#, r#" stroke-dasharray="5 3""#),
            PenKind::Crisp => ("", r#" shape-rendering="crispEdges""#),
        };
        let width = number(pen.width);
        let _ = writeln!(
            self.body,
            r#"<path d="{path}"{fill} stroke="{colour}" stroke-width="{width}"{kind}/>"#
        );
        let (path, colour) = (path.to_owned(), colour.to_owned());
        self.shapes.push(DrawnShape::Stroke { path, colour, pen });
    }

    /// As [`Self::stroke`], broken into dashes.
    pub(super) fn dashes(&mut self, path: &str, colour: &str, width: f64) {
        self.stroke_with(path, colour, Pen { width, kind: PenKind::Dashed });
    }

    /// Strokes rows of cells that must meet without seams, `height` high.
    pub(super) fn cells(&mut self, path: &str, colour: &str, height: f64) {
        self.stroke_with(path, colour, Pen { width: height, kind: PenKind::Crisp });
    }

    /// Fills a path given in SVG path syntax.
    pub(super) fn fill(&mut self, path: &str, colour: &str) {
        let _ = writeln!(self.body, r#"<path d="{path}" fill="{colour}"/>"#);
        self.shapes.push(DrawnShape::Fill { path: path.to_owned(), colour: colour.to_owned() });
    }

    pub(super) fn frame(&mut self, rect: Rect, colour: &str) {
        let attributes = rect.attributes();
        let _ = writeln!(self.body, r#"<rect {attributes} fill="none" stroke="{colour}"/>"#);
        let (path, colour) = (rect.path(), colour.to_owned());
        self.shapes.push(DrawnShape::Stroke { path, colour, pen: Pen::FINE });
    }

    pub(super) fn circle(&mut self, centre: (f64, f64), radius: f64, colour: &str) {
        self.shapes.push(DrawnShape::Disc { centre, radius, colour: colour.to_owned() });
        let [x, y, radius] = [centre.0, centre.1, radius].map(number);
        let _ = writeln!(self.body, r#"<circle cx="{x}" cy="{y}" r="{radius}" fill="{colour}"/>"#);
    }

    /// A circle that is not filled.
    pub(super) fn ring(&mut self, centre: (f64, f64), radius: f64, colour: &str) {
        self.shapes.push(DrawnShape::Ring { centre, radius, colour: colour.to_owned() });
        let [x, y, radius] = [centre.0, centre.1, radius].map(number);
        let _ = writeln!(
            self.body,
            r#"<circle cx="{x}" cy="{y}" r="{radius}" fill="none" stroke="{colour}"/>"#
        );
    }

    pub(super) fn text(&mut self, at: (f64, f64), text: &str, style: Style) {
        self.text_with_title(at, text, None, style);
    }

    /// A text, and what a pointer over it shows.
    pub(super) fn text_with_title(
        &mut self,
        at: (f64, f64),
        text: &str,
        title: Option<&str>,
        style: Style,
    ) {
        let style = Style { size: self.size.letters(style.size), ..style };
        self.shapes.push(DrawnShape::Text { at, text: text.to_owned(), style });
        let [x, y, size] = [at.0, at.1, style.size].map(number);
        let anchor = match style.anchor {
            Anchor::Start => "",
            Anchor::Middle => r#" text-anchor="middle""#,
            Anchor::End => r#" text-anchor="end""#,
        };
        let weight = if style.bold { r#" font-weight="bold""# } else { "" };
        let turn = style.upright.then(|| format!(r#" transform="rotate(-90 {x} {y})""#));
        let turn = turn.unwrap_or_default();
        let title = title.map(|title| format!("<title>{}</title>", escape::markup(title)));
        let _ = writeln!(
            self.body,
            r#"<text x="{x}" y="{y}" font-size="{size}"{anchor}{weight}{turn}>{}{}</text>"#,
            title.unwrap_or_default(),
            escape::markup(text)
        );
    }

    /// Draws what `draw` draws, cut off at the edges of `rect`.
    pub(super) fn clipped(&mut self, rect: Rect, draw: impl FnOnce(&mut Self)) {
        self.shapes.push(DrawnShape::Clip(rect));
        self.clips += 1;
        let id = self.clips;
        let rect = rect.attributes();
        let _ = writeln!(
            self.body,
            r##"<clipPath id="clip{id}"><rect {rect}/></clipPath>
<g clip-path="url(#clip{id})">"##
        );
        draw(self);
        self.body.push_str("</g>\n");
        self.shapes.push(DrawnShape::EndClip);
    }

    /// The finished document, on white.
    pub(super) fn finish(self) -> Figure {
        let [width, height] = [self.width, self.height].map(number);
        let [wide, high] = match self.size.width_mm() {
            None => [width.clone(), height.clone()],
            Some(_) => [self.width, self.height].map(|side| number(self.size.mm(side)) + "mm"),
        };
        let svg = format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" width="{wide}" height="{high}" viewBox="0 0 {width} {height}" font-family="'DejaVu Sans', Verdana, sans-serif" fill="{}">
<path d="M0 0H{width}V{height}H0Z" fill="white"/>
{}</svg>
"#,
            palette::INK,
            self.body
        );
        let Self { size, width, height, shapes, .. } = self;
        Figure { size, width, height, svg, shapes }
    }
}

/// A coordinate to a hundredth of a pixel, in as few characters as that takes.
pub(super) fn number(value: f64) -> String {
    let hundredths = (value * 100.0).round();
    let text = format!("{:.2}", hundredths / 100.0 + 0.0);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// A point in path syntax.
pub(super) fn point(x: f64, y: f64) -> String {
    format!("{} {}", number(x), number(y))
}

/// A line through points, in path syntax; empty without any.
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
    use super::*;

    #[test]
    fn numbers_are_short_and_zero_has_no_sign() {
        let written = [1.0, 10.0, 0.5, -0.001, 12.345678, -3.10].map(number);
        assert_eq!(written, ["1", "10", "0.5", "0", "12.35", "-3.1"]);
    }
}
