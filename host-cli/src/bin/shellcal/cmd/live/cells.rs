//! The cells of a terminal's screen: each picture is drawn from scratch, and only changed lines are written. Dots and
//! lines are drawn in Braille, eight dots to a cell, or in ASCII if the terminal cannot show Braille.

use std::io::{self, Write};

use crossterm::cursor::MoveTo;
use crossterm::queue;
use crossterm::style::{ContentStyle, PrintStyledContent};
use unicode_width::UnicodeWidthChar;

/// A part of a screen, in cells from its upper left corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Area {
    pub(super) x: u16,
    pub(super) y: u16,
    pub(super) width: u16,
    pub(super) height: u16,
}

#[derive(Clone, Debug, PartialEq)]
struct Cell {
    /// `None` in the second cell of a wide character.
    character: Option<char>,
    /// Combining marks on the character.
    marks: String,
    style: ContentStyle,
}

#[derive(Debug, PartialEq)]
pub(super) struct CellGrid {
    size: (u16, u16),
    cells: Vec<Cell>,
}

impl CellGrid {
    pub(super) fn new(size: (u16, u16)) -> Self {
        let blank = Cell { character: Some(' '), marks: String::new(), style: ContentStyle::new() };
        Self { size, cells: vec![blank; usize::from(size.0) * usize::from(size.1)] }
    }

    pub(super) fn size(&self) -> (u16, u16) {
        self.size
    }

    /// Draws a character of width one; clipped at the edges.
    pub(super) fn put_char(
        &mut self,
        at: (u16, u16),
        character: impl Into<Option<char>>,
        style: ContentStyle,
    ) {
        if let Some(cell) = self.cell_mut(at) {
            *cell = Cell { character: character.into(), marks: String::new(), style };
        }
    }

    /// Draws a text in a line, clipped at the edge.
    pub(super) fn put_text(&mut self, (mut x, y): (u16, u16), text: &str, style: ContentStyle) {
        for character in text.chars() {
            let columns = character.width().unwrap_or(0) as u16;
            match (columns, x.checked_sub(1)) {
                (0, None) => {}
                (0, Some(before)) => {
                    if let Some(cell) = self.cell_mut((before, y)) {
                        cell.marks.push(character);
                    }
                }
                _ if columns > self.size.0.saturating_sub(x) => return,
                _ => {
                    self.put_char((x, y), character, style);
                    (1..columns).for_each(|more| self.put_char((x + more, y), None, style));
                    x += columns;
                }
            }
        }
    }

    fn cell_mut(&mut self, at: (u16, u16)) -> Option<&mut Cell> {
        self.index(at).and_then(|index| self.cells.get_mut(index))
    }

    pub(super) fn is_blank(&self, at: (u16, u16)) -> bool {
        let cell = self.index(at).and_then(|index| self.cells.get(index));
        cell.is_some_and(|cell| cell.character == Some(' '))
    }

    fn index(&self, (x, y): (u16, u16)) -> Option<usize> {
        let columns = self.size.0;
        (x < columns).then(|| usize::from(y) * usize::from(columns) + usize::from(x))
    }

    fn lines(&self) -> impl Iterator<Item = &[Cell]> {
        self.cells.chunks(usize::from(self.size.0).max(1))
    }

    /// Writes the lines that differ from `shown`, the grid of the same size that the terminal displays.
    pub(super) fn write_over(&self, shown: &Self, terminal: &mut impl Write) -> io::Result<()> {
        for ((y, line), before) in (0..).zip(self.lines()).zip(shown.lines()) {
            if line == before {
                continue;
            }
            queue!(terminal, MoveTo(0, y))?;
            for run in line.chunk_by(|one, next| one.style == next.style) {
                queue!(terminal, PrintStyledContent(run[0].style.apply(text_of(run))))?;
            }
        }
        Ok(())
    }
}

fn text_of(cells: &[Cell]) -> String {
    let mut text = String::with_capacity(cells.len());
    for cell in cells {
        text.extend(cell.character);
        text.push_str(&cell.marks);
    }
    text
}

#[derive(Debug)]
pub(super) struct CharacterCanvas {
    columns: usize,
    /// The dots set in each cell, as the bits of Unicode's Braille patterns.
    cells: Vec<u8>,
}

/// The bits of the dots of a cell, row by row.
const DOTS: [[u8; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];

/// Dots of a cell: across and down.
pub(super) const ACROSS: usize = 2;
pub(super) const DOWN: usize = 4;

impl CharacterCanvas {
    pub(super) fn new(columns: usize, rows: usize) -> Self {
        Self { columns, cells: vec![0; columns * rows] }
    }

    /// Sets a dot, counted from the upper left; dots beyond the edge are dropped.
    pub(super) fn dot(&mut self, x: i64, y: i64) {
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        if x >= self.columns * ACROSS {
            return;
        }
        let cell = self.cells.get_mut(y / DOWN * self.columns + x / ACROSS);
        if let Some(cell) = cell {
            *cell |= DOTS[y % DOWN][x % ACROSS];
        }
    }

    /// Sets the dots on a line between two dots.
    pub(super) fn line(&mut self, from: (i64, i64), to: (i64, i64)) {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let steps = dx.abs().max(dy.abs()).max(1);
        for step in 0..=steps {
            let part = |length: i64| (2 * length * step + steps * length.signum()) / (2 * steps);
            self.dot(from.0 + part(dx), from.1 + part(dy));
        }
    }

    pub(super) fn cells(&self) -> impl Iterator<Item = (usize, usize)> {
        (0..self.cells.len()).map(|at| (at % self.columns, at / self.columns))
    }

    /// The character of a cell, `None` if it is empty.
    pub(super) fn character(&self, column: usize, row: usize, ascii: bool) -> Option<char> {
        let bits = *self.cells.get(row * self.columns + column)?;
        let (upper, lower) = (bits & 0x1B != 0, bits & 0xE4 != 0);
        match bits {
            0 => None,
            _ if !ascii => char::from_u32(0x2800 + u32::from(bits)),
            _ => Some(match (upper, lower) {
                (true, true) => ':',
                (true, false) => '\'',
                _ => '.',
            }),
        }
    }
}

#[cfg(test)]
impl CellGrid {
    pub(super) fn text_of_lines(&self) -> Vec<String> {
        self.lines().map(text_of).collect()
    }

    pub(super) fn is_plain(&self) -> bool {
        self.cells.iter().all(|cell| cell.style == ContentStyle::new())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crossterm::style::Stylize;

    fn written(grid: &CellGrid, shown: &CellGrid) -> String {
        let mut terminal = Vec::new();
        grid.write_over(shown, &mut terminal).unwrap();
        String::from_utf8(terminal).unwrap()
    }

    /// Escape sequences of ECMA-48: `CSI row;column H` moves, `CSI 1 m` is bold, `CSI 0 m` ends all styles.
    #[test]
    fn only_lines_that_changed_are_written() {
        let blank = CellGrid::new((4, 3));
        let mut grid = CellGrid::new((4, 3));
        assert_eq!(written(&grid, &blank), "");
        grid.put_text((1, 1), "ab", ContentStyle::new().bold());
        assert_eq!(written(&grid, &blank), "\x1b[2;1H \x1b[1mab\x1b[0m ");
        let mut next = CellGrid::new((4, 3));
        next.put_text((1, 1), "ab", ContentStyle::new().bold());
        next.put_char((3, 2), 'c', ContentStyle::new());
        assert_eq!(written(&next, &grid), "\x1b[3;1H   c");
    }

    /// Widths of Unicode's annex 11: Han characters take two columns, a combining mark takes none.
    #[test]
    fn wide_characters_and_marks_take_the_columns_of_a_terminal() {
        let mut grid = CellGrid::new((5, 1));
        grid.put_text((0, 0), "u\u{308}力覚x", ContentStyle::new());
        assert_eq!(grid.text_of_lines(), ["u\u{308}力覚"]);
        let mut cut = CellGrid::new((4, 1));
        cut.put_text((0, 0), "\u{308}a力覚", ContentStyle::new());
        assert_eq!(cut.text_of_lines(), ["a力 "], "half of a wide character is not drawn");
    }

    #[test]
    fn cells_beyond_the_edges_are_left_out() {
        for size in [(0, 0), (3, 0), (0, 3), (3, 2)] {
            let mut grid = CellGrid::new(size);
            for at in [(0, 5), (3, 0), (2, 1), (u16::MAX, u16::MAX)] {
                grid.put_char(at, 'x', ContentStyle::new());
                grid.put_text(at, "long 力", ContentStyle::new());
                assert!(!grid.is_blank(at));
            }
            let shown = CellGrid::new(size);
            written(&grid, &shown);
        }
    }

    #[test]
    fn dots_equal_those_of_unicode() {
        let mut canvas = CharacterCanvas::new(2, 1);
        // U+28FF has all eight dots, U+2801 the upper left one.
        (0..4).for_each(|y| (0..2).for_each(|x| canvas.dot(x, y)));
        canvas.dot(2, 0);
        canvas.dot(-1, 0);
        canvas.dot(4, 0);
        canvas.dot(0, 4);
        assert_eq!(canvas.character(0, 0, false), Some('\u{28FF}'));
        assert_eq!(canvas.character(1, 0, false), Some('\u{2801}'));
        assert_eq!(canvas.character(1, 0, true), Some('\''));
        assert_eq!(CharacterCanvas::new(1, 1).character(0, 0, true), None);
    }

    #[test]
    fn a_line_joins_its_ends_whichever_way_it_runs() {
        let lines: [((i64, i64), (i64, i64)); 4] =
            [((0, 0), (7, 3)), ((7, 3), (0, 0)), ((0, 3), (7, 0)), ((3, 0), (3, 3))];
        for (from, to) in lines {
            let mut canvas = CharacterCanvas::new(4, 1);
            canvas.line(from, to);
            for (x, y) in [from, to] {
                let mut end = CharacterCanvas::new(4, 1);
                end.dot(x, y);
                let at = x as usize / ACROSS;
                assert!(canvas.cells[at] & end.cells[at] != 0, "{from:?} {to:?}");
            }
            let set: u32 = canvas.cells.iter().map(|bits| bits.count_ones()).sum();
            let length = (to.0 - from.0).abs().max((to.1 - from.1).abs()) as u32 + 1;
            assert_eq!(set, length, "{from:?} {to:?}");
        }
    }
}
