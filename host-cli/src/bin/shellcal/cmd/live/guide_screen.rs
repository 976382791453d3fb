//! Display of the next planned load, above the traces: in large type if there is room.

use crossterm::style::{Attribute, Color};
use font8x8::legacy::{BASIC_LEGACY, LATIN_LEGACY};
use live_view::{GuidePhase, GuideView};

use super::cells::{ACROSS, Area, CellGrid, CharacterCanvas, DOWN};
use super::screen::{LiveScreen, decimals};

/// Dots of a letter, across and down.
const LETTER: usize = 8;

/// Minimum number of rows of a screen for large type, and maximum number of lines of large type.
const LEAST_ROWS: u16 = 20;
const MOST_LINES: usize = 2;

/// Length in characters of the bar that shows how long a load was held.
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
        used + 1
    }

    /// The line with the number of the load, the instruction, the time held, the load measured now, and the
    /// remaining share of the gain.
    fn guide_line(&self, guide: &GuideView) -> String {
        let GuideView { number, count, recorded, ref group, phase, held, .. } = *guide;
        if phase == GuidePhase::Done {
            return "r ends the recording, q the view".to_owned();
        }
        let filled = (held * BAR as f64).round() as usize;
        let what = match phase {
            GuidePhase::Rest => "leave the sensor unloaded".to_owned(),
            GuidePhase::Hang => "hang it".to_owned(),
            GuidePhase::Hold => {
                format!("hold still {}{}", "#".repeat(filled), ".".repeat(BAR - filled))
            }
            GuidePhase::Release => "recorded: hang the next".to_owned(),
            GuidePhase::Done => String::new(),
        };
        let percent = 100.0 * guide.remaining_gain;
        let now = self.model.traces(1).into_iter().filter(|trace| !trace.unit.is_empty());
        let now = now.zip(guide.wrench).filter(|(_, planned)| *planned != 0.0).map(|(trace, _)| {
            let digits = decimals(trace.range.1 - trace.range.0);
            format!("  {} {:+.digits$} {}", trace.name, trace.value, trace.unit)
        });
        let now: String = now.take(3).collect();
        format!("{number}/{count} `{group}`: {what}{now}  {recorded} done, {percent:.0} % left")
    }

    /// Draws lines of letters of eight by eight dots, broken between words; returns the number of rows used.
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
