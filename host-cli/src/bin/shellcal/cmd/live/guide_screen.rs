//! Display of the next planned load, above the traces: in large type if there is room.

use calibration::quality::significant;
use crossterm::style::{Attribute, Color};
use font8x8::legacy::{BASIC_LEGACY, LATIN_LEGACY};
use live_view::{ErrorPoint, GuidePhase, GuideView};

use super::cells::{ACROSS, Area, CellGrid, CharacterCanvas, DOWN};
use super::screen::{LiveScreen, decimals};

/// Dots of a letter, across and down.
const LETTER: usize = 8;

/// Minimum number of rows of a screen for large type, and maximum number of lines of large type.
const LEAST_ROWS: u16 = 20;
const MOST_LINES: usize = 2;

/// Rows and maximum columns of the curve of errors, and the minimum number of rows of a screen that shows it.
const CURVE: u16 = 4;
const MOST_OF_CURVE: u16 = 72;
const ROOM_FOR_CURVE: u16 = 34;

const BAR: usize = 10;

impl LiveScreen<'_> {
    /// Draws the next load at the top of `area`; returns the number of rows used.
    pub(super) fn draw_guide(&self, grid: &mut CellGrid, area: Area) -> u16 {
        let Some(guide) = self.guide else { return 0 };
        let text = match guide.phase {
            GuidePhase::Done => format!("all {} loads are recorded", guide.count),
            _ => guide.text.clone(),
        };
        let used = match area.height + 3 >= LEAST_ROWS {
            true => self.draw_large(grid, area, &text),
            false => {
                let style = self.style(Some(Color::DarkCyan), Some(Attribute::Bold));
                self.put(grid, area.x, area.y, &text, style);
                1
            }
        };
        let line = self.guide_line(guide);
        self.put(grid, area.x, area.y + used, &line, self.style(None, Some(Attribute::Bold)));
        used + 1 + self.draw_errors(grid, Area { y: area.y + used + 1, ..area })
    }

    /// Draws the error on new poses as a line, and as a curve if there is room; then the newest finding.
    /// Returns the number of rows used.
    fn draw_errors(&self, grid: &mut CellGrid, area: Area) -> u16 {
        let Some(guide) = self.guide.filter(|guide| guide.remaining_gain.is_none()) else {
            return 0;
        };
        self.put(grid, area.x, area.y, &error_text(guide), self.style(None, None));
        let mut used = 1;
        let largest = |point: &ErrorPoint| point.upper[0];
        let most = guide.errors.iter().map(largest).fold(0.0, f64::max);
        if area.height >= ROOM_FOR_CURVE && most > 0.0 {
            let columns = usize::from(area.width.min(MOST_OF_CURVE));
            let mut canvas = CharacterCanvas::new(columns * ACROSS, usize::from(CURVE) * DOWN);
            let (across, down) = (columns * ACROSS - 1, usize::from(CURVE) * DOWN - 1);
            let newest = guide.errors.last().map_or(1, |point| point.loads);
            for point in &guide.errors {
                let x = across * point.loads / newest.max(1);
                for value in [point.error[0], point.upper[0]] {
                    let y = down as f64 * (1.0 - value / most);
                    canvas.dot(x as i64, y.round() as i64);
                }
            }
            let style = self.style(Some(Color::DarkCyan), None);
            self.draw_canvas(grid, (area.x, area.y + used), (&canvas, style), |_, _| None);
            used += CURVE;
        }
        if !guide.finding.is_empty() {
            let style = self.style(Some(Color::DarkRed), Some(Attribute::Bold));
            self.put(grid, area.x, area.y + used, &guide.finding, style);
            used += 1;
        }
        used
    }

    /// The line with the number of the load, the instruction, the time held, the load measured now, and the
    /// remaining share of the gain.
    fn guide_line(&self, guide: &GuideView) -> String {
        let GuideView { number, count, recorded, ref group, phase, held, .. } = *guide;
        if phase == GuidePhase::Done {
            return "q ends".to_owned();
        }
        let filled = (held * BAR as f64).round() as usize;
        let what = match phase {
            GuidePhase::Unloaded => "leave the sensor unloaded".to_owned(),
            GuidePhase::Hang => "hang it".to_owned(),
            GuidePhase::Hold => {
                format!("hold still {}{}", "#".repeat(filled), ".".repeat(BAR - filled))
            }
            GuidePhase::Release => "recorded: hang the next".to_owned(),
            GuidePhase::Done => String::new(),
        };
        let left = guide
            .remaining_gain
            .map_or_else(String::new, |share| format!(", {:.0} % left", 100.0 * share));
        let now = self.display.traces(1).into_iter().filter(|trace| !trace.unit.is_empty());
        let now = now.zip(guide.wrench).filter(|(_, planned)| *planned != 0.0).map(|(trace, _)| {
            let digits = decimals(trace.range.1 - trace.range.0);
            format!("  {} {:+.digits$} {}", trace.name, trace.value, trace.unit)
        });
        let now: String = now.take(3).collect();
        format!("{number}/{count} `{group}`: {what}{now}  {recorded} done{left}")
    }

    fn draw_large(&self, grid: &mut CellGrid, area: Area, text: &str) -> u16 {
        let (columns, rows) = (LETTER / ACROSS, (LETTER / DOWN) as u16);
        let lines = broken(text, usize::from(area.width) / columns);
        let style = self.style(Some(Color::DarkCyan), Some(Attribute::Bold));
        for (position, line) in (0..).zip(&lines) {
            let mut canvas =
                CharacterCanvas::new(columns * line.chars().count(), usize::from(rows));
            for (at, letter) in line.chars().enumerate() {
                for (y, bits) in (0..).zip(dots(letter)) {
                    let set = (0..LETTER).filter(|x| bits >> x & 1 == 1);
                    set.for_each(|x| canvas.dot((at * LETTER + x) as i64, y));
                }
            }
            let at = (area.x, area.y + position * rows);
            self.draw_canvas(grid, at, (&canvas, style), |_, _| None);
        }
        rows * lines.len() as u16
    }
}

fn error_text(guide: &GuideView) -> String {
    let Some(ErrorPoint { error, upper, .. }) = guide.errors.last() else {
        return "held-out error: known after some ten loads".to_owned();
    };
    let part = |at: usize, unit: &str| {
        let [error, upper] = [error[at], upper[at]].map(|value| significant(value, 2));
        let limit = guide.limits[at];
        let limit = limit.map_or_else(String::new, |limit| format!(", wanted {limit} {unit}"));
        format!("{error} {unit} (95 %: {upper}{limit})")
    };
    format!("held-out error: {}, {}", part(0, "N"), part(1, "N·m"))
}

/// The rows of dots of a letter, the first on the left in the lowest bit.
fn dots(letter: char) -> [u8; LETTER] {
    let letter = if letter == '−' { '-' } else { letter };
    match letter as usize {
        code @ 0..128 => BASIC_LEGACY[code],
        code @ 0xA0..=0xFF => LATIN_LEGACY[code - 0xA0],
        _ => BASIC_LEGACY['?' as usize],
    }
}

/// Breaks a text into lines of at most `width` letters; text beyond the last line is cut off.
fn broken(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        let last = lines.last_mut().expect("there is a first");
        let length = last.chars().count() + 1 + word.chars().count();
        match last.is_empty() || length <= width {
            true => {
                let space = if last.is_empty() { "" } else { " " };
                last.push_str(&format!("{space}{word}"));
            }
            false => lines.push(word.to_owned()),
        }
    }
    lines.truncate(MOST_LINES);
    lines.iter().map(|line| line.chars().take(width).collect()).collect()
}
