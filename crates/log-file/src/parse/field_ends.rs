//! Locates the ends of fields and lines before they are parsed.

use super::instruction_set::{BLOCK, ColumnFields, InstructionSet};

/// Number of fields located before they are parsed: few enough for the first-level cache, and to waste little work at a
/// bad row.
const FIELDS_AT_ONCE: usize = 1024;

/// Offsets of the ends of fields and lines. Elements beyond the counts are unused.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct FieldEnds {
    /// The position before the first field, followed by the end of each field, row by row.
    fields: Vec<u32>,
    lines: Vec<u32>,
    field_count: usize,
    line_count: usize,
}

impl FieldEnds {
    /// Locates the ends of fields and lines from `lines[at]` on, for at least `columns` fields (one row).
    ///
    /// # Panics
    /// If the offsets do not fit 32 bits.
    #[inline(always)]
    pub(crate) fn find<L: InstructionSet>(
        &mut self,
        set: L,
        lines: &[u8],
        at: usize,
        separator: u8,
        columns: usize,
    ) {
        assert!(u32::try_from(lines.len()).is_ok(), "pieces of a log are of a megabyte or so");
        // A field takes at least one byte.
        let wanted = columns.max(FIELDS_AT_ONCE.min(lines.len()));
        // The last block of bytes may add up to `BLOCK` more.
        self.fields.resize(wanted + 1 + BLOCK, 0);
        self.lines.resize(wanted + 1 + BLOCK, 0);
        self.fields[0] = (at as u32).wrapping_sub(1);
        (self.field_count, self.line_count) = (1, 0);
        for base in (at..lines.len()).step_by(BLOCK) {
            if self.field_count > wanted {
                break;
            }
            let [separators, mut newlines] = find_in_block(set, &lines[base..], [separator, b'\n']);
            let fields = &mut self.fields[self.field_count..];
            let fields = fields.first_chunk_mut().expect("room for a block");
            self.field_count += write_ends(separators | newlines, base as u32, fields);
            while newlines != 0 {
                self.lines[self.line_count] = base as u32 + newlines.trailing_zeros();
                self.line_count += 1;
                newlines &= newlines - 1;
            }
        }
    }

    /// Counts the rows with `columns` fields, up to the first row with another number of fields or without a located
    /// end. Removes carriage returns and blanks from the ends of lines.
    pub(crate) fn whole_rows(&mut self, lines: &[u8], columns: usize) -> usize {
        let last_fields = self.fields[..self.field_count].iter().skip(columns).step_by(columns);
        let mut rows = 0;
        // Ends of lines are ends of fields as well. If they equal the end of every `columns`-th field, no row has a
        // different number of fields.
        for (line, field) in self.lines[..self.line_count].iter_mut().zip(last_fields) {
            if line != field {
                break;
            }
            rows += 1;
            while let Some(b'\r' | b' ') = lines[..*line as usize].last() {
                *line -= 1;
            }
        }
        rows
    }

    pub(crate) fn of_column(&self, column: usize, columns: usize) -> ColumnFields<'_> {
        let befores = (&self.fields[column..], columns);
        let ends = match column + 1 == columns {
            true => (&self.lines[..], 1),
            false => (&self.fields[column + 1..], columns),
        };
        ColumnFields { befores, ends }
    }

    pub(crate) fn end_of(&self, rows: usize, columns: usize) -> usize {
        self.fields[rows * columns] as usize
    }
}

/// Writes the positions of the set bits, lowest first, plus `base`; returns their number. May overwrite later
/// elements.
#[inline(always)]
fn write_ends(mut bits: u64, base: u32, positions: &mut [u32; BLOCK]) -> usize {
    /// A block rarely has more set bits. Writing too many is faster than a loop of unpredictable length.
    const USUAL: usize = 16;
    let count = bits.count_ones() as usize;
    for position in &mut positions[..USUAL] {
        *position = base.wrapping_add(bits.trailing_zeros());
        bits &= bits.wrapping_sub(1);
    }
    for position in &mut positions[USUAL..count.max(USUAL)] {
        *position = base + bits.trailing_zeros();
        bits &= bits - 1;
    }
    count
}

/// Returns the positions of each byte of `wanted` in the first [`BLOCK`] bytes of `rest`, as bits.
#[inline(always)]
fn find_in_block<L: InstructionSet>(set: L, rest: &[u8], wanted: [u8; 2]) -> [u64; 2] {
    match rest.first_chunk::<BLOCK>() {
        Some(bytes) => set.find(bytes, wanted),
        None => {
            let mut padded = [0; BLOCK];
            padded[..rest.len()].copy_from_slice(rest);
            let [a, b] = set.find(&padded, wanted);
            let there = !(u64::MAX << rest.len());
            [a & there, b & there]
        }
    }
}
