//! Drawings as SVG documents.

use std::fmt::Write;

use super::canvas::{Anchor, Figure, Outline, Pen, Rect, Shape, Style, number};
use super::palette;
use shell_data::escape;

impl Figure {
    pub fn svg(&self) -> String {
        let [width, height] = [self.width, self.height].map(number);
        let [wide, high] = match self.size.width_mm() {
            None => [width.clone(), height.clone()],
            Some(_) => [self.width, self.height].map(|side| number(self.size.mm(side)) + "mm"),
        };
        let ink = palette::INK.hex();
        let mut svg = format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" width="{wide}" height="{high}" viewBox="0 0 {width} {height}" font-family="'DejaVu Sans', Verdana, sans-serif" fill="{ink}">
<path d="M0 0H{width}V{height}H0Z" fill="white"/>
"#
        );
        let mut clips = 0;
        for shape in &self.shapes {
            let element = match shape {
                Shape::Drawn { outline, colour, pen } => {
                    format!("<{} {}/>", geometry(outline), paint(&colour.hex(), *pen))
                }
                Shape::Text { at, text, title, style } => text_element(*at, text, title, *style),
                Shape::Clip(rect) => {
                    clips += 1;
                    let rect = attributes(rect);
                    format!(
                        r##"<clipPath id="clip{clips}"><rect {rect}/></clipPath>
<g clip-path="url(#clip{clips})">"##
                    )
                }
                Shape::EndClip => "</g>".to_owned(),
            };
            let _ = writeln!(svg, "{element}");
        }
        svg + "</svg>\n"
    }
}

fn geometry(outline: &Outline) -> String {
    match outline {
        Outline::Path(path) => format!(r#"path d="{path}""#),
        Outline::Circle((x, y), radius) => {
            let [x, y, radius] = [*x, *y, *radius].map(number);
            format!(r#"circle cx="{x}" cy="{y}" r="{radius}""#)
        }
        Outline::Rect(rect) => format!("rect {}", attributes(rect)),
    }
}

fn attributes(rect: &Rect) -> String {
    let [x, y, width, height] = [rect.left, rect.top, rect.width, rect.height].map(number);
    format!(r#"x="{x}" y="{y}" width="{width}" height="{height}""#)
}

fn paint(colour: &str, pen: Option<Pen>) -> String {
    let Some(pen) = pen else { return format!(r#"fill="{colour}""#) };
    let width = number(pen.width());
    let stroke = format!(r#"stroke="{colour}" stroke-width="{width}""#);
    match pen {
        Pen::Fine => format!(r#"fill="none" stroke="{colour}""#),
        Pen::Round(_) => format!(r#"fill="none" {stroke} stroke-linejoin="round""#),
        Pen::Dashed(_) => format!(r#"fill="none" {stroke} stroke-dasharray="5 3""#),
        Pen::Crisp(_) => format!(r#"{stroke} shape-rendering="crispEdges""#),
    }
}

fn text_element(at: (f64, f64), text: &str, title: &Option<String>, style: Style) -> String {
    let [x, y, size] = [at.0, at.1, style.size].map(number);
    let anchor = match style.anchor {
        Anchor::Start => "",
        Anchor::Middle => r#" text-anchor="middle""#,
        Anchor::End => r#" text-anchor="end""#,
    };
    let weight = if style.bold { r#" font-weight="bold""# } else { "" };
    let turn = match style.upright {
        true => format!(r#" transform="rotate(-90 {x} {y})""#),
        false => String::new(),
    };
    let title = title.as_ref().map(|title| format!("<title>{}</title>", escape::markup(title)));
    let content = title.unwrap_or_default() + &escape::markup(text);
    format!(r#"<text x="{x}" y="{y}" font-size="{size}"{anchor}{weight}{turn}>{content}</text>"#)
}
