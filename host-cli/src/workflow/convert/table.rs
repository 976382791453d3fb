//! Converted frames as CSV text.

use std::borrow::Cow;

use super::frames::ConvertedFrames;
use super::options::TableColumns;
use shell_data::escape;
use shell_data::wrench::{Axis, PerAxis};

/// Column of time, s, or of the number of the row, from 0.
pub(super) const TIME_COLUMN: &str = "t_s";
pub(super) const ROW_COLUMN: &str = "row";

pub(super) struct WrenchTable {
    /// The numeric columns, which come first.
    numbers: Vec<(String, NumberColumn)>,
    /// The names of the text columns: those carried along, and the flags.
    texts: Vec<String>,
    has_flags: bool,
    pub(super) readings: Vec<String>,
    channels: Vec<String>,
}

#[derive(Clone, Copy)]
enum NumberColumn {
    Time,
    Wrench(Axis),
    StandardError(Axis),
    /// The wrench plus this number of standard errors.
    Bound(Axis, f64),
    Kept(usize),
}

impl WrenchTable {
    /// `stamp` names the time column, `factors` are half-widths of the interval in standard errors, if one is
    /// written, `kept` the log's numeric and text columns carried along, `readings` the names of the readings.
    pub(super) fn new(
        (columns, stamp): (TableColumns, &str),
        factors: PerAxis<f64>,
        kept: &[Vec<String>; 2],
        readings: Vec<String>,
    ) -> Self {
        let TableColumns { time, axes, standard_errors, interval, flags: has_flags } = columns;
        let named = |axis: Axis, end: &str| axis.column().replace('_', end);
        let mut numbers = Vec::new();
        numbers.extend(time.then(|| (stamp.to_owned(), NumberColumn::Time)));
        numbers.extend(axes.iter().map(|it| (named(it, "_"), NumberColumn::Wrench(it))));
        let errors = axes.iter().map(|it| (named(it, "_se_"), NumberColumn::StandardError(it)));
        numbers.extend(errors.filter(|_| standard_errors));
        for (end, sign) in [("_lower_", -1.0), ("_upper_", 1.0)] {
            let bound = |it: Axis| NumberColumn::Bound(it, sign * factors[it.index()]);
            let bounds = axes.iter().map(|it| (named(it, end), bound(it)));
            numbers.extend(bounds.filter(|_| interval.is_some()));
        }
        // Rename columns of the log that have the name of one of ours.
        let own: Vec<String> = numbers.iter().map(|(name, _)| name.clone()).collect();
        let distinct = |name: &String| match own.contains(name) || has_flags && name == "flags" {
            true => format!("log_{name}"),
            false => name.clone(),
        };
        let [kept_numbers, kept_texts] = kept;
        let kept_numbers = kept_numbers.iter().enumerate();
        numbers.extend(kept_numbers.map(|(at, name)| (distinct(name), NumberColumn::Kept(at))));
        let flags = has_flags.then(|| "flags".to_owned());
        let texts = kept_texts.iter().map(distinct).chain(flags).collect();
        let channels = readings.iter().enumerate().map(|(at, name)| flag_name(at, name)).collect();
        Self { numbers, texts, has_flags, readings, channels }
    }

    /// Names of the columns, and whether each holds text.
    pub(super) fn names(&self) -> Vec<(String, bool)> {
        let numbers = self.numbers.iter().map(|(name, _)| (name.clone(), false));
        numbers.chain(self.texts.iter().map(|name| (name.clone(), true))).collect()
    }

    pub(super) fn header(&self) -> String {
        let names = self.names().into_iter();
        let fields: Vec<_> = names.map(|(name, _)| escape::csv_field(&name).into_owned()).collect();
        fields.join(",") + "\n"
    }

    pub(super) fn numbers<'a>(&self, frames: &'a ConvertedFrames) -> Vec<Cow<'a, [f64]>> {
        let values = |(_, column): &(String, NumberColumn)| match *column {
            NumberColumn::Time => Cow::from(&frames.time_s),
            NumberColumn::Wrench(axis) => Cow::from(&frames.wrench[axis.index()]),
            NumberColumn::StandardError(axis) => Cow::from(&frames.standard_errors[axis.index()]),
            NumberColumn::Bound(axis, factor) => {
                let errors = &frames.standard_errors[axis.index()];
                let pairs = frames.wrench[axis.index()].iter().zip(errors);
                pairs.map(|(value, error)| value + factor * error).collect()
            }
            NumberColumn::Kept(at) => Cow::from(&frames.kept[at]),
        };
        self.numbers.iter().map(values).collect()
    }

    /// The text columns: those carried along, and the flags.
    pub(super) fn texts(&self, frames: &ConvertedFrames) -> Vec<Vec<String>> {
        let flags = |row: usize| {
            let mut text = Vec::new();
            self.write_flags(frames, row, &mut text);
            String::from_utf8_lossy(&text).into_owned()
        };
        let flags = self.has_flags.then(|| (0..frames.len()).map(flags).collect());
        frames.texts.iter().cloned().chain(flags).collect()
    }

    /// Appends the flags of a frame: channels out of range, saturated, insensitive and left out.
    pub(super) fn write_flags(&self, frames: &ConvertedFrames, row: usize, text: &mut Vec<u8>) {
        let masks = frames.flags.each_ref().map(|flags| flags.get(row).copied().unwrap_or(0));
        let start = text.len();
        let mut flagged = masks.iter().fold(0, |all, mask| all | mask);
        while flagged != 0 {
            let channel = flagged.trailing_zeros() as usize;
            flagged &= flagged - 1;
            let name = self.channels.get(channel).map_or("", String::as_str);
            let words = ["range", "saturated", "insensitive", "left-out"];
            for (mask, what) in masks.into_iter().zip(words) {
                if mask >> channel & 1 == 1 {
                    let space = if text.len() > start { " " } else { "" };
                    text.extend_from_slice(format!("{space}{name}:{what}").as_bytes());
                }
            }
        }
    }

    /// Writes every number with the fewest digits that parse to the same number.
    pub(super) fn rows(&self, frames: &ConvertedFrames, text: &mut Vec<u8>) {
        let columns = self.numbers(frames);
        // About 20 bytes a number; reserving too much costs less than growing.
        text.reserve(frames.len() * (22 * columns.len() + 8));
        let mut digits = zmij::Buffer::new();
        for row in 0..frames.len() {
            for column in &columns {
                text.extend_from_slice(digits.format(column[row]).as_bytes());
                text.push(b',');
            }
            for column in &frames.texts {
                text.extend_from_slice(escape::csv_field(&column[row]).as_bytes());
                text.push(b',');
            }
            if self.has_flags {
                self.write_flags(frames, row, text);
            } else if !columns.is_empty() || !frames.texts.is_empty() {
                text.pop();
            }
            text.push(b'\n');
        }
    }
}

/// The name of a channel in flags: its name in the log without the separators of flags, or `s1` for the first
/// channel if channels are numbered so.
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
    use shell_data::wrench::Axes;

    use super::*;

    fn frames() -> ConvertedFrames {
        ConvertedFrames {
            time_s: vec![0.001302, 1425168310.852012],
            wrench: std::array::from_fn(|axis| vec![axis as f64 / 10.0, -1.0 / 3.0]),
            standard_errors: std::array::from_fn(|_| vec![0.5, 1e-20]),
            flags: [vec![0, 0b101], vec![0, 0b100], Vec::new(), Vec::new()],
            readings: Vec::new(),
            kept: Vec::new(),
            texts: Vec::new(),
        }
    }

    fn written(columns: TableColumns) -> String {
        let table = WrenchTable::new(
            (columns, TIME_COLUMN),
            [2.0; 6],
            &Default::default(),
            ["S1", "S2", "gap 3"].map(str::to_owned).to_vec(),
        );
        let mut text = table.header().into_bytes();
        table.rows(&frames(), &mut text);
        String::from_utf8(text).unwrap()
    }

    #[test]
    fn columns_carry_their_units_and_numbers_read_back_as_the_same_bits() {
        let axes = Axes::ALL;
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
        let axes = [Axis::Fz].into_iter().collect();
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
