//! Memory terms: the difference between a reading and its moving average.
//!
//! Flexures creep and gels relax, so a reading depends on earlier loads. A model may have, for each channel and each
//! time constant τ, the linear column
//!
//! ```text
//! m(t) = s(t) − e(t),    τ·de/dt = s − e
//! ```
//!
//! A reading is held until the next, so `e` at a row follows from the previous row by `e ← e + (1 − exp(−Δt/τ))·(s −
//! e)`, also for uneven, repeated and lost rows. A late row, which follows rows of later times, is compared with the
//! current `e` and changes nothing. A jump of the clock restarts the terms at zero, as at the start of a log.

use shell_data::block::Block;

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TimeBase {
    /// Seconds of the log's clock.
    #[serde(rename = "s")]
    Seconds,
    /// Rows, where logs have no clock.
    Rows,
}

impl TimeBase {
    pub const ALL: [Self; 2] = [Self::Seconds, Self::Rows];

    pub const fn unit(self) -> &'static str {
        match self {
            Self::Seconds => "s",
            Self::Rows => "rows",
        }
    }
}

#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct MemoryTerms {
    pub time_base: TimeBase,
    /// Time constants, ascending, in units of the time base.
    pub time_constants: Vec<f64>,
    /// A step of the clock beyond this, in either direction, restarts the terms; `None` if rows are counted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gap: Option<f64>,
}

#[derive(Clone, Debug)]
pub struct MemoryState {
    memory: MemoryTerms,
    before: Option<(f64, Vec<f64>)>,
    /// `e` of each channel, time constant by time constant.
    averages: Vec<f64>,
    rows: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the calibration has memory terms by time, and there is no time")]
pub struct NoTime;

impl MemoryTerms {
    pub fn start(&self) -> MemoryState {
        MemoryState { memory: self.clone(), before: None, averages: Vec::new(), rows: 0 }
    }
}

impl MemoryState {
    /// Computes the terms of the next rows: columns like those of `readings`, channel by channel for each constant.
    ///
    /// # Errors
    /// [`NoTime`] if the time constants are in seconds and `times_s` does not have a time for each row.
    pub fn terms(
        &mut self,
        times_s: &[f64],
        readings: &[Vec<f64>],
    ) -> Result<Vec<Vec<f64>>, NoTime> {
        let (channels, rows) = (readings.len(), readings.first().map_or(0, Vec::len));
        let by_time = self.memory.time_base == TimeBase::Seconds;
        if by_time && times_s.len() != rows {
            return Err(NoTime);
        }
        let count = channels * self.memory.time_constants.len();
        let mut terms: Vec<_> = (0..count).map(|_| Vec::with_capacity(rows)).collect();
        let mut shares = vec![0.0; self.memory.time_constants.len()];
        let mut last_step = f64::NAN;
        for row in 0..rows {
            let time = if by_time { times_s[row] } else { self.rows as f64 };
            self.rows += 1;
            let (before, held) = self.before.get_or_insert_with(|| (f64::NAN, vec![0.0; channels]));
            let step = time - *before;
            let is_late = step < 0.0 && self.memory.gap.is_some_and(|gap| -step <= gap);
            if step >= 0.0 && self.memory.gap.is_none_or(|gap| step <= gap) {
                if step != last_step {
                    for (share, tau) in shares.iter_mut().zip(&self.memory.time_constants) {
                        *share = -(-step / tau).exp_m1();
                    }
                    last_step = step;
                }
                for (averages, share) in self.averages.chunks_mut(channels).zip(&shares) {
                    for (average, held) in averages.iter_mut().zip(&*held) {
                        *average += share * (held - *average);
                    }
                }
            } else if !is_late {
                let readings = readings.iter().map(|column| column[row]);
                self.averages = readings.cycle().take(count).collect();
            }
            // Without a division by the number of channels, which would take most of the time.
            let by_constant = terms.chunks_mut(channels).zip(self.averages.chunks(channels));
            for (terms, averages) in by_constant {
                for ((term, average), column) in terms.iter_mut().zip(averages).zip(readings) {
                    term.push(column[row] - average);
                }
            }
            if !is_late {
                held.iter_mut().zip(readings).for_each(|(held, column)| *held = column[row]);
                *before = time;
            }
        }
        Ok(terms)
    }

    /// Appends the memory terms to the readings of the next rows, which must have none yet.
    ///
    /// # Errors
    /// [`NoTime`].
    pub fn extend(&mut self, block: &mut Block) -> Result<(), NoTime> {
        let terms = self.terms(&block.time_s, &block.readings)?;
        block.memory_columns = terms.len();
        block.readings.extend(terms);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn memory(time_constants: Vec<f64>) -> MemoryTerms {
        MemoryTerms { time_base: TimeBase::Seconds, time_constants, gap: Some(1.0) }
    }

    fn terms(memory: &MemoryTerms, times_s: &[f64], readings: &[f64]) -> Vec<f64> {
        memory.start().terms(times_s, &[readings.to_vec()]).unwrap().remove(0)
    }

    #[test]
    fn a_step_decays_with_the_time_constant_however_uneven_the_rows() {
        let times_s = [0.0, 0.1, 0.13, 0.5, 0.52, 0.9];
        let readings = [3.0, 5.0, 5.0, 5.0, 5.0, 5.0];
        let found = terms(&memory(vec![0.2]), &times_s, &readings);
        for (row, term) in found.iter().enumerate().skip(1) {
            let expected = 2.0 * (-(times_s[row] - 0.1) / 0.2).exp();
            // A few rounding errors of numbers up to 5.
            assert!((term - expected).abs() < 1e-14, "{term} {expected}");
        }
        assert_eq!(found[0], 0.0);
    }

    #[test]
    fn a_repeated_row_changes_nothing_that_follows() {
        let memory = memory(vec![0.05, 0.7]);
        let (times_s, readings) = ([0.0, 0.1, 0.2, 0.4, 0.5], [1.0, 4.0, -2.0, 3.0, 3.5]);
        let (repeated_s, repeated) =
            ([0.0, 0.1, 0.17, 0.2, 0.2, 0.4, 0.5], [1.0, 4.0, 4.0, -2.0, -2.0, 3.0, 3.5]);
        let once = terms(&memory, &times_s, &readings);
        let again = terms(&memory, &repeated_s, &repeated);
        let kept = [0, 1, 3, 5, 6].map(|row| again[row]);
        for (once, again) in once.iter().zip(kept) {
            assert!((once - again).abs() < 1e-14);
        }
    }

    #[test]
    fn a_row_that_was_overtaken_changes_nothing_that_follows() {
        let memory = memory(vec![0.3]);
        let in_order = terms(&memory, &[0.0, 0.1, 0.3], &[1.0, 4.0, 2.0]);
        let overtaken = terms(&memory, &[0.0, 0.1, 0.05, 0.3], &[1.0, 4.0, 9.0, 2.0]);
        assert_eq!([overtaken[0], overtaken[1], overtaken[3]], in_order[..]);
        assert!(overtaken[2].is_finite());
    }

    #[test]
    fn terms_start_anew_where_the_clock_jumps() {
        let memory = memory(vec![10.0]);
        let found = terms(&memory, &[0.0, 0.5, 9.0, 9.5, 2.0], &[0.0, 6.0, 7.0, 7.0, 1.0]);
        assert_eq!((found[0], found[2], found[4]), (0.0, 0.0, 0.0));
        assert!(found[1] > 5.0);
    }

    #[test]
    fn pieces_of_a_log_give_the_bits_of_the_whole() {
        let memory = memory(vec![0.02, 0.3]);
        let times_s: Vec<f64> = (0..50).map(|i| 0.01 * f64::from(i + i % 3)).collect();
        let readings: Vec<Vec<f64>> =
            (0..2).map(|c| (0..50).map(|i| f64::from(i * (7 + c) % 31)).collect()).collect();
        let whole = memory.start().terms(&times_s, &readings).unwrap();
        let (mut state, mut pieces) = (memory.start(), vec![Vec::new(); 4]);
        for rows in [0..1, 1..17, 17..17, 17..50] {
            let part: Vec<_> = readings.iter().map(|c| c[rows.clone()].to_vec()).collect();
            let terms = state.terms(&times_s[rows], &part).unwrap();
            pieces.iter_mut().zip(terms).for_each(|(all, part)| all.extend(part));
        }
        assert_eq!(pieces, whole);
    }

    #[test]
    fn by_rows_no_clock_is_needed_and_by_time_it_is() {
        let readings = [vec![1.0, 2.0]];
        assert_eq!(memory(vec![1.0]).start().terms(&[], &readings), Err(NoTime));
        let by_rows = MemoryTerms { time_base: TimeBase::Rows, ..memory(vec![1.0]) };
        assert_eq!(by_rows.start().terms(&[], &readings).unwrap(), [[0.0, 1.0]]);
    }
}
