//! Drawings as PDF (ISO 32000): one page of the picture's size, with letters in an embedded font.
//!
//! The page transformation converts the canvas's coordinates: y up, points. Text is glyph numbers
//! with a table of their characters, so it can be searched and copied.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use ttf_parser::Face;

use super::canvas::{Figure, Outline, Pen, Shape, Step, Style, number};
use super::lettering;
use super::palette::{Colour, INK};

/// Points per CSS pixel: 72 and 96 per inch.
const POINTS: f64 = 0.75;

/// Distance of Bézier handles from the ends, for a quarter of a circle of radius 1: 4/3·(√2 − 1).
const QUARTER: f64 = 0.552_284_75;

const FONTS: [&str; 2] = ["R", "B"];

/// The drawing on white, as a PDF file, the same bytes on every machine.
pub(super) fn pdf(figure: &Figure) -> Vec<u8> {
    let mut page = PdfPage { content: String::new(), glyphs: [BTreeMap::new(), BTreeMap::new()] };
    let points = POINTS * figure.size.scale();
    let height = number(figure.height * points);
    let _ = writeln!(page.content, "{points} 0 0 -{points} 0 {height} cm");
    figure.shapes.iter().for_each(|shape| page.draw(shape));
    // Four bytes beyond ASCII mark the file as binary.
    let bytes = b"%PDF-1.7\n%\xe2\xe3\xcf\xd3\n".to_vec();
    let mut file = PdfFile { bytes, objects: Vec::new() };
    let mut fonts = String::new();
    for ((name, used), bold) in FONTS.iter().zip(&page.glyphs).zip([false, true]) {
        if !used.is_empty() {
            let font = embed(&mut file, lettering::face(bold), used, bold);
            let _ = write!(fonts, "/{name} {font} 0 R ");
        }
    }
    let content = file.stream("", page.content.as_bytes());
    let pages = file.objects.len() + 2;
    let width = number(figure.width * points);
    let leaf = file.add(format!(
        "<< /Type /Page /Parent {pages} 0 R /MediaBox [0 0 {width} {height}] /Contents {content} 0 R \
         /Resources << /Font << {fonts}>> >> >>"
    ));
    let pages = file.add(format!("<< /Type /Pages /Kids [{leaf} 0 R] /Count 1 >>"));
    let catalog = file.add(format!("<< /Type /Catalog /Pages {pages} 0 R >>"));
    file.finish(catalog)
}

struct PdfPage {
    content: String,
    glyphs: [BTreeMap<u16, char>; 2],
}

impl PdfPage {
    fn draw(&mut self, shape: &Shape) {
        match shape {
            Shape::Drawn { outline, colour, pen: None } => {
                let _ = writeln!(self.content, "{} rg", rgb(*colour));
                self.outline(outline, "f");
            }
            Shape::Drawn { outline, colour, pen: Some(pen) } => {
                let join = u8::from(matches!(pen, Pen::Round(_)));
                let dash = if matches!(pen, Pen::Dashed(_)) { "5 3" } else { "" };
                let (rgb, width) = (rgb(*colour), number(pen.width()));
                let _ = writeln!(self.content, "{rgb} RG {width} w {join} j [{dash}] 0 d");
                // A circle is closed before it is stroked.
                let is_circle = matches!(outline, Outline::Circle(..));
                self.outline(outline, if is_circle { "s" } else { "S" });
            }
            Shape::Text { at, text, style, .. } => self.text(*at, text, *style),
            Shape::Clip(rect) => {
                self.content.push_str("q\n");
                self.outline(&Outline::Rect(*rect), "W n");
            }
            Shape::EndClip => self.content.push_str("Q\n"),
        }
    }

    fn outline(&mut self, outline: &Outline, paint: &str) {
        if let Outline::Circle(centre, radius) = outline {
            return self.circle(*centre, *radius, paint);
        }
        // As in pixels, an outline with anything but lines is skipped.
        let steps = outline.steps().unwrap_or_default();
        if steps.is_empty() {
            return;
        }
        for step in steps {
            let (x, y, operator) = match step {
                Step::Move(x, y) => (x, y, "m"),
                Step::Line(x, y) => (x, y, "l"),
                Step::Close => {
                    self.content.push_str("h ");
                    continue;
                }
            };
            let [x, y] = [x, y].map(|value| number(f64::from(value)));
            let _ = write!(self.content, "{x} {y} {operator} ");
        }
        let _ = writeln!(self.content, "{paint}");
    }

    fn circle(&mut self, (x, y): (f64, f64), radius: f64, paint: &str) {
        let at =
            |dx: f64, dy: f64| format!("{} {}", number(x + dx * radius), number(y + dy * radius));
        let _ = write!(self.content, "{} m ", at(1.0, 0.0));
        let corners = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 0.0)];
        for (from, to) in corners.iter().zip(&corners[1..]) {
            let _ = write!(
                self.content,
                "{} {} {} c ",
                at(from.0 + QUARTER * to.0, from.1 + QUARTER * to.1),
                at(to.0 + QUARTER * from.0, to.1 + QUARTER * from.1),
                at(to.0, to.1)
            );
        }
        let _ = writeln!(self.content, "{paint}");
    }

    fn text(&mut self, (x, y): (f64, f64), text: &str, style: Style) {
        let face = lettering::face(style.bold);
        let mut numbers = String::new();
        for character in text.chars() {
            let glyph = face.glyph_index(character).unwrap_or_default();
            self.glyphs[usize::from(style.bold)].insert(glyph.0, character);
            let _ = write!(numbers, "{:04x}", glyph.0);
        }
        let size = style.size;
        let shift = f64::from(style.anchor.start()) * lettering::width(text, style);
        // Against the page, whose y axis points down; upright text is rotated to the left.
        let (axes, x, y) = match style.upright {
            false => ([size, 0.0, 0.0, -size], x + shift, y),
            true => ([0.0, -size, -size, 0.0], x, y - shift),
        };
        let [a, b, c, d] = axes.map(number);
        let (ink, name) = (rgb(INK), FONTS[usize::from(style.bold)]);
        let (x, y) = (number(x), number(y));
        let _ = writeln!(
            self.content,
            "BT {ink} rg /{name} 1 Tf {a} {b} {c} {d} {x} {y} Tm <{numbers}> Tj ET"
        );
    }
}

fn rgb(colour: Colour) -> String {
    colour.rgb().map(|part| number(f64::from(part) / 255.0)).join(" ")
}

fn embed(file: &mut PdfFile, face: &Face<'_>, used: &BTreeMap<u16, char>, bold: bool) -> usize {
    let name = if bold { "DejaVuSans-Bold" } else { "DejaVuSans" };
    let em = f64::from(face.units_per_em());
    let units = |value: f64| number(1000.0 * value / em);
    let data = face.raw_face().data;
    let program = file.stream(&format!("/Length1 {} ", data.len()), data);
    let bounds = face.global_bounding_box();
    let bounds = [bounds.x_min, bounds.y_min, bounds.x_max, bounds.y_max];
    let bounds = bounds.map(|value| units(value.into())).join(" ");
    let capital = face.capital_height().unwrap_or(face.ascender());
    let metrics = [face.ascender(), face.descender(), capital];
    let [ascent, descent, capital] = metrics.map(|value| units(value.into()));
    let descriptor = file.add(format!(
        "<< /Type /FontDescriptor /FontName /{name} /Flags 4 /FontBBox [{bounds}] /ItalicAngle 0 \
         /Ascent {ascent} /Descent {descent} /CapHeight {capital} /StemV 80 /FontFile2 {program} 0 R >>"
    ));
    let width = |&glyph: &u16| {
        let advance = face.glyph_hor_advance(ttf_parser::GlyphId(glyph)).unwrap_or(0);
        format!("{glyph} [{}] ", units(advance.into()))
    };
    let widths: String = used.keys().map(width).collect();
    let descendant = file.add(format!(
        "<< /Type /Font /Subtype /CIDFontType2 /BaseFont /{name} /CIDSystemInfo << /Registry (Adobe) \
         /Ordering (Identity) /Supplement 0 >> /FontDescriptor {descriptor} 0 R /CIDToGIDMap /Identity \
         /W [{widths}] >>"
    ));
    let meaning = file.stream("", meaning(used).as_bytes());
    file.add(format!(
        "<< /Type /Font /Subtype /Type0 /BaseFont /{name} /Encoding /Identity-H /DescendantFonts \
         [{descendant} 0 R] /ToUnicode {meaning} 0 R >>"
    ))
}

fn meaning(used: &BTreeMap<u16, char>) -> String {
    let mut table = String::from(
        "/CIDInit /ProcSet findresource begin\n12 dict begin\nbegincmap\n/CIDSystemInfo << /Registry \
         (Adobe) /Ordering (UCS) /Supplement 0 >> def\n/CMapName /Adobe-Identity-UCS def\n/CMapType 2 \
         def\n1 begincodespacerange\n<0000> <ffff>\nendcodespacerange\n",
    );
    let pairs: Vec<(&u16, &char)> = used.iter().collect();
    // A block has at most a hundred entries.
    for block in pairs.chunks(100) {
        let _ = writeln!(table, "{} beginbfchar", block.len());
        for (glyph, character) in block {
            let mut units = [0; 2];
            let units = character.encode_utf16(&mut units);
            let hex: String = units.iter().map(|unit| format!("{unit:04x}")).collect();
            let _ = writeln!(table, "<{glyph:04x}> <{hex}>");
        }
        table.push_str("endbfchar\n");
    }
    table + "endcmap\nCMapName currentdict /CMap defineresource pop\nend\nend\n"
}

struct PdfFile {
    bytes: Vec<u8>,
    objects: Vec<usize>,
}

impl PdfFile {
    fn add(&mut self, object: impl AsRef<[u8]>) -> usize {
        self.objects.push(self.bytes.len());
        let number = self.objects.len();
        self.bytes.extend_from_slice(format!("{number} 0 obj\n").as_bytes());
        self.bytes.extend_from_slice(object.as_ref());
        self.bytes.extend_from_slice(b"\nendobj\n");
        number
    }

    /// Adds compressed bytes; returns the number of their object.
    fn stream(&mut self, more: &str, content: &[u8]) -> usize {
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
        packed.write_all(content).expect("memory takes all");
        let packed = packed.finish().expect("memory takes all");
        let head = format!("<< {more}/Filter /FlateDecode /Length {} >>\nstream\n", packed.len());
        self.add([head.as_bytes(), &packed, b"\nendstream"].concat())
    }

    fn finish(mut self, catalog: usize) -> Vec<u8> {
        let (start, count) = (self.bytes.len(), self.objects.len() + 1);
        let mut table = format!("xref\n0 {count}\n0000000000 65535 f \n");
        for object in &self.objects {
            let _ = writeln!(table, "{object:010} 00000 n ");
        }
        let _ = writeln!(
            table,
            "trailer\n<< /Size {count} /Root {catalog} 0 R >>\nstartxref\n{start}\n%%EOF"
        );
        self.bytes.extend_from_slice(table.as_bytes());
        self.bytes
    }
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use flate2::read::ZlibDecoder;

    use super::super::canvas::Rect;
    use super::super::canvas::Size;
    use super::*;

    fn find(bytes: &[u8], what: &[u8]) -> Option<usize> {
        bytes.windows(what.len()).position(|window| window == what)
    }

    fn objects(file: &[u8]) -> Vec<Vec<u8>> {
        let tail = String::from_utf8_lossy(&file[file.len() - 60..]).into_owned();
        let start = tail.split("startxref\n").nth(1).unwrap().lines().next().unwrap();
        let table = String::from_utf8(file[start.parse::<usize>().unwrap()..].to_vec()).unwrap();
        let rows = table.lines().filter(|line| line.ends_with(" 00000 n "));
        let object = |(at, row): (usize, &str)| {
            let start: usize = row[..10].parse().unwrap();
            let head = format!("{} 0 obj\n", at + 1);
            assert!(file[start..].starts_with(head.as_bytes()), "object {}", at + 1);
            let body = &file[start + head.len()..];
            body[..find(body, b"\nendobj").unwrap()].to_vec()
        };
        rows.enumerate().map(object).collect()
    }

    fn unpacked(object: &[u8]) -> Option<Vec<u8>> {
        let start = find(object, b"stream\n")? + 7;
        let mut content = Vec::new();
        ZlibDecoder::new(&object[start..]).read_to_end(&mut content).ok()?;
        Some(content)
    }

    #[test]
    fn every_shape_is_on_the_page_and_text_can_be_read() {
        let mut canvas = Figure::new(Size::Screen, 200.0, 100.0);
        canvas.line((0.0, 1.0), (10.0, 1.0), Colour(0xff0000), 2.0);
        canvas.stroke("M0 0L5 5", Colour(0x00ff00), Pen::Dashed(1.0));
        let rect = Rect { left: 10.0, top: 20.0, width: 30.0, height: 40.0 };
        canvas.clipped(rect, |canvas| canvas.circle((20.0, 30.0), 3.0, Colour(0x0000ff)));
        canvas.ring((1.0, 1.0), 1.0, Colour(0));
        canvas.text((50.0, 60.0), "Fx (N·m) ±10⁻³", Style::START);
        canvas.text((5.0, 6.0), "bold", Style { upright: true, ..Style::TITLE });
        let file = pdf(&canvas);
        let objects = objects(&file);
        let texts: Vec<String> = objects
            .iter()
            .filter_map(|object| unpacked(object))
            .filter_map(|content| String::from_utf8(content).ok())
            .collect();
        let page = texts.iter().find(|text| text.contains(" cm\n")).unwrap();
        assert!(page.starts_with("0.75 0 0 -0.75 0 75 cm\n"), "{page}");
        assert!(page.contains("1 0 0 RG 2 w 1 j [] 0 d\n0 1 m 10 1 l S\n"), "{page}");
        assert!(page.contains("0 1 0 RG 1 w 0 j [5 3] 0 d\n0 0 m 5 5 l S\n"), "{page}");
        assert!(page.contains("q\n10 20 m 40 20 l 40 60 l 10 60 l h W n\n0 0 1 rg\n23 30 m "));
        assert_eq!((page.matches(" c ").count(), page.matches("\nQ\n").count()), (8, 1));
        // The glyphs of the text map back to the text through their table.
        let tables: Vec<&String> = texts.iter().filter(|text| text.contains("begincmap")).collect();
        assert_eq!(tables.len(), 2);
        let read = |table: &str, glyphs: &str| -> String {
            let character = |glyph: &str| {
                let entry = format!("<{glyph}> <");
                let (_, rest) = table.split_once(&entry).unwrap();
                char::from_u32(u32::from_str_radix(&rest[..4], 16).unwrap()).unwrap()
            };
            (0..glyphs.len() / 4).map(|at| character(&glyphs[4 * at..4 * at + 4])).collect()
        };
        let shown: Vec<&str> = page
            .split('<')
            .skip(1)
            .filter_map(|rest| rest.split_once("> Tj").map(|(glyphs, _)| glyphs))
            .collect();
        assert_eq!(read(tables[0], shown[0]), "Fx (N·m) ±10⁻³");
        assert_eq!(read(tables[1], shown[1]), "bold");
        // Rotated to the left and centred: half the width below its position.
        assert!(page.contains("0 -13 -13 0 5 "), "{page}");
        let leaf = objects.iter().find(|object| find(object, b"/MediaBox").is_some()).unwrap();
        assert!(find(leaf, b"[0 0 150 75]").is_some());
        // ISO 32000-1, table 30: readers show no page of another type.
        assert!(find(leaf, b"/Type /Page ").is_some());
    }

    #[test]
    fn the_same_drawing_makes_the_same_bytes() {
        let figure = || {
            let mut canvas = Figure::new(Size::Screen, 20.0, 10.0);
            canvas.text((1.0, 1.0), "a", Style::LABEL);
            canvas
        };
        assert_eq!(pdf(&figure()), pdf(&figure()));
    }
}
