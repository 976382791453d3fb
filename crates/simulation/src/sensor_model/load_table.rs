//! A load that somebody has written down.

use shell_data::wrench::PerAxis;

/// Wrenches at times, with straight lines between them, over and over.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadTable {
    times_s: Vec<f64>,
    wrenches: Vec<PerAxis<f64>>,
}

/// Rows that are no load over time.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BadLoad {
    /// No rows.
    #[error("no rows")]
    Empty,
    /// A time that does not come after that of the row before, or is not finite.
    #[error("data row {row}: time {time_s} s does not come after the time of the row before")]
    Order {
        /// Data row, from 1.
        row: usize,
        /// Its time.
        time_s: f64,
    },
    /// A load that is no number, in this data row from 1.
    #[error("data row {0}: a load that is not finite")]
    NotFinite(usize),
}

impl LoadTable {
    /// Of one row per time; the first time is the start.
    ///
    /// # Errors
    /// [`BadLoad`].
    pub fn new(rows: impl IntoIterator<Item = (f64, PerAxis<f64>)>) -> Result<Self, BadLoad> {
        let (mut times_s, mut wrenches) = (Vec::<f64>::new(), Vec::new());
        for (row, (time_s, wrench)) in (1..).zip(rows) {
            if !(time_s.is_finite() && times_s.last().is_none_or(|&last| time_s > last)) {
                return Err(BadLoad::Order { row, time_s });
            }
            if !wrench.iter().all(|value| value.is_finite()) {
                return Err(BadLoad::NotFinite(row));
            }
            times_s.push(time_s);
            wrenches.push(wrench);
        }
        if times_s.is_empty() {
            return Err(BadLoad::Empty);
        }
        Ok(Self { times_s, wrenches })
    }

    /// The wrench (N and N·m) at `time_s` ≥ 0 since the start. The last row leads back to the first
    /// at once.
    pub fn wrench_at(&self, time_s: f64) -> PerAxis<f64> {
        let (first, last) = (self.times_s[0], self.times_s[self.times_s.len() - 1]);
        if last == first {
            return self.wrenches[0];
        }
        let time_s = first + time_s % (last - first);
        // The first row after this moment: never the first of all.
        let after = self.times_s.partition_point(|&at| at <= time_s);
        let Some(&right_s) = self.times_s.get(after) else {
            return self.wrenches[after - 1];
        };
        let left_s = self.times_s[after - 1];
        let share = (time_s - left_s) / (right_s - left_s);
        let (left, right) = (self.wrenches[after - 1], self.wrenches[after]);
        std::array::from_fn(|axis| left[axis] + share * (right[axis] - left[axis]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn along_x(newton: f64) -> PerAxis<f64> {
        [newton, 0.0, 0.0, 0.0, 0.0, 0.0]
    }

    #[test]
    fn loads_lie_on_straight_lines_and_repeat() {
        let table =
            LoadTable::new([(5.0, along_x(0.0)), (6.0, along_x(2.0)), (9.0, along_x(-1.0))]);
        let table = table.unwrap();
        for (time_s, newton) in
            [(0.0, 0.0), (0.5, 1.0), (1.0, 2.0), (2.5, 0.5), (4.0, 0.0), (4.25, 0.5)]
        {
            assert_eq!(table.wrench_at(time_s), along_x(newton), "{time_s}");
        }
    }

    #[test]
    fn one_row_is_a_load_for_ever() {
        let table = LoadTable::new([(3.0, along_x(1.5))]).unwrap();
        assert_eq!(table.wrench_at(1e6), along_x(1.5));
    }

    #[test]
    fn rows_that_are_no_load_over_time_are_refused() {
        assert_eq!(LoadTable::new([]), Err(BadLoad::Empty));
        let twice = LoadTable::new([(1.0, along_x(0.0)), (1.0, along_x(1.0))]);
        assert_eq!(twice, Err(BadLoad::Order { row: 2, time_s: 1.0 }));
        let infinite = LoadTable::new([(0.0, along_x(f64::INFINITY))]);
        assert_eq!(infinite, Err(BadLoad::NotFinite(1)));
        assert!(LoadTable::new([(f64::NAN, along_x(0.0))]).is_err());
    }
}
