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
    /// Time of the last row that was not late; NaN at the start.
    before: f64,
    /// Readings of that row; empty at the start.
    held: Vec<f64>,
    /// `e` of each channel, time constant by time constant.
    averages: Vec<f64>,
    rows: u64,
}

/// The effect of a row on the averages.
#[derive(Clone, Copy, PartialEq)]
enum RowKind {
    /// The averages follow the readings that were held until this row.
    Next,
    /// No effect: rows of later times came before it.
    Late,
    /// The averages start anew.
    First,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the calibration has memory terms by time, and there is no time")]
pub struct NoTime;

impl MemoryTerms {
    pub fn start(&self) -> MemoryState {
        let (held, averages) = (Vec::new(), Vec::new());
        MemoryState { memory: self.clone(), before: f64::NAN, held, averages, rows: 0 }
    }
}

impl MemoryState {
    /// Computes the terms of the next rows: a column for each channel, for each time constant in turn.
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
        let (kinds, shares) = self.steps(times_s, rows, by_time);
        let count = channels * self.memory.time_constants.len();
        self.held.resize(channels, 0.0);
        self.averages.resize(count, 0.0);
        let mut terms = vec![vec![0.0; rows]; count];
        for (of_constant, shares) in shares.iter().enumerate() {
            // The channels are independent: four at a time take little longer than one.
            let mut channel = 0;
            while channel < channels {
                let at = of_constant * channels + channel;
                let (held, readings) = (&self.held[channel..], &readings[channel..]);
                let (averages, terms) = (&mut self.averages[at..], &mut terms[at..]);
                channel += match channels - channel {
                    4.. => follow::<4>(&kinds, shares, readings, held, averages, terms),
                    _ => follow::<1>(&kinds, shares, readings, held, averages, terms),
                };
            }
        }
        if let Some(row) = kinds.iter().rposition(|kind| *kind != RowKind::Late) {
            self.held = readings.iter().map(|column| column[row]).collect();
        }
        Ok(terms)
    }

    /// Returns the kind of each row and, for each time constant, the share by which an average nears the reading.
    fn steps(
        &mut self,
        times_s: &[f64],
        rows: usize,
        by_time: bool,
    ) -> (Vec<RowKind>, Vec<Vec<f64>>) {
        let constants = &self.memory.time_constants;
        let (mut kinds, mut last_step) = (Vec::with_capacity(rows), f64::NAN);
        let mut shares = vec![Vec::with_capacity(rows); constants.len()];
        for row in 0..rows {
            let time = times_s.get(row).copied().filter(|_| by_time);
            let time = time.unwrap_or(self.rows as f64);
            self.rows += 1;
            let step = time - self.before;
            let kind = match self.memory.gap {
                gap if step >= 0.0 && gap.is_none_or(|gap| step <= gap) => RowKind::Next,
                Some(gap) if step < 0.0 && -step <= gap => RowKind::Late,
                _ => RowKind::First,
            };
            if kind != RowKind::Late {
                self.before = time;
            }
            for (shares, tau) in shares.iter_mut().zip(constants) {
                let last = shares.last().copied().filter(|_| step == last_step);
                shares.push(last.unwrap_or_else(|| -(-step / tau).exp_m1()));
            }
            last_step = step;
            kinds.push(kind);
        }
        (kinds, shares)
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

/// Computes the terms of `N` channels for one time constant, and returns `N`.
fn follow<const N: usize>(
    kinds: &[RowKind],
    shares: &[f64],
    readings: &[Vec<f64>],
    held: &[f64],
    averages: &mut [f64],
    terms: &mut [Vec<f64>],
) -> usize {
    let rows = kinds.len();
    let columns: [&[f64]; N] = std::array::from_fn(|at| &readings[at][..rows]);
    let mut terms = terms.iter_mut();
    let mut terms: [&mut [f64]; N] =
        std::array::from_fn(|_| &mut terms.next().expect("a column for each channel")[..rows]);
    let mut held: [f64; N] = std::array::from_fn(|at| held[at]);
    let mut moving: [f64; N] = std::array::from_fn(|at| averages[at]);
    for row in 0..rows {
        let (share, reading) = (shares[row], std::array::from_fn::<_, N, _>(|at| columns[at][row]));
        match kinds[row] {
            RowKind::Next => (0..N).for_each(|at| moving[at] += share * (held[at] - moving[at])),
            RowKind::Late => {}
            RowKind::First => moving = reading,
        }
        if kinds[row] != RowKind::Late {
            held = reading;
        }
        (0..N).for_each(|at| terms[at][row] = reading[at] - moving[at]);
    }
    averages[..N].copy_from_slice(&moving);
    N
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
