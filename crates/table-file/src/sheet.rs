//! Workbooks of any format: the sheet that holds a table, and its rows.

use std::fmt;
use std::sync::Arc;

use crate::format::{Cell, FoundTable, RowSource, RowStream, WantedColumn, columns_of_cells};
use crate::kind::{FileKind, TableError};

pub(crate) const LAST_ROW: u64 = 1 << 20;

/// Number of rows that are searched for a table.
const LOOKED_AT: usize = 100;

/// A stream of rows with their numbers in the sheet, from 1 and ascending; blank rows may be left out.
pub(crate) type NumberedRows =
    Box<dyn FnMut() -> Result<Option<(u64, Vec<Cell>)>, TableError> + Send>;

pub(crate) trait Sheet: fmt::Debug + Send + Sync + 'static {
    fn numbered(self: Arc<Self>) -> Result<NumberedRows, TableError>;
}

/// Selects the sheet `part`, or the first with a table. Other sheets may describe the rig in a few cells. `open` opens
/// a sheet by its position among `names`.
pub(crate) fn choose<S: Sheet>(
    kind: FileKind,
    names: Vec<String>,
    part: Option<&str>,
    open: impl Fn(usize) -> Result<S, TableError>,
) -> Result<FoundTable, TableError> {
    let named = (0..names.len()).filter(|&at| part.is_none_or(|part| names[at] == part));
    let candidates: Vec<usize> = named.collect();
    let chosen = match candidates.as_slice() {
        [only] => Some((*only, Arc::new(open(*only)?))),
        _ => {
            let mut sheets = Vec::with_capacity(candidates.len());
            for at in candidates {
                let sheet = Arc::new(open(at)?);
                sheets.push((filled(&sheet)?, at, sheet));
            }
            let most = sheets.iter().map(|(filled, ..)| *filled).max().unwrap_or(0);
            // The first of two logs is chosen even if the second one has some more columns.
            let is_table = |filled: usize| filled > 1 && 2 * filled >= most;
            sheets.into_iter().find(|(filled, ..)| is_table(*filled)).map(|(_, at, it)| (at, it))
        }
    };
    let Some((at, sheet)) = chosen else { return Err(kind.choice("sheet", part, names)) };
    // The names of columns are in a row, or absent.
    let mut found = FoundTable::new(None, SheetRows(sheet));
    if names.len() > 1 && part.is_none() {
        let name = &names[at];
        let others: Vec<&String> = names.iter().filter(|other| *other != name).collect();
        found.notes.push(format!("read from sheet `{name}`; the others are {others:?}"));
    }
    Ok(found)
}

/// Counts the filled cells in the first rows with several of them.
fn filled<S: Sheet>(sheet: &Arc<S>) -> Result<usize, TableError> {
    let (mut next, mut count) = (Arc::clone(sheet).numbered()?, 0);
    for _ in 0..LOOKED_AT {
        let Some((_, cells)) = next()? else { break };
        let filled = cells.iter().filter(|cell| **cell != Cell::Missing).count();
        count += if filled > 1 { filled } else { 0 };
    }
    Ok(count)
}

/// The rows of a sheet, including blank rows that the file omits.
#[derive(Debug)]
struct SheetRows<S>(Arc<S>);

impl<S: Sheet> RowSource for SheetRows<S> {
    fn is_time(&self, column: usize) -> bool {
        let Ok(mut next) = Arc::clone(&self.0).numbered() else { return false };
        let rows = std::iter::from_fn(|| next().ok().flatten());
        let is_time = |cell: &Cell| matches!(cell, Cell::Elapsed(_) | Cell::Time { .. });
        rows.take(LOOKED_AT).any(|(_, cells)| cells.get(column).is_some_and(is_time))
    }

    fn columns(&self) -> usize {
        0
    }

    fn rows(self: Arc<Self>, wanted: Vec<WantedColumn>) -> Result<RowStream, TableError> {
        let mut numbered = Arc::clone(&self.0).numbered()?;
        // The number of the last row returned, and the next row of the file if blank rows precede it.
        let (mut given, mut waiting) = (0, None);
        let next = move || {
            let next = match waiting.take() {
                None => numbered()?,
                waiting => waiting,
            };
            let Some((row, cells)) = next else { return Ok(None) };
            given += 1;
            if row > given {
                // A row that the file omits is blank.
                waiting = Some((row, cells));
                return Ok(Some(Vec::new()));
            }
            Ok(Some(cells))
        };
        Ok(columns_of_cells(Box::new(next), wanted, is_blank))
    }
}

/// Returns true if a row is empty or a remark.
fn is_blank(row: &[Cell]) -> bool {
    let first = row.iter().find(|cell| **cell != Cell::Missing);
    let is_remark = |text: &str| text.starts_with('#') && !is_error(text);
    first.is_none_or(|cell| matches!(cell, Cell::Text(text) if is_remark(text)))
}

/// Returns true for an error of a formula: `#DIV/0!`, `#NAME?`, `#N/A`.
pub(crate) fn is_error(text: &str) -> bool {
    let is_of_error = |c: char| c.is_ascii_uppercase() || matches!(c, '/' | '_' | '0');
    text == "#N/A"
        || text
            .strip_prefix('#')
            .and_then(|rest| rest.strip_suffix(['!', '?']))
            .is_some_and(|name| !name.is_empty() && name.chars().all(is_of_error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_formulas_are_no_remarks() {
        for (text, expected) in [
            ("#DIV/0!", false),
            ("#N/A", false),
            ("#NAME?", false),
            ("#GETTING_DATA!", false),
            ("# quiet", true),
            ("#", true),
            ("#!", true),
            ("#stop!", true),
        ] {
            let row = [Cell::Missing, Cell::Text(text.to_owned()), Cell::Real(1.0)];
            assert_eq!(is_blank(&row), expected, "{text}");
        }
    }
}
