//! Labels below box plots: in one line, broken at their separators, or upright.

use super::super::canvas::{Anchor, Figure, Rect, Size, Style};
use super::super::lettering;
use trial::ConditionRow;

const LINE: f64 = 12.0;
const ONE_LINE: f64 = 16.0;
const MOST_LINES: usize = 4;
/// The maximum length of upright names, some 35 letters: longer ones would dwarf the panels.
const MOST_ROOM: f64 = 190.0;
const GAP: f64 = 6.0;

#[derive(Clone, Copy, Debug)]
struct Names {
    style: Style,
    lines: usize,
    room: f64,
    height: f64,
}

impl Names {
    /// Chooses a layout for names whose centres are `pitch` apart.
    fn new<S: AsRef<str>>((size, style): (Size, Style), names: &[S], pitch: f64) -> Self {
        let style = Style { size: size.letters(style.size), ..style };
        let holds = |set: &Self| names.iter().all(|name| set.holds(&set.broken(name.as_ref())));
        let lying = Self { style, lines: MOST_LINES, room: pitch - GAP, height: 0.0 };
        if holds(&lying) {
            let lines = names.iter().map(|name| lying.broken(name.as_ref()).len()).max();
            return Self { height: ONE_LINE + LINE * (lines.unwrap_or(1) - 1) as f64, ..lying };
        }
        let style = Style { upright: true, anchor: Anchor::End, ..style };
        let lines = ((pitch / LINE) as usize).clamp(1, 2);
        let upright = |room| Self { style, lines, room, height: 7.0 + room };
        // The shortest lines that hold all names.
        let rooms = (4..).map(|step| 5.0 * f64::from(step)).take_while(|room| *room < MOST_ROOM);
        rooms.map(upright).find(holds).unwrap_or(upright(MOST_ROOM))
    }

    fn are_upright(&self) -> bool {
        self.style.upright
    }

    fn are_in_one_line(&self) -> bool {
        !self.are_upright() && self.height <= ONE_LINE
    }

    /// Draws a name below an edge. A name too long loses its middle, as names differ at their ends;
    /// a tooltip shows it whole.
    fn draw(&self, canvas: &mut Figure, (x, edge): (f64, f64), name: &str) {
        let lines = self.shortened(name);
        let title = (lines != self.broken(name)).then_some(name);
        for (i, line) in lines.iter().enumerate() {
            let at = match self.style.upright {
                false => (x, edge + ONE_LINE + LINE * i as f64),
                true => {
                    let aside = i as f64 - 0.5 * (lines.len() - 1) as f64;
                    (x + LINE * aside + 0.36 * self.style.size, edge + 7.0)
                }
            };
            canvas.explained_text(at, (line, title), self.style);
        }
    }

    fn holds(&self, lines: &[String]) -> bool {
        lines.len() <= self.lines && lines.iter().all(|line| self.fits(line))
    }

    fn fits(&self, line: &str) -> bool {
        lettering::width(line, self.style) <= self.room
    }

    /// Breaks the name into lines as full as possible; a part without a separator may be too long.
    fn broken(&self, name: &str) -> Vec<String> {
        let mut lines: Vec<String> = vec![String::new()];
        for part in parts(name) {
            match lines.last_mut() {
                Some(line) if line.is_empty() || self.fits(format!("{line}{part}").trim_end()) => {
                    line.push_str(part);
                }
                _ => lines.push(part.to_owned()),
            }
        }
        lines.iter().map(|line| line.trim_end().to_owned()).collect()
    }

    fn shortened(&self, name: &str) -> Vec<String> {
        let letters: Vec<char> = name.chars().collect();
        let cut = |kept: usize| {
            let (first, last) = (kept.div_ceil(2), letters.len() - kept / 2);
            let ends = [&letters[..first], &['…'], &letters[last..]].concat();
            self.broken(&ends.into_iter().collect::<String>())
        };
        let whole = std::iter::once(self.broken(name));
        let mut tries = whole.chain((0..letters.len()).rev().map(cut));
        tries.find(|lines| self.holds(lines)).unwrap_or_default()
    }
}

/// Splits a name into parts that end with a separator. A minus before a number is not a separator.
fn parts(name: &str) -> Vec<&str> {
    let mut parts = Vec::new();
    let (mut start, mut before) = (0, ' ');
    for (at, character) in name.char_indices() {
        if matches!(before, ' ' | '-' | '_') && at > start {
            let is_minus = before == '-' && name[..at - 1].ends_with([' ', '_', '-']);
            if !is_minus && character != ' ' && name[start..at].contains(char::is_alphanumeric) {
                parts.push(&name[start..at]);
                start = at;
            }
        }
        before = character;
    }
    parts.push(&name[start..]);
    parts
}

const SMALL: Style = Style { size: 9.0, ..Style::LABEL };

/// Conditions below the boxes, and the number of values of each. Upright conditions appear only
/// below the last panel of a column, as the boxes of its panels are aligned.
pub(super) struct BoxLabels<'a> {
    conditions: Vec<&'a str>,
    names: Names,
    counts: Names,
    /// True if `n` appears once beside the numbers, because it would not fit before each.
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

    pub(super) fn height(&self) -> f64 {
        self.to_counts() + self.counts.height
    }

    pub(super) fn below_last(&self) -> f64 {
        if self.names.are_upright() { self.names.height } else { 0.0 }
    }

    fn to_counts(&self) -> f64 {
        if self.names.are_upright() { -3.0 } else { self.names.height - 3.0 }
    }

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

    pub(super) fn middle(&self, area: Rect, condition: &str) -> f64 {
        let position = self.conditions.iter().position(|other| *other == condition);
        area.left + (position.unwrap_or(0) as f64 + 0.5) * self.box_pitch(area)
    }
}

fn count(row: &ConditionRow, is_counted_once: bool) -> String {
    let n = row.statistics.n;
    if is_counted_once { n.to_string() } else { format!("n = {n}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_break_after_their_separators() {
        for (name, broken) in [
            ("free", vec!["free"]),
            ("cheetah-trot_soft 3 cm", vec!["cheetah-", "trot_", "soft ", "3 ", "cm"]),
            ("tilt -5 N", vec!["tilt ", "-5 ", "N"]),
            ("--", vec!["--"]),
            ("", vec![""]),
            ("0 … 3 cm", vec!["0 ", "… 3 ", "cm"]),
        ] {
            assert_eq!(parts(name), broken, "{name}");
        }
    }

    #[test]
    fn long_labels_are_wrapped_then_rotated_then_shortened() {
        let style = (Size::Screen, Style::LABEL);
        let names = ["cheetah-trot-soft-terrain-0.5m/s", "free"];
        let set = |pitch| Names::new(style, &names, pitch);
        let wide = set(300.0);
        assert_eq!((wide.shortened(names[0]).len(), wide.height), (1, ONE_LINE));
        assert_eq!(set(100.0).shortened(names[0]), ["cheetah-trot-", "soft-terrain-", "0.5m/s"]);
        assert_eq!(set(100.0).height, 16.0 + 2.0 * LINE);
        let upright = set(30.0);
        assert!(upright.style.upright && upright.height < 7.0 + MOST_ROOM);
        assert_eq!(upright.shortened(names[0]).concat(), names[0]);
        let long = "cheetah-trot-over-carpet-and-soft-terrain-0.5m/s";
        let cut = Names::new(style, &[long], 12.0).shortened(long);
        assert!(cut.len() == 1 && cut[0].contains('…'), "{cut:?}");
        assert!(cut[0].starts_with("cheetah-trot") && cut[0].ends_with("0.5m/s"), "{cut:?}");
    }
}
