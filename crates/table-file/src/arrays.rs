//! Arrays of numbers as the columns of a table: what MATLAB and HDF5 files hold.

use std::ops::Range;
use std::sync::Arc;

use crate::budget::{self, Unpacked};
use crate::element::Element;
use crate::error::TableError;
use crate::kind::FileKind;
use crate::rows::{Cell, RowBatch, RowSource, RowStream, batch_rows};

/// An array.
#[derive(Clone, Debug)]
pub struct Array {
    /// Its name.
    pub name: String,
    /// Rows, columns, and further sides.
    pub size: Vec<usize>,
    pub(crate) numbers: Option<ArrayNumbers>,
}

/// The numbers of an array as the file holds them.
#[derive(Clone, Debug)]
pub(crate) struct ArrayNumbers {
    pub(crate) bytes: Arc<Vec<u8>>,
    pub(crate) range: Range<usize>,
    pub(crate) element: Element,
    pub(crate) is_little: bool,
    /// Row after row, not column after column.
    pub(crate) is_by_row: bool,
}

impl Array {
    /// Its values in the order of the file, in MATLAB column by column; `None` where they are complex or no
    /// numbers.
    pub fn values(&self) -> Option<Vec<f64>> {
        let numbers = self.numbers.as_ref()?;
        let number = |at| match numbers.cell(at) {
            Cell::Real(value) => value,
            Cell::Whole(value) => value as f64,
            _ => f64::NAN,
        };
        Some((0..numbers.len()).map(number).collect())
    }
}

impl ArrayNumbers {
    fn len(&self) -> usize {
        self.range.len() / self.element.size()
    }

    fn cell(&self, at: usize) -> Cell {
        let size = self.element.size();
        self.element.cell(&self.bytes[self.range.start + at * size..][..size], self.is_little)
    }
}

/// The columns that an array is in a table.
#[derive(Clone, Debug)]
pub(crate) struct ArrayColumns {
    /// The name of the array, after those of the groups that it is in: `group/array`.
    pub(crate) path: String,
    rows: usize,
    count: usize,
    /// `None` as long as they have not been read.
    numbers: Option<ArrayNumbers>,
}

impl ArrayColumns {
    /// A matrix of these sides, or a vector; a single row is taken for a column.
    pub(crate) fn new(path: String, size: &[usize]) -> Option<Self> {
        let (rows, count) = match *size {
            [length] | [1, length] => (length, 1),
            [rows, columns] => (rows, columns),
            _ => return None,
        };
        Some(Self { path, rows, count, numbers: None })
    }

    /// The same with these numbers, if they fill them.
    pub(crate) fn with(self, numbers: ArrayNumbers) -> Option<Self> {
        let is_filled = self.rows.checked_mul(self.count) == Some(numbers.len());
        is_filled.then_some(Self { numbers: Some(numbers), ..self })
    }

    /// Whether `name` is that of the array or of a group that it is in.
    fn is_of(&self, name: &str) -> bool {
        let rest = self.path.strip_prefix(name);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    }

    fn leaf(&self) -> &str {
        self.path.rsplit('/').next().unwrap_or_default()
    }
}

/// Those of `all` that make up a log, and the names of their columns: of those that `name` is the name of, or else
/// of all, the ones that have as many rows as the longest.
///
/// # Errors
/// [`TableError::Choice`] if there are none of the name, and what else keeps them from being a table.
pub(crate) fn columns_of_log(
    kind: FileKind,
    all: Vec<ArrayColumns>,
    name: Option<&str>,
) -> Result<(Option<Vec<String>>, Vec<ArrayColumns>), TableError> {
    let is_named = |array: &ArrayColumns| name.is_none_or(|name| array.is_of(name));
    let (mut wanted, others): (Vec<_>, Vec<_>) =
        all.into_iter().filter(|array| array.rows > 0 && array.count > 0).partition(is_named);
    let Some(longest) = wanted.iter().map(|array| array.rows).max() else {
        if name.is_none() {
            return Err(kind.unsupported("no matrix or vector of real numbers"));
        }
        let found = others.into_iter().map(|array| array.path).collect();
        return Err(kind.choice("matrix of real numbers", name, found));
    };
    wanted.retain(|array| array.rows == longest);
    let count = wanted.iter().fold(0, |count: usize, array| count.saturating_add(array.count));
    budget::check_columns(kind, count)?;
    Ok((names(&wanted), wanted))
}

/// The names of the columns of a table; `None` for a matrix alone, whose columns have none.
fn names(all: &[ArrayColumns]) -> Option<Vec<String>> {
    if let [ArrayColumns { count: 2.., .. }] = all {
        return None;
    }
    let is_alone = |columns: &ArrayColumns| {
        all.iter().filter(|other| other.leaf() == columns.leaf()).count() == 1
    };
    let is_short = all.iter().all(is_alone);
    let names = |columns: &ArrayColumns| {
        let name = if is_short { columns.leaf() } else { &columns.path }.to_owned();
        match columns.count {
            1 => vec![name],
            count => (1..=count).map(|column| format!("{name}{column}")).collect(),
        }
    };
    Some(all.iter().flat_map(names).collect())
}

/// The rows of arrays of one length, from one on.
#[derive(Clone, Debug)]
pub(crate) struct ArrayRows {
    pub(crate) arrays: Vec<ArrayColumns>,
    pub(crate) row: usize,
}

impl RowSource for ArrayRows {
    fn rows(&self, _: Range<usize>, _: Unpacked) -> Result<Box<dyn RowStream>, TableError> {
        Ok(Box::new(self.clone()))
    }
}

impl RowStream for ArrayRows {
    fn next(&mut self, batch: &mut RowBatch) -> Result<bool, TableError> {
        let count: usize = self.arrays.iter().map(|columns| columns.count).sum();
        let all = self.arrays.first().map_or(0, |columns| columns.rows);
        let rows = self.row..all.min(self.row + batch_rows(count));
        if rows.is_empty() {
            return Ok(false);
        }
        batch.clear();
        for columns in &self.arrays {
            let Some(numbers) = &columns.numbers else { continue };
            for column in 0..columns.count {
                let position = |row: usize| match numbers.is_by_row {
                    true => row * columns.count + column,
                    false => column * columns.rows + row,
                };
                batch.push(rows.clone().map(|row| numbers.cell(position(row))).collect());
            }
        }
        self.row = rows.end;
        Ok(true)
    }
}
