//! Dots and lines in the cells of a terminal: Braille, eight dots to a cell, or ASCII where that cannot
//! be shown.

/// A grid of dots.
#[derive(Debug)]
pub(super) struct CharacterCanvas {
    columns: usize,
    /// Which dots of each cell are set, by the bits of Unicode's Braille patterns.
    cells: Vec<u8>,
}

/// The bits of the dots of a cell, row by row.
const DOTS: [[u8; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];

/// Dots of a cell: across and down.
pub(super) const ACROSS: usize = 2;
pub(super) const DOWN: usize = 4;

impl CharacterCanvas {
    /// Empty, of so many cells.
    pub(super) fn new(columns: usize, rows: usize) -> Self {
        Self { columns, cells: vec![0; columns * rows] }
    }

    /// Sets a dot, counted from the left and from above; those beyond the edge are left out.
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

    /// Sets the dots between two.
    pub(super) fn line(&mut self, from: (i64, i64), to: (i64, i64)) {
        let (dx, dy) = (to.0 - from.0, to.1 - from.1);
        let steps = dx.abs().max(dy.abs()).max(1);
        for step in 0..=steps {
            // To the nearest dot.
            let part = |length: i64| (2 * length * step + steps * length.signum()) / (2 * steps);
            self.dot(from.0 + part(dx), from.1 + part(dy));
        }
    }

    /// The column and row of each cell.
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
mod tests {
    use super::*;

    #[test]
    fn dots_are_those_of_unicode() {
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
