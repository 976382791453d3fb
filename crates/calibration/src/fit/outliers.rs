//! Outliers among training rows, and what is said of them.

use least_squares::quality::{in_units, significant};
use shell_data::dataset::RowSet;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// Why a row is an outlier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reason {
    /// A reading is outside the valid range.
    OutOfRange,
    /// The error of an axis is so many times its standard deviation.
    Error {
        /// The axis.
        axis: Axis,
        /// How many times.
        size: f64,
        /// Predicted less measured, N or N·m.
        error: f64,
        /// Whether such a load is possible; beyond all that were measured a model predicts nonsense.
        is_possible: bool,
    },
}

/// A suspicious row.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlier {
    /// The number of its log.
    pub log: usize,
    /// The offset of its block.
    pub offset: u64,
    /// The row of the block.
    pub row: usize,
    /// Why.
    pub reason: Reason,
    /// The columns that differ most from the rows before and after, most first; at least one.
    pub columns: Vec<OutlierColumn>,
}

/// A value and its neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlierColumn {
    /// The channel, or after all channels the axis of the wrench.
    pub column: usize,
    /// Its value in the row, N and N·m for loads.
    pub value: f64,
    /// Its value in the row before.
    pub before: Option<f64>,
    /// Its value in the row after.
    pub after: Option<f64>,
}

/// What was found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outliers {
    /// The rows, in their order.
    pub rows: Vec<Outlier>,
    /// Rows that stand out where those are too many to be slips: none of them is named.
    pub too_many: Option<usize>,
    /// Root mean square errors on the other rows of the fit to all rows, and of that without these.
    pub rms: Option<[PerAxis<f64>; 2]>,
}

impl Outliers {
    /// The rows, to be left out.
    pub fn excluded(&self) -> RowSet {
        self.rows.iter().map(|row| (row.log, row.offset, row.row)).collect()
    }

    /// What is to be said of them. `names` say where each row is.
    pub fn warnings(&self, axes: Axes, names: &[RowName]) -> Vec<String> {
        /// More would hide what else is said.
        const SHOWN: usize = 10;
        let in_words = |(row, name): (&Outlier, &RowName)| {
            let RowName { file, line, columns } = name;
            format!("suspicious reading: `{file}` line {line}: {}", row.why(columns))
        };
        let rows = self.rows.iter().zip(names);
        let mut said: Vec<String> = rows.take(SHOWN).map(in_words).collect();
        said.extend(self.too_many.map(|rows| {
            format!(
                "{rows} rows stand out by an error or a reading, too many for slips of single rows: the \
                 model does not follow them, or columns are not what they are taken for (`shellcal info`)"
            )
        }));
        let count = self.rows.len();
        let others =
            if count > SHOWN { format!(" ({SHOWN} of them listed above)") } else { String::new() };
        let worth = self.rms.as_ref().map_or_else(String::new, |rms| {
            let errors = in_units(axes.iter(), |axis| {
                let [with, without] = rms.map(|rms| significant(rms[axis], 3));
                format!("{with} → {without}")
            });
            format!("; RMS error on the other rows, with → without them: {errors}")
        });
        let s = if count == 1 { "" } else { "s" };
        said.extend((count > 0).then(|| format!("{count} suspicious row{s}{others}{worth}")));
        said
    }
}

/// Where a row is.
#[derive(Clone, Debug)]
pub struct RowName {
    /// Its file, or what else it comes from.
    pub file: String,
    /// Its line.
    pub line: u64,
    /// The names of the channels, then of all axes of the wrench.
    pub columns: Vec<String>,
}

impl Outlier {
    /// Which of a row's columns stand out, and by how much it is off. `names` are those of all columns.
    pub fn why(&self, names: &[String]) -> String {
        let columns = self.columns.iter().take(3).map(|column| {
            let beside: Vec<String> = [column.before, column.after]
                .into_iter()
                .flatten()
                .map(|x| x.to_string())
                .collect();
            let beside = match beside.len() {
                0 => String::new(),
                _ => format!(" (neighbours {})", beside.join(" and ")),
            };
            let name = names.get(column.column).map_or("", String::as_str);
            format!("`{name}` is {}{beside}", column.value)
        });
        let more = match self.columns.len().saturating_sub(3) {
            0 => String::new(),
            more => format!(" and {more} columns more"),
        };
        let why = match self.reason {
            Reason::OutOfRange => "outside the valid range".to_owned(),
            Reason::Error { axis, is_possible: false, .. } => {
                format!("{} cannot be predicted from such readings", axis.name())
            }
            Reason::Error { axis, size, error, .. } => format!(
                "{} is predicted {} {} off, {} standard deviations",
                axis.name(),
                significant(error, 3),
                axis.unit(),
                significant(size, 2)
            ),
        };
        format!("{}{more}; {why}", columns.collect::<Vec<_>>().join(", "))
    }
}
