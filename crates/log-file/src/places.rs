//! Where fields and lines end, found before they are parsed.

use super::lanes::{BLOCK, Fields, Lanes};

/// How many fields are found before they are parsed: so few that both the text and the places stay
/// in the first-level cache, and that little is done in vain where one of them is wrong.
const FIELDS_AT_ONCE: usize = 1024;

/// Where fields and lines end. What is beyond the counts is left over from before.
#[derive(Debug, Default)]
pub(super) struct Places {
    /// What ends before the first field, then where each field ends, row by row.
    fields: Vec<u32>,
    /// Where each line ends.
    lines: Vec<u32>,
    field_count: usize,
    line_count: usize,
}

impl Places {
    /// Finds where some of the fields and lines from `lines[at]` on end: those of a row of so many
    /// `columns` at least.
    ///
    /// # Panics
    /// If there are more bytes than 32 bits can count.
    #[inline(always)]
    pub(super) fn find<L: Lanes>(
        &mut self,
        lanes: L,
        lines: &[u8],
        at: usize,
        separator: u8,
        columns: usize,
    ) {
        assert!(u32::try_from(lines.len()).is_ok(), "pieces of a log are of a megabyte or so");
        let wanted = columns.max(FIELDS_AT_ONCE);
        // The last block of bytes may add as many more.
        self.fields.resize(wanted + 1 + BLOCK, 0);
        self.lines.resize(wanted + 1 + BLOCK, 0);
        self.fields[0] = (at as u32).wrapping_sub(1);
        (self.field_count, self.line_count) = (1, 0);
        for base in (at..lines.len()).step_by(BLOCK) {
            if self.field_count > wanted {
                break;
            }
            let [separators, mut newlines] =
                find_in_block(lanes, &lines[base..], [separator, b'\n']);
            let fields = &mut self.fields[self.field_count..];
            let fields = fields.first_chunk_mut().expect("room for a block");
            self.field_count += lanes.write_places(separators | newlines, base as u32, fields);
            while newlines != 0 {
                self.lines[self.line_count] = base as u32 + newlines.trailing_zeros();
                self.line_count += 1;
                newlines &= newlines - 1;
            }
        }
    }

    /// How many rows have as many fields as there are `columns`, before the first that has not or
    /// whose end has not been found. Leaves out the carriage returns at the ends of lines.
    pub(super) fn whole_rows(&mut self, lines: &[u8], columns: usize) -> usize {
        let last_fields = self.fields[..self.field_count].iter().skip(columns).step_by(columns);
        let mut rows = 0;
        // Line ends are fields' ends, too: where they are the same as the last fields' all along,
        // no other field ends there.
        for (line, field) in self.lines[..self.line_count].iter_mut().zip(last_fields) {
            if line != field {
                break;
            }
            rows += 1;
            if lines[..*line as usize].last() == Some(&b'\r') {
                *line -= 1;
            }
        }
        rows
    }

    /// The fields of a column of so many, in whole rows.
    pub(super) fn of_column(&self, column: usize, columns: usize) -> Fields<'_> {
        let befores = (&self.fields[column..], columns);
        let ends = match column + 1 == columns {
            true => (&self.lines[..], 1),
            false => (&self.fields[column + 1..], columns),
        };
        Fields { befores, ends }
    }

    /// Where the first so many whole rows end.
    pub(super) fn end_of(&self, rows: usize, columns: usize) -> usize {
        self.fields[rows * columns] as usize
    }
}

/// For each of `wanted` its places in the first [`BLOCK`] bytes of `rest`, as bits.
#[inline(always)]
fn find_in_block<L: Lanes>(lanes: L, rest: &[u8], wanted: [u8; 2]) -> [u64; 2] {
    match rest.first_chunk::<BLOCK>() {
        Some(bytes) => lanes.find(bytes, wanted),
        None => {
            let mut padded = [0; BLOCK];
            padded[..rest.len()].copy_from_slice(rest);
            let [a, b] = lanes.find(&padded, wanted);
            let there = !(u64::MAX << rest.len());
            [a & there, b & there]
        }
    }
}
