//! What stands below the panels of box plots.

use super::super::canvas::{Anchor, Figure, Rect, Style};
use super::super::size::Size;
use super::names::Names;
use trial::ConditionRow;

const SMALL: Style = Style { size: 9.0, ..Style::LABEL };

/// What stands below the boxes: their conditions, and of how many values each is. Upright conditions stand only
/// below the last panel of a column, as its boxes stand below one another.
pub(super) struct BoxLabels<'a> {
    conditions: Vec<&'a str>,
    names: Names,
    counts: Names,
    /// Whether `n` stands once beside the numbers, where it would not fit before each.
    is_counted_once: bool,
}

impl<'a> BoxLabels<'a> {
    pub(super) fn new(size: Size, rows: &[&'a ConditionRow], width: f64) -> Self {
        let mut conditions: Vec<&str> = Vec::new();
        for ConditionRow { condition, .. } in rows {
            if !conditions.contains(&condition.as_str()) {
                conditions.push(condition);
            }
        }
        let pitch = width / conditions.len() as f64;
        let names = Names::new((size, Style::LABEL), &conditions, pitch);
        let counts = |is_counted_once| {
            let counts: Vec<String> = rows.iter().map(|row| count(row, is_counted_once)).collect();
            Names::new((size, SMALL), &counts, pitch)
        };
        let is_counted_once = !counts(false).are_in_one_line();
        Self { conditions, names, counts: counts(is_counted_once), is_counted_once }
    }

    /// From the edge of a panel to the end of what stands below it.
    pub(super) fn height(&self) -> f64 {
        self.to_counts() + self.counts.height
    }

    /// What stands below the last panel more than below the others.
    pub(super) fn below_last(&self) -> f64 {
        if self.names.are_upright() { self.names.height } else { 0.0 }
    }

    fn to_counts(&self) -> f64 {
        if self.names.are_upright() { -3.0 } else { self.names.height - 3.0 }
    }

    /// Below a panel: `is_last` in its column.
    pub(super) fn draw(
        &self,
        canvas: &mut Figure,
        area: Rect,
        boxes: &[&ConditionRow],
        is_last: bool,
    ) {
        let edge = area.bottom();
        let counts = edge + self.to_counts();
        for row in boxes {
            let x = self.middle(area, &row.condition);
            self.counts.draw(canvas, (x, counts), &count(row, self.is_counted_once));
        }
        if self.is_counted_once {
            let at = (area.left - 7.0, counts + 16.0);
            canvas.text(at, "n", Style { anchor: Anchor::End, ..SMALL });
        }
        let names = match self.names.are_upright() {
            true if !is_last => return,
            true => counts + self.counts.height,
            false => edge,
        };
        for condition in &self.conditions {
            self.names.draw(canvas, (self.middle(area, condition), names), condition);
        }
    }

    pub(super) fn box_pitch(&self, area: Rect) -> f64 {
        area.width / self.conditions.len() as f64
    }

    /// The middle of a condition's box.
    pub(super) fn middle(&self, area: Rect, condition: &str) -> f64 {
        let position = self.conditions.iter().position(|other| *other == condition);
        area.left + (position.unwrap_or(0) as f64 + 0.5) * self.box_pitch(area)
    }
}

fn count(row: &ConditionRow, is_counted_once: bool) -> String {
    let n = row.statistics.n;
    if is_counted_once { n.to_string() } else { format!("n = {n}") }
}
