//! Arrays of numbers as the columns of a table: what MATLAB and HDF5 files hold.

use std::ops::Range;
use std::sync::Arc;

use crate::budget::{self, Unpacked};
use crate::element::Element;
use crate::format::{Cell, RowSource, RowStream, batch_rows};
use crate::kind::{FileKind, TableError};

/// An array.
#[derive(Clone, Debug)]
pub struct Array {
    /// Its name, after those of the groups that it is in: `group/array`.
    pub name: String,
    /// Rows, columns, and further sides.
    pub size: Vec<usize>,
    /// `None` where they are complex or none, and as long as they have not been read.
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

    /// Rows and columns of a matrix, or a vector, in a table: a single row is taken for a column, and what has
    /// more sides has neither.
    fn sides(&self) -> (usize, usize) {
        match *self.size {
            [length] | [1, length] => (length, 1),
            [rows, columns] => (rows, columns),
            _ => (0, 0),
        }
    }

    /// Whether its numbers have been read and are as many as its sides say.
    pub(crate) fn is_filled(&self) -> bool {
        let (rows, columns) = self.sides();
        let count = self.numbers.as_ref().map(ArrayNumbers::len);
        count.is_some() && count == rows.checked_mul(columns)
    }

    /// Whether `name` is that of the array or of a group that it is in.
    fn is_of(&self, name: &str) -> bool {
        let rest = self.name.strip_prefix(name);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    }

    fn leaf(&self) -> &str {
        self.name.rsplit('/').next().unwrap_or_default()
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

/// Those of `all` that make up a log, and the names of their columns: of those that `name` is the name of, or else
/// of all, the ones that have as many rows as the longest.
///
/// # Errors
/// [`TableError::Choice`] if there are none of the name, and what else keeps them from being a table.
pub(crate) fn columns_of_log(
    kind: FileKind,
    mut all: Vec<Array>,
    name: Option<&str>,
) -> Result<(Option<Vec<String>>, Vec<Array>), TableError> {
    all.retain(|array| matches!(array.sides(), (1.., 1..)));
    let is_named = |array: &Array| name.is_none_or(|name| array.is_of(name));
    let (mut wanted, others): (Vec<_>, Vec<_>) = all.into_iter().partition(is_named);
    let Some(longest) = wanted.iter().map(|array| array.sides().0).max() else {
        if name.is_none() {
            return Err(kind.unsupported("no matrix or vector of real numbers"));
        }
        let found = others.into_iter().map(|array| array.name).collect();
        return Err(kind.choice("matrix of real numbers", name, found));
    };
    wanted.retain(|array| array.sides().0 == longest);
    let count = wanted.iter().fold(0, |count: usize, array| count.saturating_add(array.sides().1));
    budget::check_columns(kind, count)?;
    Ok((names(&wanted), wanted))
}

/// The names of the columns of a table; `None` for a matrix alone, whose columns have none.
fn names(all: &[Array]) -> Option<Vec<String>> {
    if let [matrix] = all
        && matrix.sides().1 > 1
    {
        return None;
    }
    let is_alone =
        |array: &Array| all.iter().filter(|other| other.leaf() == array.leaf()).count() == 1;
    let is_short = all.iter().all(is_alone);
    let names = |array: &Array| {
        let name = if is_short { array.leaf() } else { &array.name }.to_owned();
        match array.sides().1 {
            1 => vec![name],
            count => (1..=count).map(|column| format!("{name}{column}")).collect(),
        }
    };
    Some(all.iter().flat_map(names).collect())
}

/// The rows of arrays of one length.
#[derive(Debug)]
pub(crate) struct ArrayRows(pub(crate) Vec<Array>);

impl RowSource for ArrayRows {
    fn rows(self: Arc<Self>, _: Range<usize>, _: Unpacked) -> Result<RowStream, TableError> {
        let columns = self.0.iter().map(|array| array.sides().1).sum();
        let (mut next, end) = (0, self.0.first().map_or(0, |array| array.sides().0));
        Ok(Box::new(move |batch| {
            let rows = next..end.min(next + batch_rows(columns));
            batch.clear();
            for array in &self.0 {
                let Some(numbers) = &array.numbers else { continue };
                let (height, width) = array.sides();
                for column in 0..width {
                    let position = |row: usize| match numbers.is_by_row {
                        true => row * width + column,
                        false => column * height + row,
                    };
                    batch.push(rows.clone().map(|row| numbers.cell(position(row))).collect());
                }
            }
            next = rows.end;
            Ok(!rows.is_empty())
        }))
    }
}
