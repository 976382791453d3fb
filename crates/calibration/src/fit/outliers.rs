//! Outliers among training rows, and warnings about them.

use least_squares::quality::{in_units, significant};
use shell_data::dataset::RowSet;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// Reason why a row is an outlier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reason {
    OutOfRange,
    /// The error of an axis is too large for its standard deviation.
    Error {
        axis: Axis,
        /// In standard deviations.
        size: f64,
        /// Predicted minus measured, N or N·m.
        error: f64,
        /// False for a load far beyond all measured ones, where a model predicts nonsense.
        is_possible: bool,
    },
}

#[derive(Clone, Debug, PartialEq)]
pub struct Outlier {
    pub log: usize,
    pub offset: u64,
    pub row: usize,
    pub reason: Reason,
    /// Columns that differ most from the rows before and after, largest difference first; at least one.
    pub columns: Vec<OutlierColumn>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlierColumn {
    /// Channel, or axis of the wrench counted after all channels.
    pub column: usize,
    /// N and N·m for loads.
    pub value: f64,
    pub before: Option<f64>,
    pub after: Option<f64>,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outliers {
    /// In the order of the rows.
    pub rows: Vec<Outlier>,
    /// Number of rows that stand out, if too many for slips; they are not listed.
    pub too_many: Option<usize>,
    /// Root mean square errors on all other rows: of the fit to all rows, and of the fit without the outliers.
    pub rms: Option<[PerAxis<f64>; 2]>,
}

impl Outliers {
    pub fn excluded(&self) -> RowSet {
        self.rows.iter().map(|row| (row.log, row.offset, row.row)).collect()
    }

    /// Warnings about the outliers. `names` gives the file and line of each row.
    pub fn warnings(&self, axes: Axes, names: &[RowName]) -> Vec<String> {
        /// Maximum number of outliers to list: more would hide other warnings.
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

#[derive(Clone, Debug)]
pub struct RowName {
    pub file: String,
    pub line: u64,
    /// Names of the channels, followed by those of all axes of the wrench.
    pub columns: Vec<String>,
}

impl Outlier {
    /// Describes which columns stand out, and how large the error is. `names` has all columns.
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
