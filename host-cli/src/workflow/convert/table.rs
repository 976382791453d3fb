//! Converted frames as CSV text.

use super::frames::ConvertedFrames;
use super::options::TableColumns;
use shell_data::escape;
use shell_data::wrench::{Axis, PerAxis};

/// The writer of a table.
pub(super) struct WrenchTable {
    columns: TableColumns,
    axes: Vec<Axis>,
    /// How many standard errors an interval reaches.
    factors: PerAxis<f64>,
    /// The names of the log's columns that are carried along.
    kept: Vec<String>,
    /// Those of them that are text.
    texts: Vec<String>,
    /// What the channels are called in flags.
    channels: Vec<String>,
}

/// What one column is made of.
enum WrittenColumn<'a> {
    Plain(&'a [f64]),
    /// Either end of an interval: a value, a standard error and how many of it.
    Bound(&'a [f64], &'a [f64], f64),
}

impl WrittenColumn<'_> {
    fn at(&self, row: usize) -> f64 {
        match self {
            WrittenColumn::Plain(column) => column[row],
            WrittenColumn::Bound(column, errors, factor) => column[row] + factor * errors[row],
        }
    }
}

impl WrenchTable {
    /// `factors` are those of the interval, if there is to be one; `kept` are the log's columns of numbers
    /// and of text that are carried along, `channels` the names of the readings.
    pub(super) fn new(
        columns: TableColumns,
        factors: PerAxis<f64>,
        kept: &[Vec<String>; 2],
        channels: &[String],
    ) -> Self {
        let axes = Axis::ALL.into_iter().filter(|axis| columns.axes[axis.index()]).collect();
        let channels = channels.iter().enumerate().map(|(at, name)| flag_name(at, name)).collect();
        let (kept_numbers, texts) = (Vec::new(), Vec::new());
        let mut table = Self { columns, axes, factors, kept: kept_numbers, texts, channels };
        let own = table.names();
        // Two columns of one name would be one too many.
        let distinct = |name: &String| match own.contains(name) {
            true => format!("log_{name}"),
            false => name.clone(),
        };
        let [numbers, texts] = kept.each_ref().map(|names| names.iter().map(distinct).collect());
        (table.kept, table.texts) = (numbers, texts);
        table
    }

    /// How many columns hold text, which are the last: those that are carried along, and the flags.
    pub(super) fn text_columns(&self) -> usize {
        self.texts.len() + usize::from(self.columns.flags)
    }

    /// The names of the columns: numbers, text, flags.
    pub(super) fn names(&self) -> Vec<String> {
        let mut names = Vec::new();
        if self.columns.time {
            names.push("t_s".to_owned());
        }
        names.extend(self.axes.iter().map(|axis| axis.column().to_owned()));
        if self.columns.standard_errors {
            names.extend(self.axes.iter().map(|axis| axis.column().replace('_', "_se_")));
        }
        if self.columns.interval.is_some() {
            for end in ["_lower_", "_upper_"] {
                names.extend(self.axes.iter().map(|axis| axis.column().replace('_', end)));
            }
        }
        names.extend(self.kept.iter().chain(&self.texts).cloned());
        if self.columns.flags {
            names.push("flags".to_owned());
        }
        names
    }

    /// The line of names.
    pub(super) fn header(&self) -> String {
        let names = self.names();
        let fields: Vec<_> = names.iter().map(|name| escape::csv_field(name)).collect();
        fields.join(",") + "\n"
    }

    /// The columns of numbers.
    pub(super) fn numbers(&self, frames: &ConvertedFrames) -> Vec<Vec<f64>> {
        let values =
            |column: WrittenColumn<'_>| (0..frames.len()).map(|row| column.at(row)).collect();
        self.columns_of(frames).into_iter().map(values).collect()
    }

    /// The columns of text: those that are carried along, and the flags.
    pub(super) fn texts(&self, frames: &ConvertedFrames) -> Vec<Vec<String>> {
        let flags = |row: usize| {
            let mut text = Vec::new();
            self.write_flags(frames, row, &mut text);
            String::from_utf8_lossy(&text).into_owned()
        };
        let flags = self.columns.flags.then(|| (0..frames.len()).map(flags).collect());
        frames.texts.iter().cloned().chain(flags).collect()
    }

    /// Adds the flags of a frame: channels out of range, saturated and left out.
    pub(super) fn write_flags(&self, frames: &ConvertedFrames, row: usize, text: &mut Vec<u8>) {
        let left_out = frames.left_out.get(row).copied().unwrap_or(0);
        let masks = [frames.out_of_range[row], frames.saturated[row], left_out];
        let start = text.len();
        let mut flagged = masks[0] | masks[1] | masks[2];
        while flagged != 0 {
            let channel = flagged.trailing_zeros() as usize;
            flagged &= flagged - 1;
            let name = self.channels.get(channel).map_or("", String::as_str);
            for (mask, what) in masks.into_iter().zip(["range", "saturated", "left-out"]) {
                if mask >> channel & 1 == 1 {
                    let space = if text.len() > start { " " } else { "" };
                    text.extend_from_slice(format!("{space}{name}:{what}").as_bytes());
                }
            }
        }
    }

    fn columns_of<'a>(&self, frames: &'a ConvertedFrames) -> Vec<WrittenColumn<'a>> {
        let TableColumns { time, standard_errors, interval, .. } = self.columns;
        let wrench = |axis: &Axis| -> &'a [f64] { &frames.wrench[axis.index()] };
        let error = |axis: &Axis| -> &'a [f64] { &frames.standard_errors[axis.index()] };
        let mut columns = Vec::new();
        if time {
            columns.push(WrittenColumn::Plain(&frames.time_s));
        }
        columns.extend(self.axes.iter().map(|axis| WrittenColumn::Plain(wrench(axis))));
        if standard_errors {
            columns.extend(self.axes.iter().map(|axis| WrittenColumn::Plain(error(axis))));
        }
        if interval.is_some() {
            for sign in [-1.0, 1.0] {
                let factor = |axis: &Axis| sign * self.factors[axis.index()];
                let bound = |axis| WrittenColumn::Bound(wrench(axis), error(axis), factor(axis));
                columns.extend(self.axes.iter().map(bound));
            }
        }
        columns.extend(frames.kept.iter().map(|column| WrittenColumn::Plain(column)));
        columns
    }

    /// Writes every number with the fewest digits that read back as the same number.
    pub(super) fn rows(&self, frames: &ConvertedFrames, text: &mut Vec<u8>) {
        let flags = self.columns.flags;
        let columns = self.columns_of(frames);
        // Some 20 bytes a number; a little much costs less than growing.
        text.reserve(frames.len() * (22 * columns.len() + 8));
        let mut digits = zmij::Buffer::new();
        for row in 0..frames.len() {
            for column in &columns {
                text.extend_from_slice(digits.format(column.at(row)).as_bytes());
                text.push(b',');
            }
            for column in &frames.texts {
                text.extend_from_slice(escape::csv_field(&column[row]).as_bytes());
                text.push(b',');
            }
            if flags {
                self.write_flags(frames, row, text);
            } else if !columns.is_empty() || !frames.texts.is_empty() {
                // No comma after the last.
                text.pop();
            }
            text.push(b'\n');
        }
    }
}

/// What a channel is called in flags: its name in the log without what separates flags, or `s1` for the
/// first of channels that are numbered so.
fn flag_name(channel: usize, name: &str) -> String {
    let numbered = format!("s{}", channel + 1);
    match name.trim() {
        "" => numbered,
        name if name.eq_ignore_ascii_case(&numbered) => numbered,
        name => name
            .chars()
            .map(|c| if c.is_whitespace() || ":,;\"\\".contains(c) { '_' } else { c })
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames() -> ConvertedFrames {
        ConvertedFrames {
            time_s: vec![0.001302, 1425168310.852012],
            wrench: std::array::from_fn(|axis| vec![axis as f64 / 10.0, -1.0 / 3.0]),
            standard_errors: std::array::from_fn(|_| vec![0.5, 1e-20]),
            out_of_range: vec![0, 0b101],
            saturated: vec![0, 0b100],
            left_out: Vec::new(),
            readings: Vec::new(),
            kept: Vec::new(),
            texts: Vec::new(),
        }
    }

    fn written(columns: TableColumns) -> String {
        let table = WrenchTable::new(
            columns,
            [2.0; 6],
            &Default::default(),
            &["S1", "S2", "gap 3"].map(str::to_owned),
        );
        let mut text = table.header().into_bytes();
        table.rows(&frames(), &mut text);
        String::from_utf8(text).unwrap()
    }

    #[test]
    fn columns_carry_their_units_and_numbers_read_back_as_the_same_bits() {
        let axes = [true; 6];
        let columns =
            TableColumns { time: true, axes, standard_errors: true, interval: None, flags: true };
        let text = written(columns);
        let mut lines = text.lines();
        assert_eq!(
            lines.next(),
            Some(
                "t_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm,\
                 fx_se_n,fy_se_n,fz_se_n,mx_se_nm,my_se_nm,mz_se_nm,flags"
            )
        );
        for (row, line) in lines.enumerate() {
            let fields: Vec<_> = line.split(',').collect();
            assert_eq!(fields.len(), 14);
            assert_eq!(fields[0].parse(), Ok(frames().time_s[row]));
            for axis in 0..6 {
                assert_eq!(fields[1 + axis].parse(), Ok(frames().wrench[axis][row]));
                assert_eq!(fields[7 + axis].parse(), Ok(frames().standard_errors[axis][row]));
            }
            assert_eq!(fields[13], ["", "s1:range gap_3:range gap_3:saturated"][row]);
        }
    }

    #[test]
    fn only_the_columns_asked_for_are_written() {
        let axes = [false, false, true, false, false, false];
        let columns = TableColumns {
            time: false,
            axes,
            standard_errors: false,
            interval: None,
            flags: false,
        };
        assert_eq!(written(columns), "fz_n\n0.2\n-0.3333333333333333\n");
        let columns = TableColumns { interval: Some(0.95), ..columns };
        let expected = "fz_n,fz_lower_n,fz_upper_n\n0.2,-0.8,1.2\n";
        assert!(written(columns).starts_with(expected), "{}", written(columns));
    }
}
