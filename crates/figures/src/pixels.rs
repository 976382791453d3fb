//! Drawings painted as pixels.

use tiny_skia::{
    Color, FillRule, LineJoin, Mask, Paint, Path, PathBuilder, Pixmap, Stroke, StrokeDash,
    Transform,
};

use super::lettering;
use super::palette;
use super::path::{Step, steps};
use super::svg::{DrawnShape, Figure, Pen, PenKind};

/// The drawing on white, as a PNG file.
///
/// # Errors
/// A message, if it is too large.
pub(super) fn png(figure: &Figure) -> Result<Vec<u8>, String> {
    let scale = figure.size.pixels() as f32;
    let [width, height] = [figure.width, figure.height].map(|side| (side as f32 * scale).ceil());
    let mut pixels =
        Pixmap::new(width as u32, height as u32).ok_or_else(|| "it is too large".to_owned())?;
    pixels.fill(Color::WHITE);
    let mut painter = Painter { pixels, clip: None, whole: Transform::from_scale(scale, scale) };
    figure.shapes.iter().for_each(|shape| painter.paint(shape));
    painter.pixels.encode_png().map_err(|error| error.to_string())
}

struct Painter {
    pixels: Pixmap,
    clip: Option<Mask>,
    /// From units of the drawing to pixels.
    whole: Transform,
}

impl Painter {
    fn paint(&mut self, shape: &DrawnShape) {
        match shape {
            DrawnShape::Stroke { path, colour, pen } => self.stroke(outline(path), colour, *pen),
            DrawnShape::Fill { path, colour } => self.fill(outline(path), colour, self.whole),
            DrawnShape::Disc { centre, radius, colour } => {
                self.fill(circle(*centre, *radius), colour, self.whole);
            }
            DrawnShape::Ring { centre, radius, colour } => {
                self.stroke(circle(*centre, *radius), colour, Pen::FINE);
            }
            DrawnShape::Text { at, text, style } => {
                if let Some((path, transform)) = lettering::outline(text, *at, *style) {
                    self.fill(Some(path), palette::INK, self.whole.pre_concat(transform));
                }
            }
            DrawnShape::Clip(rect) => {
                let mask = Mask::new(self.pixels.width(), self.pixels.height());
                let whole = self.whole;
                self.clip = mask.zip(outline(&rect.path())).map(|(mut mask, path)| {
                    mask.fill_path(&path, FillRule::Winding, true, whole);
                    mask
                });
            }
            DrawnShape::EndClip => self.clip = None,
        }
    }

    fn fill(&mut self, path: Option<Path>, colour: &str, transform: Transform) {
        if let Some(path) = path {
            let (paint, clip) = (paint(colour), self.clip.as_ref());
            self.pixels.fill_path(&path, &paint, FillRule::Winding, transform, clip);
        }
    }

    fn stroke(&mut self, path: Option<Path>, colour: &str, pen: Pen) {
        let Some(path) = path else { return };
        let round = pen.kind == PenKind::Round;
        let stroke = Stroke {
            width: pen.width as f32,
            line_join: if round { LineJoin::Round } else { LineJoin::Miter },
            dash: match pen.kind {
                PenKind::Dashed => StrokeDash::new(vec![5.0, 3.0], 0.0),
                PenKind::Plain | PenKind::Round | PenKind::Crisp => None,
            },
            ..Stroke::default()
        };
        let paint = Paint { anti_alias: pen.kind != PenKind::Crisp, ..paint(colour) };
        self.pixels.stroke_path(&path, &paint, &stroke, self.whole, self.clip.as_ref());
    }
}

/// Paint of a colour `#rrggbb`.
fn paint(colour: &str) -> Paint<'static> {
    let byte = |at: usize| {
        colour.get(at..at + 2).and_then(|hex| u8::from_str_radix(hex, 16).ok()).unwrap_or(0)
    };
    let mut paint = Paint::default();
    paint.set_color_rgba8(byte(1), byte(3), byte(5), 255);
    paint
}

fn circle(centre: (f64, f64), radius: f64) -> Option<Path> {
    PathBuilder::from_circle(centre.0 as f32, centre.1 as f32, radius as f32)
}

/// The path that SVG path syntax describes.
fn outline(path: &str) -> Option<Path> {
    let mut builder = PathBuilder::new();
    for step in steps(path)? {
        match step {
            Step::Move(x, y) => builder.move_to(x, y),
            Step::Line(x, y) => builder.line_to(x, y),
            Step::Close => builder.close(),
        }
    }
    builder.finish()
}
