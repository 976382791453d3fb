//! A run of consecutive log rows, column by column, in SI units.
//!
//! Logs are read and worked on in blocks, so that memory does not grow with the length of a file
//! and the inner loops run down contiguous columns.

/// Frames that belong together, such as those of a load that was held: all from one to another.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameLabel {
    /// The index of the first.
    pub from: i64,
    /// That of the last.
    pub until: i64,
    /// The label of the group.
    pub group: String,
}

/// The lines of a log that the rows of a block are on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RowLines {
    /// The number of the first line of the block.
    pub first: u64,
    /// Lines that are no rows: how many there are before which row, by row.
    pub passed: Vec<(usize, u64)>,
}

impl RowLines {
    /// The number of a row's line.
    pub fn line(&self, row: usize) -> u64 {
        let before = self.passed.iter().take_while(|(next, _)| *next <= row);
        self.first + row as u64 + before.map(|(_, lines)| lines).sum::<u64>()
    }
}

/// A run of consecutive rows of a log. Columns that were not asked for are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Block {
    /// Number of rows.
    pub rows: usize,
    /// Where its text starts in the log, in bytes: no two blocks of a log have the same.
    pub offset: u64,
    /// The lines that its rows are on, as it was read.
    pub lines: RowLines,
    /// Time in s.
    pub time_s: Vec<f64>,
    /// Readings in counts, one column per channel; the last [`memory_columns`](Self::memory_columns) are terms that a
    /// calibration adds to them.
    pub readings: Vec<Vec<f64>>,
    /// How many columns follow those of the channels.
    pub memory_columns: usize,
    /// Wrench in N and N·m, six columns in the order of [`crate::wrench::Axis::ALL`]; those of axes that the
    /// log has not are zero.
    pub wrench: Vec<Vec<f64>>,
    /// Group labels, run-length encoded: label and number of rows, in row order.
    pub groups: Vec<(String, usize)>,
    /// How much each row counts in a sum of squares; empty where all count the same, as in every log.
    pub weights: Vec<f64>,
    /// Further columns that were asked for by position, as they stand in the log.
    pub others: Vec<Vec<f64>>,
    /// Columns of text that were asked for by position, run-length encoded as the groups are.
    pub texts: Vec<Vec<(String, usize)>>,
    /// The readings of the row just before this block, `None` at the start of a log.
    pub readings_before: Option<Vec<f64>>,
}

impl Block {
    /// The readings as they were recorded.
    pub fn channels(&self) -> &[Vec<f64>] {
        &self.readings[..self.readings.len() - self.memory_columns]
    }

    /// Leaves the readings as they were recorded.
    pub fn drop_memory(&mut self) {
        self.readings.truncate(self.readings.len() - self.memory_columns);
        self.memory_columns = 0;
    }

    /// Adds the rows that follow, column by column.
    pub fn join(&mut self, next: Self) {
        fn join<T>(columns: &mut Vec<Vec<T>>, next: Vec<Vec<T>>) {
            columns.resize_with(next.len(), Vec::new);
            columns.iter_mut().zip(next).for_each(|(column, next)| column.extend(next));
        }
        self.rows += next.rows;
        self.time_s.extend(next.time_s);
        self.groups.extend(next.groups);
        join(&mut self.readings, next.readings);
        join(&mut self.wrench, next.wrench);
        join(&mut self.others, next.others);
        join(&mut self.texts, next.texts);
    }

    /// For every row, whether its readings differ from those of the row before it.
    ///
    /// A repeat in a log that runs faster than its sensor is not a new frame. The first row of a
    /// log is always fresh.
    pub fn fresh_rows(&self) -> Vec<bool> {
        let channels = self.channels();
        let firsts = channels.iter().filter_map(|column| column.first());
        let is_new = |before: &Vec<f64>| !firsts.eq(before);
        let first = self.readings_before.as_ref().is_none_or(is_new);
        // Nearly every row of a sensor that runs as fast as its log differs in the first channel.
        let differs = |row: usize| channels.iter().any(|column| column[row] != column[row - 1]);
        (0..self.rows).map(|row| if row == 0 { first } else { differs(row) }).collect()
    }

    /// The number of rows that are not fresh, see [`Block::fresh_rows`]; 0 without readings.
    pub fn repeated_rows(&self) -> usize {
        match self.readings.is_empty() {
            true => 0,
            false => self.fresh_rows().iter().filter(|fresh| !**fresh).count(),
        }
    }

    /// The rows for which `keep` is true, in every column.
    ///
    /// # Panics
    /// If there is not one flag per row.
    #[must_use]
    pub fn kept(&self, keep: &[bool]) -> Self {
        assert_eq!(keep.len(), self.rows, "one flag per row");
        let rows = keep.iter().filter(|&&keep| keep).count();
        let column = |column: &Vec<f64>| {
            let mut kept = Vec::with_capacity(rows.min(column.len()));
            kept.extend(column.iter().zip(keep).filter(|(_, keep)| **keep).map(|(value, _)| value));
            kept
        };
        let columns = |of: &[Vec<f64>]| of.iter().map(column).collect();
        Self {
            rows,
            time_s: column(&self.time_s),
            readings: columns(&self.readings),
            wrench: columns(&self.wrench),
            weights: column(&self.weights),
            others: columns(&self.others),
            groups: kept_runs(&self.groups, keep),
            texts: self.texts.iter().map(|runs| kept_runs(runs, keep)).collect(),
            offset: self.offset,
            lines: self.lines.clone(),
            memory_columns: self.memory_columns,
            readings_before: self.readings_before.clone(),
        }
    }
}

/// The runs of the rows for which `keep` is true.
pub(crate) fn kept_runs(runs: &[(String, usize)], keep: &[bool]) -> Vec<(String, usize)> {
    let mut rest = keep;
    let kept = runs.iter().map(|(label, rows)| {
        let (own, others) = rest.split_at(*rows);
        rest = others;
        (label, own.iter().filter(|&&keep| keep).count())
    });
    kept.filter(|(_, rows)| *rows > 0).map(|(label, rows)| (label.clone(), rows)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block() -> Block {
        Block {
            rows: 4,
            time_s: vec![0.0, 1.0, 2.0, 3.0],
            readings: vec![vec![5.0, 5.0, 6.0, 6.0], vec![7.0, 7.0, 7.0, 7.0]],
            groups: vec![("a".into(), 3), ("b".into(), 1)],
            texts: vec![vec![("x".into(), 2), ("y".into(), 2)]],
            ..Block::default()
        }
    }

    #[test]
    fn first_row_of_a_log_is_fresh_and_repeats_are_not() {
        assert_eq!(block().fresh_rows(), [true, false, true, false]);
    }

    #[test]
    fn a_block_that_continues_a_log_compares_with_the_row_before_it() {
        let block = Block { readings_before: Some(vec![5.0, 7.0]), ..block() };
        assert_eq!(block.fresh_rows(), [false, false, true, false]);
    }

    #[test]
    fn repeated_rows_are_those_that_are_not_fresh() {
        let mut random = 1_u32;
        for rows in [0, 1, 2, 32, 33, 34, 64, 65, 200] {
            let column = |_| {
                let step = |_| {
                    random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    f64::from(random >> 31)
                };
                (0..rows).map(step).collect()
            };
            let readings: Vec<Vec<f64>> = (0..3).map(column).collect();
            for readings_before in [None, Some(vec![0.0; 3]), Some(vec![1.0; 3])] {
                let block =
                    Block { rows, readings: readings.clone(), readings_before, ..Block::default() };
                let stale = block.fresh_rows().iter().filter(|fresh| !**fresh).count();
                assert_eq!(block.repeated_rows(), stale);
            }
        }
        assert_eq!(Block { rows: 3, ..Block::default() }.repeated_rows(), 0);
    }

    #[test]
    fn some_rows_are_those_of_every_column_and_of_the_groups() {
        let block = block().kept(&[true, false, true, false]);
        assert_eq!(block.rows, 2);
        assert_eq!(block.time_s, [0.0, 2.0]);
        assert_eq!(block.readings, [[5.0, 6.0], [7.0, 7.0]]);
        assert_eq!(block.groups, [("a".to_string(), 2)]);
        assert_eq!(block.texts, [[("x".to_string(), 1), ("y".to_string(), 1)]]);
    }
}
