//! Arrays of numbers from MATLAB and HDF5 files, as the columns of a table.

use std::ops::Range;
use std::sync::Arc;

use crate::budget;
use crate::element::{Element, Strided};
use crate::format::{Cell, RowSource, RowStream, TableColumn, WantedColumn};
use crate::kind::{FileKind, TableError};

#[derive(Clone, Debug)]
pub struct Array {
    /// The array's name with its groups: `group/array`.
    pub name: String,
    /// Number of rows, of columns, and the lengths of further dimensions.
    pub size: Vec<usize>,
    pub(crate) unit: Option<String>,
    /// Names and units of the columns, if the file states any.
    pub(crate) labels: Labels,
    /// True for storage row by row, false for column by column.
    pub(crate) is_by_row: bool,
    pub(crate) values: ArrayValues,
}

/// Lists of names and of units, each empty or with as many texts as the array has columns.
#[derive(Clone, Debug, Default)]
pub(crate) struct Labels {
    pub(crate) names: Vec<String>,
    pub(crate) units: Vec<String>,
}

#[derive(Clone, Debug)]
pub(crate) enum ArrayValues {
    /// Content that cannot be a column of a table, with the reason.
    Other(&'static str),
    Unread,
    Numbers(ArrayNumbers),
    Texts(Arc<Vec<String>>),
}

#[derive(Clone, Debug)]
pub(crate) struct ArrayNumbers {
    pub(crate) bytes: Arc<Vec<u8>>,
    pub(crate) range: Range<usize>,
    pub(crate) element: Element,
    pub(crate) is_little: bool,
}

impl Array {
    /// Returns the values in the order of the file (column by column in MATLAB); `None` if they are complex or not
    /// numbers.
    pub fn values(&self) -> Option<Vec<f64>> {
        let ArrayValues::Numbers(numbers) = &self.values else { return None };
        let number = |at| numbers.cell(at).number().unwrap_or(f64::NAN);
        Some((0..numbers.len()).map(number).collect())
    }

    /// Returns the numbers of rows and columns. A single row counts as a column; an array of more than two dimensions
    /// has no rows and columns.
    fn sides(&self) -> (usize, usize) {
        match *self.size {
            [length] | [1, length] => (length, 1),
            [rows, columns] => (rows, columns),
            _ => (0, 0),
        }
    }

    fn refusal(&self) -> Option<&'static str> {
        match (&self.values, self.sides()) {
            (ArrayValues::Other(what), _) => Some(what),
            (_, (0, _) | (_, 0)) if self.size.len() > 2 => Some("more than two sides"),
            (_, (0, _) | (_, 0)) => Some("empty"),
            _ if !self.is_filled() => Some("fewer values than its sides say"),
            _ => None,
        }
    }

    /// Returns true if the number of values matches the array's size, or the values have not been read.
    pub(crate) fn is_filled(&self) -> bool {
        let (rows, columns) = self.sides();
        match &self.values {
            ArrayValues::Other(_) => false,
            ArrayValues::Unread => true,
            ArrayValues::Numbers(numbers) => Some(numbers.len()) == rows.checked_mul(columns),
            ArrayValues::Texts(texts) => texts.len() == rows && columns == 1,
        }
    }

    /// Returns true if `name` is the name of the array or of a group that contains it.
    fn is_of(&self, name: &str) -> bool {
        let rest = self.name.strip_prefix(name);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    }

    fn leaf(&self) -> &str {
        leaf(&self.name)
    }
}

/// Returns an array's name without its groups.
fn leaf(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or_default()
}

impl Labels {
    /// Iterates over the name and unit of each of `count` columns.
    fn of_columns(&self, count: usize) -> impl Iterator<Item = (Option<&String>, Option<&String>)> {
        let fits = |all: &[String]| all.len() == count;
        let (has_names, has_units) = (fits(&self.names), fits(&self.units));
        (0..count).map(move |at| {
            let name = self.names.get(at).filter(|_| has_names);
            (name, self.units.get(at).filter(|_| has_units))
        })
    }
}

/// Names of arrays and attributes that hold units, and names of columns.
pub(crate) const UNITS: [&str; 2] = ["units", "unit"];
pub(crate) const NAMES: [&str; 6] =
    ["columns", "column_names", "names", "labels", "channels", "fields"];

/// Gives a matrix the names and units in a list of texts, if the list has as many elements as the matrix has columns.
fn label(all: &mut [Array]) {
    let list = |names: &[&str], count: usize| {
        let is_called =
            |array: &&Array| names.iter().any(|it| array.leaf().eq_ignore_ascii_case(it));
        let mut texts = all.iter().filter(is_called).filter_map(|array| match &array.values {
            ArrayValues::Texts(texts) if texts.len() == count => Some(texts.to_vec()),
            _ => None,
        });
        texts.next().unwrap_or_default()
    };
    let labels: Vec<Labels> = all
        .iter()
        .map(|array| match array.sides() {
            (rows, count) if count > 1 && rows != count => {
                Labels { names: list(&NAMES, count), units: list(&UNITS, count) }
            }
            _ => Labels::default(),
        })
        .collect();
    for (array, labels) in all.iter_mut().zip(labels) {
        let is_given = !array.labels.names.is_empty() || !array.labels.units.is_empty();
        array.labels = if is_given { std::mem::take(&mut array.labels) } else { labels };
    }
}

/// Returns single numbers and texts, which describe the other arrays.
pub(crate) fn attributes_in(all: &[Array]) -> Vec<(String, String)> {
    let single = |array: &Array| match &array.values {
        ArrayValues::Numbers(_) if array.sides() == (1, 1) => {
            array.values()?.first().map(|number| number.to_string())
        }
        ArrayValues::Texts(texts) if texts.len() == 1 => texts.first().cloned(),
        _ => None,
    };
    all.iter().filter_map(|array| Some((array.leaf().to_owned(), single(array)?))).collect()
}

impl ArrayValues {
    /// Returns the number of bytes of all texts, zero for numbers.
    pub(crate) fn text_bytes(&self) -> u64 {
        match self {
            Self::Texts(texts) => texts.iter().map(|text| text.len() as u64).sum(),
            _ => 0,
        }
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

/// An array may lack the last row only if the log has more rows than this.
const FEW_ROWS: usize = 10;

/// Transposes matrices whose columns run along time. They have as many columns as a vector has values. Without
/// long vectors, all matrices have equal numbers of columns and different numbers of rows.
fn turn(all: &mut [Array]) {
    let vectors: Vec<usize> = all
        .iter()
        .map(Array::sides)
        .filter(|(_, width)| *width == 1)
        .map(|(rows, _)| rows)
        .collect();
    let matrices: Vec<(usize, usize)> =
        all.iter().map(Array::sides).filter(|(_, width)| *width > 1).collect();
    let is_common = |width: usize| {
        matrices.len() > 1
            && vectors.iter().all(|rows| *rows < FEW_ROWS)
            && matrices.iter().all(|(rows, other)| *other == width && *rows < width)
            && matrices.iter().any(|(rows, _)| *rows != matrices[0].0)
    };
    let is_long = |rows: usize| rows > FEW_ROWS && vectors.contains(&rows);
    for array in all.iter_mut() {
        let (rows, width) = array.sides();
        if width > 1 && !is_long(rows) && (is_long(width) || is_common(width)) {
            array.size.reverse();
            array.is_by_row = !array.is_by_row;
        }
    }
}

/// The columns of a log, their names if known, and notes on the arrays that are left out.
pub(crate) type LogColumns = (Option<Vec<TableColumn>>, ArrayRows, Vec<String>);

/// Selects the arrays of a log: among those called `name`, or all, the arrays that have the number of rows of most
/// columns. If some lack the last row, it is left out of all.
///
/// # Errors
/// [`TableError::Choice`] if no array has the name, and other errors if the arrays do not make a table.
pub(crate) fn columns_of_log(
    kind: FileKind,
    all: Vec<Array>,
    name: Option<&str>,
) -> Result<LogColumns, TableError> {
    let (mut notes, mut fitting, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
    let mut all = all;
    label(&mut all);
    for array in all {
        match array.refusal() {
            Some(why) => {
                notes.push(format!("`{}` is left out: {why}", array.name));
                left_out.push((array.name, why.to_owned()));
            }
            None => fitting.push(array),
        }
    }
    let is_named = |array: &Array| name.is_none_or(|name| array.is_of(name));
    let (mut wanted, others): (Vec<_>, Vec<_>) = fitting.into_iter().partition(is_named);
    if wanted.is_empty() && name.is_none() {
        let left_out = notes.first().map(|note| format!(": {note}")).unwrap_or_default();
        return Err(kind.unsupported(format!("no matrix or vector of real numbers{left_out}")));
    }
    if wanted.is_empty() {
        let found = others.into_iter().map(|array| array.name).collect();
        return Err(kind.choice("matrix of real numbers", name, found));
    }
    turn(&mut wanted);
    // Many columns are preferred to a single long one, which holds something else.
    let score = |rows: usize| {
        let columns = wanted.iter().filter(|array| array.sides().0 == rows);
        columns.map(|array| array.sides().1 as f64).sum::<f64>() * (rows as f64).ln()
    };
    let heights = wanted.iter().map(|array| array.sides().0);
    let usual = heights.max_by(|a, b| score(*a).total_cmp(&score(*b))).unwrap_or(0);
    let may_differ = |rows: usize| rows == usual || usual > FEW_ROWS && rows.abs_diff(usual) == 1;
    let mut rows = usual;
    wanted.retain(|array| {
        let (height, name) = (array.sides().0, &array.name);
        let is_kept = may_differ(height);
        if !is_kept {
            let why = format!("{height} rows, not {usual}");
            notes.push(format!("`{name}` is left out: {why}"));
            left_out.push((name.clone(), why));
        } else if height != usual {
            notes.push(format!(
                "`{name}` has {height} rows, not {usual}: the row at the end is left out"
            ));
            rows = rows.min(height);
        }
        is_kept
    });
    let count = wanted.iter().fold(0, |count: usize, array| count.saturating_add(array.sides().1));
    budget::check_columns(kind, count)?;
    Ok((names(&wanted), ArrayRows { arrays: wanted, rows, left_out }, notes))
}

/// Returns the names of a table's columns; `None` for a single matrix, whose columns have no names.
fn names(all: &[Array]) -> Option<Vec<TableColumn>> {
    if let [matrix] = all
        && matrix.sides().1 > 1
        && matrix.unit.is_none()
        && matrix.labels.of_columns(matrix.sides().1).all(|(name, unit)| name.or(unit).is_none())
    {
        return None;
    }
    let is_alone =
        |array: &Array| all.iter().filter(|other| other.leaf() == array.leaf()).count() == 1;
    let is_short = all.iter().all(is_alone);
    let columns = |array: &Array| {
        let name = if is_short { array.leaf() } else { &array.name };
        let count = array.sides().1;
        let column = |(at, (label, unit)): (usize, (Option<&String>, Option<&String>))| {
            let numbered = || if count == 1 { name.to_owned() } else { format!("{name}{at}") };
            let name = label.filter(|_| count > 1).cloned().unwrap_or_else(numbered);
            TableColumn { name, unit: unit.or(array.unit.as_ref()).cloned() }
        };
        (1..).zip(array.labels.of_columns(count)).map(column).collect::<Vec<_>>()
    };
    Some(all.iter().flat_map(columns).collect())
}

#[derive(Clone, Debug)]
pub(crate) struct ArrayRows {
    pub(crate) arrays: Vec<Array>,
    pub(crate) rows: usize,
    /// Names of arrays that are not among the columns, with the reasons.
    left_out: Vec<(String, String)>,
}

impl ArrayRows {
    /// Returns the array that contains a column, and the column's index within it.
    pub(crate) fn place(&self, mut column: usize) -> Option<(usize, usize)> {
        for (at, array) in self.arrays.iter().enumerate() {
            let (_, width) = array.sides();
            if column < width {
                return Some((at, column));
            }
            column -= width;
        }
        None
    }
}

impl RowSource for ArrayRows {
    fn reason_of_absence(&self, name: &str) -> Option<&str> {
        let mut left_out = self.left_out.iter();
        let (_, why) = left_out.find(|(array, _)| array == name || leaf(array) == name)?;
        Some(why)
    }

    fn columns(&self) -> usize {
        self.arrays.iter().map(|array| array.sides().1).sum()
    }

    fn rows(self: Arc<Self>, wanted: Vec<WantedColumn>) -> Result<RowStream, TableError> {
        let mut next = 0;
        Ok(Box::new(move |rows, part| {
            let rows = rows.min(self.rows - next);
            for (column, wanted) in part.columns.iter_mut().zip(&wanted) {
                let Some((array, inner)) = self.place(wanted.at) else { continue };
                let array = &self.arrays[array];
                match &array.values {
                    ArrayValues::Other(_) | ArrayValues::Unread => {}
                    ArrayValues::Texts(texts) => {
                        let texts = texts.iter().skip(next).take(rows);
                        column.cells().extend(texts.map(|text| Cell::Text(text.clone())));
                    }
                    ArrayValues::Numbers(numbers) => {
                        let ((height, width), size) = (array.sides(), numbers.element.size());
                        let (first, step) = match array.is_by_row {
                            true => (next * width + inner, width),
                            false => (inner * height + next, 1),
                        };
                        let bytes = numbers.bytes.get(numbers.range.clone()).unwrap_or_default();
                        let bytes = bytes.get(first * size..).unwrap_or_default();
                        let from = Strided { bytes, stride: step * size, rows };
                        numbers.element.read(from, numbers.is_little, column);
                    }
                }
            }
            next += rows;
            part.rows = rows;
            Ok(())
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_label_matrices_and_single_values_describe_them() {
        let numbers = |rows: usize, columns: usize| {
            let bytes: Vec<u8> =
                (0..rows * columns).flat_map(|at| (at as f64).to_le_bytes()).collect();
            let (range, element) = (0..bytes.len(), Element::Double);
            ArrayValues::Numbers(ArrayNumbers {
                bytes: Arc::new(bytes),
                range,
                element,
                is_little: true,
            })
        };
        let texts = |of: &[&str]| {
            ArrayValues::Texts(Arc::new(of.iter().map(|&text| text.to_owned()).collect()))
        };
        let array = |name: &str, size: [usize; 2], values: ArrayValues| Array {
            name: name.to_owned(),
            size: size.to_vec(),
            unit: None,
            labels: Labels::default(),
            is_by_row: true,
            values,
        };
        let all = vec![
            array("log/data", [12, 2], numbers(12, 2)),
            array("log/labels", [2, 1], texts(&["t", "fz"])),
            array("log/Units", [2, 1], texts(&["ms", "kN"])),
            array("fs", [1, 1], numbers(1, 1)),
            array("unit", [1, 1], texts(&["N"])),
        ];
        let attributes = [("fs", "0"), ("unit", "N")];
        let attributes = attributes.map(|(key, value)| (key.to_owned(), value.to_owned()));
        assert_eq!(attributes_in(&all), attributes);
        let (columns, ..) = columns_of_log(FileKind::Matlab, all, None).unwrap();
        let columns = columns.unwrap().into_iter();
        let found: Vec<_> = columns.map(|of| (of.name, of.unit.unwrap_or_default())).collect();
        let expected = [("t", "ms"), ("fz", "kN")];
        assert_eq!(found, expected.map(|(name, unit)| (name.to_owned(), unit.to_owned())));
    }
}
