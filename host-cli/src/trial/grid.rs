//! Rows of a log on an even grid of time, for filters, which want even samples.

/// Where each row is on the grid. Slots between rows repeat the row before, as telemetry itself does
/// when the sensor has nothing new.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Grid {
    slots: Vec<usize>,
}

impl Grid {
    /// Rows at ascending `times` on a grid of `period_s`. A gap is filled with `longest_gap` slots at
    /// most: past its memory a filter does not notice.
    pub(super) fn by_time(times: &[f64], period_s: f64, longest_gap: usize) -> Self {
        let start = times.first().copied().unwrap_or_default();
        let (mut slot, mut tick) = (0, 0);
        let place = |&time: &f64| {
            let now = ((time - start) / period_s).round() as usize;
            slot += (now - tick).min(longest_gap.max(1));
            tick = now;
            slot
        };
        Self { slots: times.iter().map(place).collect() }
    }

    /// One slot a row, whatever the times.
    pub(super) fn by_row(rows: usize) -> Self {
        Self { slots: (0..rows).collect() }
    }

    /// `signal`, one value a row, on the grid.
    pub(super) fn spread(&self, signal: &[f64]) -> Vec<f64> {
        let mut even = Vec::with_capacity(self.slots.last().map_or(0, |last| last + 1));
        for (&slot, &value) in self.slots.iter().zip(signal) {
            let held = even.last().copied().unwrap_or(value);
            // Of two rows in one slot the later counts.
            even.truncate(slot);
            even.resize(slot, held);
            even.push(value);
        }
        even
    }

    /// The rows' values of a signal on the grid.
    pub(super) fn gather(&self, even: &[f64], signal: &mut [f64]) {
        for (&slot, value) in self.slots.iter().zip(signal) {
            *value = even[slot];
        }
    }
}

/// How many rows are missing between ascending `times` of rows that should be `period_s` apart.
pub(super) fn missing_rows(times: &[f64], period_s: f64) -> u64 {
    let missing = |pair: &[f64]| ((pair[1] - pair[0]) / period_s).round() as u64;
    times.windows(2).map(|pair| missing(pair).saturating_sub(1)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_rows_are_held_and_rows_keep_their_values() {
        let times = [1.0, 1.001, 1.0039, 1.005, 1.0051];
        let grid = Grid::by_time(&times, 0.001, 1000);
        let signal = [5.0, 6.0, 7.0, 8.0, 9.0];
        let even = grid.spread(&signal);
        assert_eq!(even, [5.0, 6.0, 6.0, 6.0, 7.0, 9.0]);
        let mut rows = [0.0; 5];
        grid.gather(&even, &mut rows);
        assert_eq!(rows, [5.0, 6.0, 7.0, 9.0, 9.0]);
        assert_eq!(missing_rows(&times, 0.001), 2);
        assert_eq!(Grid::by_row(3).spread(&signal[..3]), signal[..3]);
    }

    #[test]
    fn a_clock_that_drifts_by_less_than_half_a_period_a_row_keeps_the_grid_in_step() {
        let times: Vec<f64> = (0..10_000).map(|i| f64::from(i) * 1.001e-3).collect();
        let grid = Grid::by_time(&times, 1e-3, 1000);
        // 10.009 s after the first.
        assert_eq!(grid.slots[9999], 10_009);
    }

    #[test]
    fn a_gap_of_hours_does_not_fill_the_memory() {
        let grid = Grid::by_time(&[0.0, 0.001, 1e9, 1e9 + 0.001], 0.001, 50);
        assert_eq!(grid.slots, [0, 1, 51, 52]);
    }
}
