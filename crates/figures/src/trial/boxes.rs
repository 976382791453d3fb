//! Box plots by condition: drag energy, electrical energy and specific resistance, per trial and per stride.

use super::labels::BoxLabels;
use super::{
    Colour, Figure, LEFT_MARGIN, Panel, Pen, PlotAxis, Rect, Size, Style, TOP, ValueRange, WIDTH,
    empty_figure, number, palette, point, titled,
};
use trial::{ConditionRow, Per, Quantity, Statistics};

const HEIGHT: f64 = 150.0;
const PITCH: f64 = 185.0;
const KEY_PITCH: f64 = 15.0;
const FILL: Colour = Colour(0xd8e6f0);
/// Maximum number of values of a condition that are drawn as points: quartiles of so few say little.
const MOST_POINTS: usize = 12;

/// Draws a box per condition, in the order of `rows`: quartiles and median, Tukey's whiskers, outliers as open
/// circles, the mean as a diamond, up to twelve values as points. Left per trial, right per stride. Quantities
/// without values are omitted.
pub fn box_figure(size: Size, title: &str, rows: &[ConditionRow]) -> Figure {
    let of = |quantity: Quantity, per: Per| -> Vec<&ConditionRow> {
        rows.iter().filter(|row| row.quantity == quantity && row.per == per).collect()
    };
    let shown: Vec<_> = Quantity::COMPARED
        .into_iter()
        .filter(|&quantity| Per::ALL.into_iter().any(|per| !of(quantity, per).is_empty()))
        .collect();
    if shown.is_empty() {
        return empty_figure(size, title, "no condition has an energy or a specific resistance");
    }
    let width = (size.width(WIDTH) - 2.0 * (LEFT_MARGIN + 8.0) - 28.0) / 2.0;
    let drawn: Vec<&ConditionRow> =
        rows.iter().filter(|row| Quantity::COMPARED.contains(&row.quantity)).collect();
    let labels = BoxLabels::new(size, &drawn, width);
    let pitch = PITCH + labels.height();
    let bottom = TOP - 8.0 + pitch * shown.len() as f64 + labels.below_last();
    let key = if size.is_narrow() { KEY_PITCH } else { 0.0 };
    let mut canvas = titled(size, bottom + 22.0 + key, title);
    for (row, &quantity) in shown.iter().enumerate() {
        for (column, per) in Per::ALL.into_iter().enumerate() {
            let boxes = of(quantity, per);
            if boxes.is_empty() {
                continue;
            }
            let left = LEFT_MARGIN + 8.0 + (width + LEFT_MARGIN + 12.0) * column as f64;
            let top = TOP + pitch * row as f64;
            let area = Rect { left, top, width, height: HEIGHT };
            let is_last = shown[row + 1..].iter().all(|&below| of(below, per).is_empty());
            draw_boxes(&mut canvas, area, (quantity, per), &boxes, &labels);
            labels.draw(&mut canvas, area, &boxes, is_last);
        }
    }
    draw_key(&mut canvas, bottom + 10.0, size);
    canvas
}

fn draw_key(canvas: &mut Figure, y: f64, size: Size) {
    let left = LEFT_MARGIN + 8.0;
    canvas.text((left, y), "box: quartiles and median; whiskers: Tukey's, 1.5 IQR;", Style::START);
    let (right, y) = match size.is_narrow() {
        true => (left + 4.0, y + KEY_PITCH),
        false => (left + 332.0, y),
    };
    canvas.ring((right, y - 4.0), 2.8, palette::INK);
    canvas.text((right + 8.0, y), "outlier;", Style::START);
    draw_diamond(canvas, right + 70.0, y - 4.0);
    canvas.text((right + 78.0, y), "mean;", Style::START);
    draw_point(canvas, right + 122.0, y - 4.0);
    canvas.text((right + 128.0, y), &format!("value (n ≤ {MOST_POINTS})"), Style::START);
}

fn draw_point(canvas: &mut Figure, x: f64, y: f64) {
    canvas.circle((x, y), 1.8, palette::series(0));
}

fn draw_diamond(canvas: &mut Figure, x: f64, y: f64) {
    let diamond = format!("M{}l4 4l4 -4l-4 -4Z", point(x - 4.0, y));
    canvas.fill(&diamond, palette::series(1));
    canvas.stroke(diamond, palette::INK, Pen::Round(0.8));
}

fn draw_boxes(
    canvas: &mut Figure,
    area: Rect,
    (quantity, per): (Quantity, Per),
    boxes: &[&ConditionRow],
    labels: &BoxLabels<'_>,
) {
    // Energies of strides are some mJ. Drag is −Fx; a negative energy is lost.
    let (name, factor, unit) = match quantity {
        Quantity::DragEnergy => ("drag energy Fx·l", 1e3, "mJ"),
        _ => (quantity.name(), 1.0, quantity.unit()),
    };
    let ends = boxes.iter().flat_map(|row| {
        let Statistics { whisker_low, whisker_high, outliers, mean, .. } = &row.statistics;
        outliers.iter().copied().chain([*whisker_low, *whisker_high, *mean])
    });
    let range = ValueRange::over(ends.map(|end| factor * end));
    let panel = Panel {
        area,
        x: PlotAxis::linear("", "", ValueRange { low: 0.0, high: 1.0 }),
        y: PlotAxis::linear(name, unit, range).padded(0.08),
    };
    panel.draw_grid(canvas);
    let half = (0.3 * labels.box_pitch(area)).min(22.0);
    for row in boxes {
        let position = |value: f64| panel.place(0.0, factor * value).1;
        draw_box(canvas, labels.middle(area, &row.condition), half, &row.statistics, position);
    }
    panel.draw_stacked_frame(canvas, false);
    let label = format!("per {}", per.name());
    canvas.text((area.left, area.top - 7.0), &label, Style::START);
}

fn draw_box(canvas: &mut Figure, x: f64, half: f64, s: &Statistics, position: impl Fn(f64) -> f64) {
    let (left, right) = (x - half, x + half);
    let (q1, q3) = (position(s.q1), position(s.q3));
    for (end, quartile) in [(position(s.whisker_low), q1), (position(s.whisker_high), q3)] {
        canvas.line((x, quartile), (x, end), palette::INK, 1.0);
        canvas.line((x - 0.5 * half, end), (x + 0.5 * half, end), palette::INK, 1.0);
    }
    let outline =
        format!("M{}H{}V{}H{}Z", point(left, q1), number(right), number(q3), number(left));
    canvas.fill(&outline, FILL);
    canvas.stroke(outline, palette::INK, Pen::Round(1.0));
    let median = position(s.median);
    canvas.line((left, median), (right, median), palette::INK, 2.0);
    draw_diamond(canvas, x, position(s.mean));
    for &outlier in &s.outliers {
        canvas.ring((x, position(outlier)), 2.8, palette::INK);
    }
    if s.values.len() <= MOST_POINTS {
        // Alternately left and right of the mean, so that two equal values are visible.
        for (i, &value) in s.values.iter().enumerate() {
            let aside = if i % 2 == 0 { -0.5 } else { 0.5 };
            draw_point(canvas, x + aside * half, position(value));
        }
    }
}
