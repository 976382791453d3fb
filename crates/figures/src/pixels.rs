use tiny_skia::{
    Color, FillRule, LineJoin, Mask, Paint, Path, PathBuilder, Pixmap, Stroke, StrokeDash,
    Transform,
};

use super::canvas::{Figure, Outline, Pen, Shape, Step};
use super::lettering;
use super::palette::{Colour, INK};

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
    whole: Transform,
}

impl Painter {
    fn paint(&mut self, shape: &Shape) {
        match shape {
            Shape::Drawn { outline, colour, pen } => match (path(outline), pen) {
                (None, _) => {}
                (Some(path), None) => self.fill(&path, *colour, self.whole),
                (Some(path), Some(pen)) => self.stroke(&path, *colour, *pen),
            },
            Shape::Text { at, text, style, .. } => {
                if let Some((path, transform)) = lettering::outline(text, *at, *style) {
                    self.fill(&path, INK, self.whole.pre_concat(transform));
                }
            }
            Shape::Clip(rect) => {
                let mask = Mask::new(self.pixels.width(), self.pixels.height());
                let whole = self.whole;
                self.clip = mask.zip(path(&Outline::Rect(*rect))).map(|(mut mask, path)| {
                    mask.fill_path(&path, FillRule::Winding, true, whole);
                    mask
                });
            }
            Shape::EndClip => self.clip = None,
        }
    }

    fn fill(&mut self, path: &Path, colour: Colour, transform: Transform) {
        let (paint, clip) = (paint(colour), self.clip.as_ref());
        self.pixels.fill_path(path, &paint, FillRule::Winding, transform, clip);
    }

    fn stroke(&mut self, path: &Path, colour: Colour, pen: Pen) {
        let is_round = matches!(pen, Pen::Round(_));
        let is_dashed = matches!(pen, Pen::Dashed(_));
        let stroke = Stroke {
            width: pen.width() as f32,
            line_join: if is_round { LineJoin::Round } else { LineJoin::Miter },
            dash: is_dashed.then(|| StrokeDash::new(vec![5.0, 3.0], 0.0)).flatten(),
            ..Stroke::default()
        };
        let paint = Paint { anti_alias: !matches!(pen, Pen::Crisp(_)), ..paint(colour) };
        self.pixels.stroke_path(path, &paint, &stroke, self.whole, self.clip.as_ref());
    }
}

fn paint(colour: Colour) -> Paint<'static> {
    let [red, green, blue] = colour.rgb();
    let mut paint = Paint::default();
    paint.set_color_rgba8(red, green, blue, 255);
    paint
}

fn path(outline: &Outline) -> Option<Path> {
    if let Outline::Circle((x, y), radius) = *outline {
        return PathBuilder::from_circle(x as f32, y as f32, radius as f32);
    }
    let mut builder = PathBuilder::new();
    for step in outline.steps()? {
        match step {
            Step::Move(x, y) => builder.move_to(x, y),
            Step::Line(x, y) => builder.line_to(x, y),
            Step::Close => builder.close(),
        }
    }
    builder.finish()
}
