//! Text as outlines in a built-in font: the same picture on every machine.

use std::sync::LazyLock;

use tiny_skia::{Path, PathBuilder, Transform};
use ttf_parser::{Face, OutlineBuilder};

use super::canvas::Style;

static REGULAR: LazyLock<Face<'static>> =
    LazyLock::new(|| font(include_bytes!("../assets/DejaVuSans-subset.ttf.zst")));
static BOLD: LazyLock<Face<'static>> =
    LazyLock::new(|| font(include_bytes!("../assets/DejaVuSans-Bold-subset.ttf.zst")));

fn font(asset: &[u8]) -> Face<'static> {
    Face::parse(crate::decompressed(asset).leak(), 0).expect("an asset is a font")
}

pub(super) fn face(bold: bool) -> &'static Face<'static> {
    if bold { &BOLD } else { &REGULAR }
}

pub(super) fn width(text: &str, style: Style) -> f64 {
    let face = face(style.bold);
    let advance = |character| {
        let glyph = face.glyph_index(character).unwrap_or_default();
        f64::from(face.glyph_hor_advance(glyph).unwrap_or(0))
    };
    text.chars().map(advance).sum::<f64>() * style.size / f64::from(face.units_per_em())
}

/// The outline of a text, and its position; `None` without ink. The built-in fonts have no kerning.
/// A missing character becomes the replacement glyph.
pub(super) fn outline(text: &str, at: (f64, f64), style: Style) -> Option<(Path, Transform)> {
    let face = face(style.bold);
    let mut outline = Outline { path: PathBuilder::new(), left: 0.0 };
    for character in text.chars() {
        let glyph = face.glyph_index(character).unwrap_or_default();
        if let Some(glyphs) = face.tables().glyf {
            glyphs.outline(glyph, &mut outline);
        }
        outline.left += f32::from(face.glyph_hor_advance(glyph).unwrap_or(0));
    }
    let start = style.anchor.start() * outline.left;
    let scale = style.size as f32 / f32::from(face.units_per_em());
    let turn = if style.upright { -90.0 } else { 0.0 };
    // In the font y is up.
    let transform = Transform::from_translate(at.0 as f32, at.1 as f32)
        .pre_concat(Transform::from_rotate(turn))
        .pre_concat(Transform::from_scale(scale, -scale))
        .pre_concat(Transform::from_translate(start, 0.0));
    Some((outline.path.finish()?, transform))
}

struct Outline {
    path: PathBuilder,
    left: f32,
}

impl OutlineBuilder for Outline {
    fn move_to(&mut self, x: f32, y: f32) {
        self.path.move_to(self.left + x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.path.line_to(self.left + x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.path.quad_to(self.left + x1, y1, self.left + x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.path.cubic_to(self.left + x1, y1, self.left + x2, y2, self.left + x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}
