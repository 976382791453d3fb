//! The screen of `shellcal live`: traces on the left, channels and arrows on the right.

use crossterm::style::{Attribute, Color, ContentStyle};
use live_view::{ChannelState, ChannelView, GuideView, LiveDisplay, TraceView};
use shell_data::escape::is_invisible;

use super::cells::{ACROSS, Area, CellGrid, CharacterCanvas, DOWN};

#[derive(Debug)]
pub(super) struct LiveScreen<'a> {
    pub(super) display: &'a LiveDisplay,
    pub(super) guide: Option<&'a GuideView>,
    pub(super) source: &'a str,
    /// Protocol, rate, losses.
    pub(super) state: &'a str,
    pub(super) recording: Option<&'a str>,
    pub(super) message: &'a str,
    /// True if the terminal cannot show Braille.
    pub(super) ascii: bool,
    pub(super) color: bool,
}

const LEAST: (u16, u16) = (60, 14);

const LEAST_NAME: usize = 8;

/// Columns of the labels of traces.
const LABEL: u16 = 16;

const KEYS: &str = "t tare  T untare  space pause  +/- zoom  m mark  r record  q quit";
const KEYS_OF_GUIDE: &str = "n next load  b undo  t tare  space pause  +/- zoom  m mark  q quit";

impl LiveScreen<'_> {
    pub(super) fn draw(&self, grid: &mut CellGrid) {
        let (width, height) = grid.size();
        if width < LEAST.0 || height < LEAST.1 {
            let (columns, rows) = LEAST;
            let text = format!("the screen is {width} x {height}; {columns} x {rows} are needed");
            self.put(grid, 0, 0, &text, ContentStyle::new());
            return;
        }
        self.draw_header(grid, width);
        let panel = if width >= 120 { 44 } else { 27 };
        let above = 1 + self.draw_guide(grid, Area { x: 0, y: 1, width, height: height - 3 });
        let body = Area { x: 0, y: above, width: width - panel - 1, height: height - 2 - above };
        self.draw_traces(grid, body);
        let right = Area { x: width - panel, width: panel, ..body };
        self.draw_panel(grid, right);
        self.put(grid, 0, height - 2, self.message, ContentStyle::new());
        let keys = if self.guide.is_some() { KEYS_OF_GUIDE } else { KEYS };
        self.put(grid, 0, height - 1, keys, self.style(None, Some(Attribute::Dim)));
    }

    /// Draws the header. State and flags are always shown in full; names get the remaining room.
    fn draw_header(&self, grid: &mut CellGrid, width: u16) {
        let mut flags = String::new();
        if self.display.is_paused() {
            flags += " PAUSED";
        }
        if self.display.tare.is_pending() {
            flags += " TARING";
        }
        let taken = flags.chars().count() + self.state.chars().count() + "   REC   ".len();
        let room = usize::from(width).saturating_sub(taken);
        let source_length = self.source.chars().count();
        if let Some(log) = self.recording {
            // The name of the log gets the room that the source does not need, at least half.
            let room_of_log = (room - source_length.min(room / 2)).max(LEAST_NAME);
            flags += &format!(" REC {}", end_of(log, room_of_log, self.ascii));
        }
        if !flags.is_empty() {
            flags.push(' ');
        }
        let flags_length = flags.chars().count().min(usize::from(width)) as u16;
        let left = usize::from(width - flags_length).saturating_sub(self.state.chars().count() + 3);
        let source = end_of(self.source, left.max(LEAST_NAME), self.ascii);
        let line = format!("{source}  {}", self.state);
        self.put(grid, 0, 0, &line, self.style(None, Some(Attribute::Bold)));
        let style = self.style(Some(Color::DarkYellow), Some(Attribute::Reverse));
        self.put(grid, width - flags_length, 0, &flags, style);
    }

    fn draw_traces(&self, grid: &mut CellGrid, area: Area) {
        let columns = area.width - LABEL;
        let traces = self.display.traces(usize::from(columns) * ACROSS);
        if traces.is_empty() {
            let middle = area.y + area.height / 2;
            self.put(grid, 2, middle, "nothing has arrived so far", ContentStyle::new());
            return;
        }
        // One line is for the time axis.
        let rows = ((area.height - 1) / traces.len() as u16).max(1);
        for (position, trace) in (0..).zip(&traces) {
            let area = Area { y: area.y + position * rows, height: rows, ..area };
            self.draw_trace(grid, area, trace, colour(usize::from(position)));
        }
        let axis = area.y + rows * traces.len() as u16;
        let span = format!("-{} s", self.display.window_s());
        self.put(grid, LABEL, axis, &span, self.style(None, Some(Attribute::Dim)));
        let now = self.display.time_s().map_or_else(String::new, |time_s| format!("{time_s:.1} s"));
        let at = area.width.saturating_sub(now.chars().count() as u16);
        self.put(grid, at, axis, &now, self.style(None, Some(Attribute::Dim)));
        self.draw_marks(grid, area, axis, columns);
    }

    fn draw_trace(&self, grid: &mut CellGrid, area: Area, trace: &TraceView, colour: Color) {
        let (low, high) = trace.range;
        let decimals = decimals(high - low);
        let value = format!("{:<3}{:>+8.decimals$} {}", trace.name, trace.value, trace.unit);
        self.put(grid, area.x, area.y, &value, self.style(Some(colour), Some(Attribute::Bold)));
        let noise = format!("sd {:.*}", decimals + 1, trace.noise);
        let scale = match low == -high {
            true => format!("±{}", short(high)),
            false => format!("{} … {}", short(low), short(high)),
        };
        let dim = self.style(None, Some(Attribute::Dim));
        match area.height {
            1 => {}
            2 => self.put(grid, area.x, area.y + 1, &format!("{noise} {scale}"), dim),
            _ => {
                self.put(grid, area.x, area.y + 1, &noise, dim);
                self.put(grid, area.x, area.y + 2, &scale, dim);
            }
        }
        let (columns, rows) = (usize::from(area.width - LABEL), usize::from(area.height));
        let mut canvas = CharacterCanvas::new(columns, rows);
        let last = (rows * DOWN - 1) as f64;
        let dot = |value: f64| (last * (high - value) / (high - low)).round() as i64;
        let mut before = None;
        for (x, ends) in (0..).zip(&trace.columns) {
            if let Some([least, greatest]) = ends {
                let (mut top, mut bottom) = (dot(*greatest), dot(*least));
                // Join to the column before, so that steep parts stay connected.
                if let Some((top_before, bottom_before)) = before {
                    top = top.min(bottom_before + 1).max(0);
                    bottom = bottom.max(top_before - 1);
                }
                canvas.line((x, top), (x, bottom));
                before = Some((dot(*greatest), dot(*least)));
            }
        }
        let zero = (low <= 0.0 && 0.0 <= high).then(|| dot(0.0) as usize / DOWN);
        let style = self.style(Some(colour), None);
        let line = if self.ascii { '-' } else { '┈' };
        let zero_line = |_, row| (zero == Some(row)).then_some(line);
        self.draw_canvas(grid, (area.x + LABEL, area.y), (&canvas, style), zero_line);
    }

    /// Draws the dots of a canvas; in its empty cells it draws, dimmed, the character that `behind` returns
    /// for the column and row.
    pub(super) fn draw_canvas(
        &self,
        grid: &mut CellGrid,
        (x, y): (u16, u16),
        (canvas, style): (&CharacterCanvas, ContentStyle),
        behind: impl Fn(usize, usize) -> Option<char>,
    ) {
        let dim = self.style(None, Some(Attribute::Dim));
        for (column, row) in canvas.cells() {
            let at = (x + column as u16, y + row as u16);
            match (canvas.character(column, row, self.ascii), behind(column, row)) {
                (Some(dots), _) => grid.put_char(at, dots, style),
                (None, Some(behind)) => grid.put_char(at, behind, dim),
                (None, None) => {}
            }
        }
    }

    fn draw_marks(&self, grid: &mut CellGrid, area: Area, axis: u16, columns: u16) {
        let line = if self.ascii { '|' } else { '╎' };
        let style = self.style(Some(Color::DarkYellow), None);
        for (number, position) in self.display.marks_shown() {
            let column = (position * f64::from(columns)).min(f64::from(columns - 1)) as u16;
            let x = area.x + LABEL + column;
            for y in area.y..axis {
                if grid.is_blank((x, y)) {
                    grid.put_char((x, y), line, style);
                }
            }
            self.put(grid, x, axis, &format!("{number}"), style);
        }
    }

    fn draw_panel(&self, grid: &mut CellGrid, area: Area) {
        let channels = self.display.channels();
        for (position, channel) in (0..).zip(&channels) {
            let line = Area { y: area.y + position, ..area };
            self.draw_channel(grid, line, usize::from(position), channel);
        }
        let used = if channels.is_empty() { 0 } else { channels.len() as u16 + 1 };
        let rest = Area { y: area.y + used, height: area.height.saturating_sub(used), ..area };
        let Some((force, reach)) = self.display.force() else { return };
        if rest.height < 5 {
            return;
        }
        let half = rest.width / 2;
        let left = Area { width: half - 1, ..rest };
        let right = Area { x: rest.x + half, width: half, ..rest };
        let [fx, fy, fz] = force;
        // The first view is from above, with x up and y to the left; the second from the right, with z up and
        // x to the right.
        self.draw_arrow(grid, left, ("top", "x", "y", true), (-fy, fx), reach);
        self.draw_arrow(grid, right, ("side", "z", "x", false), (fx, fz), reach);
    }

    fn draw_channel(&self, grid: &mut CellGrid, area: Area, channel: usize, view: &ChannelView) {
        let y = area.y;
        let (note, tint) = match view.state {
            ChannelState::Fine => (' ', None),
            ChannelState::Outside => ('!', Some(Color::DarkYellow)),
            ChannelState::Saturated => ('#', Some(Color::DarkRed)),
        };
        let label = format!("s{} {:>6.0}{note}", channel + 1, view.reading);
        let style = self.style(tint, None);
        self.put(grid, area.x, y, &label, style);
        let start = area.x + label.chars().count() as u16;
        let width = area.x + area.width - start;
        let (low, high) = match view.range {
            // Leave some room on either side, to show by how much a reading is out of range.
            Some((low, high)) => {
                let room = 0.2 * (high - low).max(1.0);
                (low - room, high + room)
            }
            None => (0.0, 4095.0),
        };
        let position = |value: f64| {
            let share = ((value - low) / (high - low)).clamp(0.0, 1.0);
            start + (share * f64::from(width - 1)).round() as u16
        };
        let (rail, head) = if self.ascii { ('-', 'o') } else { ('─', '●') };
        let dim = self.style(None, Some(Attribute::Dim));
        (start..start + width).for_each(|x| grid.put_char((x, y), rail, dim));
        if let Some((low, high)) = view.range {
            grid.put_char((position(low), y), '[', dim);
            grid.put_char((position(high), y), ']', dim);
        }
        grid.put_char((position(view.reading), y), head, style);
    }

    fn draw_arrow(
        &self,
        grid: &mut CellGrid,
        area: Area,
        (name, up, across, mirrored): (&str, &str, &str, bool),
        (right, above): (f64, f64),
        reach: f64,
    ) {
        let dim = self.style(None, Some(Attribute::Dim));
        let title = format!("{name} {}N", short(reach));
        self.put(grid, area.x, area.y, &title, dim);
        let area = Area { y: area.y + 1, height: area.height - 1, ..area };
        let (columns, rows) = (usize::from(area.width), usize::from(area.height));
        let mut canvas = CharacterCanvas::new(columns, rows);
        let centre = ((columns * ACROSS / 2) as i64, (rows * DOWN / 2) as i64);
        // Dots are square: a cell is twice as high as wide, and has twice as many dots down as across.
        let radius = centre.0.min(centre.1) as f64 - 1.0;
        let tip = (
            centre.0 + (right / reach * radius).round() as i64,
            centre.1 - (above / reach * radius).round() as i64,
        );
        canvas.line(centre, tip);
        for (dx, dy) in [(-1, 0), (1, 0), (0, -1), (0, 1)] {
            canvas.dot(tip.0 + dx, tip.1 + dy);
        }
        let style = self.style(Some(Color::DarkCyan), Some(Attribute::Bold));
        let axes = if self.ascii { ['|', '-', '+'] } else { ['│', '─', '┼'] };
        let (middle, level) = (centre.0 as usize / ACROSS, centre.1 as usize / DOWN);
        let cross = |column, row| match (column == middle, row == level) {
            (true, true) => Some(axes[2]),
            (true, false) => Some(axes[0]),
            (false, true) => Some(axes[1]),
            _ => None,
        };
        self.draw_canvas(grid, (area.x, area.y), (&canvas, style), cross);
        self.put(grid, area.x + middle as u16 + 1, area.y, up, dim);
        let end = if mirrored { area.x } else { area.x + area.width - 1 };
        self.put(grid, end, area.y + (level as u16).saturating_sub(1), across, dim);
    }

    pub(super) fn put(&self, grid: &mut CellGrid, x: u16, y: u16, text: &str, style: ContentStyle) {
        // Names and errors must not contain control sequences for the terminal.
        let text: String = text.chars().filter(|&c| !is_invisible(c)).collect();
        let text = match self.ascii {
            true => text.replace('±', "+-").replace('…', "..").replace('·', "."),
            false => text,
        };
        grid.put_text((x, y), &text, style);
    }

    pub(super) fn style(
        &self,
        colour: Option<Color>,
        attribute: Option<Attribute>,
    ) -> ContentStyle {
        if !self.color {
            return ContentStyle::new();
        }
        let attributes = attribute.as_slice().into();
        ContentStyle { foreground_color: colour, attributes, ..ContentStyle::new() }
    }
}

/// A name cut to the available room; the end of a long path is kept, since it distinguishes paths.
fn end_of(name: &str, room: usize, ascii: bool) -> String {
    let length = name.chars().count();
    if length <= room {
        return name.to_owned();
    }
    let cut = if ascii { ".." } else { "…" };
    let kept = room.saturating_sub(cut.chars().count());
    cut.chars().chain(name.chars().skip(length - kept)).collect()
}

fn colour(position: usize) -> Color {
    use Color::{DarkBlue, DarkCyan, DarkGreen, DarkMagenta, DarkRed, DarkYellow};
    [DarkRed, DarkGreen, DarkBlue, DarkMagenta, DarkYellow, DarkCyan][position % 6]
}

pub(super) fn decimals(length: f64) -> usize {
    (2.0 - length.log10().floor()).clamp(0.0, 6.0) as usize
}

fn short(value: f64) -> String {
    let text = format!("{value:.6}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use calibration::reading_ranges::ReadingRange;
    use live_view::{ErrorPoint, GuidePhase, LiveRow};
    use shell_data::wrench::Axes;

    /// A display with a push to the right and a stroke upwards, one channel out of range, one saturated, and a mark.
    fn display(forces: bool) -> LiveDisplay {
        let ranges = Some(vec![ReadingRange { min: 1000.0, max: 3000.0 }; 8]);
        let mut display = LiveDisplay::new(ranges, 10.0, Axes::ALL);
        for index in 0..1000 {
            let time_s = f64::from(index) / 100.0;
            let wave = (time_s * 2.0).sin();
            let wrench = [1.5 * wave, 0.4, time_s / 5.0 - 1.0, 0.02 * wave, -0.01, 0.0];
            display.push(LiveRow {
                time_s,
                index: i64::from(index),
                readings: Some(std::array::from_fn(|c| 1100.0 + 250.0 * c as f64 + 50.0 * wave)),
                wrench: forces.then_some(wrench),
                saturated: u8::from(index > 950) << 7,
                out_of_range: u8::from(index > 950) << 1,
            });
            if index == 600 {
                display.mark();
            }
        }
        display
    }

    fn screen(display: &LiveDisplay, size: (u16, u16), ascii: bool, color: bool) -> String {
        guided_screen((display, None), size, ascii, color)
    }

    fn guided_screen(
        (display, guide): (&LiveDisplay, Option<&GuideView>),
        size: (u16, u16),
        ascii: bool,
        color: bool,
    ) -> String {
        let screen = LiveScreen {
            display,
            guide,
            source: "/dev/ttyUSB0",
            state: "cobs  00:00:10  100.0 Hz  1000 frames  3 missing",
            recording: Some("log.csv"),
            message: "mark 1 at 6.000 s",
            ascii,
            color,
        };
        let mut grid = CellGrid::new(size);
        screen.draw(&mut grid);
        assert!(color || grid.is_plain(), "without colour there is none, and no other style");
        let lines = grid.text_of_lines();
        lines.iter().map(|line| line.trim_end()).collect::<Vec<_>>().join("\n") + "\n"
    }

    fn assert_golden(name: &str, screen: &str) {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("tests/boards/golden/live")
            .join(name);
        if std::env::var_os("SHELLCAL_BLESS").is_some() {
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, screen).unwrap();
        }
        let golden = std::fs::read_to_string(&path).unwrap();
        assert!(golden == screen, "{name}: `SHELLCAL_BLESS=1` keeps the new one\n{screen}");
    }

    #[test]
    fn screens_of_both_sizes_are_the_golden_ones() {
        assert_golden("forces-80x24.txt", &screen(&display(true), (80, 24), false, false));
        assert_golden("forces-200x60.txt", &screen(&display(true), (200, 60), false, true));
        assert_golden("readings-80x24.txt", &screen(&display(false), (80, 24), false, false));
        assert_golden("ascii-80x24.txt", &screen(&display(true), (80, 24), true, false));
    }

    #[test]
    fn a_planned_load_stands_above_the_traces_in_large_type() {
        let guide = GuideView {
            group: "bow".to_owned(),
            text: "0.5 kg at (30, 0, 40) mm, down".to_owned(),
            wrench: [0.0, 0.0, -4.903, 0.0, 0.147, 0.0],
            number: 3,
            count: 16,
            recorded: 2,
            phase: GuidePhase::Hold,
            held: 0.5,
            remaining_gain: Some(0.72),
            ..GuideView::default()
        };
        let display = display(true);
        let draw = |guide, size, ascii| guided_screen((&display, Some(guide)), size, ascii, false);
        assert_golden("guide-80x24.txt", &draw(&guide, (80, 24), false));
        assert!(draw(&guide, (80, 24), true).is_ascii());
        for width in (1..220).step_by(7) {
            for height in (1..70).step_by(3) {
                draw(&guide, (width, height), false);
            }
        }
        let small = draw(&guide, (80, 15), false);
        assert!(small.contains("0.5 kg at (30, 0, 40) mm, down"), "{small}");
        let done = GuideView { phase: GuidePhase::Done, recorded: 16, ..guide.clone() };
        assert!(draw(&done, (80, 15), false).contains("all 16 loads are recorded"));
        let point = ErrorPoint { loads: 16, error: [0.08, 2e-3], upper: [0.1, 3e-3] };
        let sitting = GuideView {
            remaining_gain: None,
            errors: vec![ErrorPoint { loads: 12, error: [0.2, 5e-3], upper: [0.3, 7e-3] }, point],
            limits: [Some(0.1), None],
            finding: "s3 does not answer".to_owned(),
            ..guide.clone()
        };
        let shown = draw(&sitting, (80, 40), false);
        let error = "0.080 N (95 %: 0.10, wanted 0.1 N), 0.0020 N·m (95 %: 0.0030)";
        assert!(shown.contains(error) && shown.contains("s3 does not answer"), "{shown}");
        for (width, height) in [(80, 15), (60, 14), (200, 60)] {
            assert!(draw(&sitting, (width, height), true).is_ascii());
        }
    }

    #[test]
    fn ascii_is_ascii_and_every_size_is_drawn() {
        let display = display(true);
        assert!(screen(&display, (80, 24), true, false).is_ascii());
        for width in (1..220).step_by(7) {
            for height in (1..70).step_by(3) {
                screen(&display, (width, height), false, true);
            }
        }
        let empty = LiveDisplay::new(None, 0.0, Axes::ALL);
        assert!(screen(&empty, (80, 24), false, true).contains("nothing has arrived"));
        assert!(screen(&display, (40, 10), false, true).contains("60 x 14"));
    }

    #[test]
    fn long_paths_do_not_hide_the_state() {
        let display = display(false);
        let path = "/home/user/a/very/long/way/to/the/place/where/recordings/of/the/day/are/kept/run-17.csv";
        for (state, recording) in [("played to its end", None), ("playing, 00:00:10", Some(path))] {
            for (width, ascii) in [(60, false), (80, true), (200, false)] {
                let mut grid = CellGrid::new((width, 24));
                let (message, color) = ("", false);
                let screen = LiveScreen {
                    display: &display,
                    guide: None,
                    source: path,
                    state,
                    recording,
                    message,
                    ascii,
                    color,
                };
                screen.draw(&mut grid);
                let header = &grid.text_of_lines()[0];
                let names = header.split("  ").filter(|part| part.contains("run-17.csv")).count();
                assert_eq!(names, if recording.is_some() { 2 } else { 1 }, "{header}");
                assert!(header.contains(state), "{header}");
                assert_eq!(header.contains(path), width == 200, "{header}");
            }
        }
    }

    #[test]
    fn numbers_have_no_superfluous_digits() {
        assert_eq!([0.05, 2.0, 0.0, 1000.0, -0.0].map(short), ["0.05", "2", "0", "1000", "0"]);
        assert_eq!([0.1, 4.0, 40.0, 4000.0].map(decimals), [3, 2, 1, 0]);
    }
}
