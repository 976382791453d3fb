//! Consecutive log rows, column by column, in SI units. Reading a log in blocks limits the memory, and inner loops run
//! down contiguous columns.

/// Consecutive frames with one label, such as a load that was held.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameLabel {
    pub from: i64,
    /// The index of the last frame.
    pub until: i64,
    pub group: String,
}

/// Line numbers of a block's rows in the log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RowLines {
    pub first: u64,
    /// Runs of skipped lines, in row order: the index of the next row, and the number of lines.
    pub passed: Vec<(usize, u64)>,
}

impl RowLines {
    pub fn line(&self, row: usize) -> u64 {
        let before = self.passed.iter().take_while(|(next, _)| *next <= row);
        self.first + row as u64 + before.map(|(_, lines)| lines).sum::<u64>()
    }
}

/// Consecutive rows of a log. Columns that were not requested are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Block {
    pub rows: usize,
    /// Position of the text in the log, in bytes; unique within a log.
    pub offset: u64,
    pub lines: RowLines,
    pub time_s: Vec<f64>,
    /// Readings in counts, one column per channel, followed by
    /// [`memory_columns`](Self::memory_columns) columns of terms that a calibration adds.
    pub readings: Vec<Vec<f64>>,
    /// Number of columns after the channels.
    pub memory_columns: usize,
    /// Wrench in N and N·m, six columns in the order of [`crate::wrench::Axis::ALL`]; axes that the
    /// log lacks are zero.
    pub wrench: Vec<Vec<f64>>,
    /// Group labels, run-length encoded: label and number of rows, in row order.
    pub groups: Vec<(String, usize)>,
    /// Weights in a sum of squares; empty if all are equal, as in every log.
    pub weights: Vec<f64>,
    /// Columns requested by position, unconverted.
    pub others: Vec<Vec<f64>>,
    /// Text columns requested by position, run-length encoded.
    pub texts: Vec<Vec<(String, usize)>>,
    /// Readings of the row just before this block, `None` at the start of a log.
    pub readings_before: Option<Vec<f64>>,
}

impl Block {
    /// Returns the readings as recorded, without memory columns.
    pub fn channels(&self) -> &[Vec<f64>] {
        &self.readings[..self.readings.len() - self.memory_columns]
    }

    pub fn drop_memory(&mut self) {
        self.readings.truncate(self.readings.len() - self.memory_columns);
        self.memory_columns = 0;
    }

    /// Appends the rows of the next block, column by column.
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

    /// Returns true for rows whose readings differ from the previous row's, and for the first row. A log that runs
    /// faster than its sensor repeats frames.
    pub fn fresh_rows(&self) -> Vec<bool> {
        let channels = self.channels();
        let firsts = channels.iter().filter_map(|column| column.first());
        let is_new = |before: &Vec<f64>| !firsts.eq(before);
        let first = self.readings_before.as_ref().is_none_or(is_new);
        // The search usually stops at the first channel, unless the log runs faster than the sensor.
        let differs = |row: usize| channels.iter().any(|column| column[row] != column[row - 1]);
        (0..self.rows).map(|row| if row == 0 { first } else { differs(row) }).collect()
    }

    /// Counts the rows that are not [fresh](Self::fresh_rows); 0 without readings.
    pub fn repeated_rows(&self) -> usize {
        match self.readings.is_empty() {
            true => 0,
            false => self.fresh_rows().iter().filter(|fresh| !**fresh).count(),
        }
    }

    /// Returns the rows for which `keep` is true, in every column.
    ///
    /// # Panics
    /// If the number of flags differs from the number of rows.
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
    fn a_subset_of_rows_applies_to_columns_and_groups() {
        let block = block().kept(&[true, false, true, false]);
        assert_eq!(block.rows, 2);
        assert_eq!(block.time_s, [0.0, 2.0]);
        assert_eq!(block.readings, [[5.0, 6.0], [7.0, 7.0]]);
        assert_eq!(block.groups, [("a".to_string(), 2)]);
        assert_eq!(block.texts, [[("x".to_string(), 1), ("y".to_string(), 1)]]);
    }
}
