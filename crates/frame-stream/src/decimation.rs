//! Reduction of the row rate without aliasing.
//!
//! Every number passes a causal 8th-order Butterworth low-pass with a cutoff of 0.4 of the new
//! rate, and every n-th row is passed on. Components above 0.6 of the new rate, whose aliases would
//! be below 0.4 of it, are attenuated by at least √(1 + 1.5¹⁶), 28 dB (S. Butterworth, 1930); above
//! the new rate by 64 dB. The filter delays its passband by about 1/rate.

use forces::filter::{Butterworth, Filter, FilterError};
use forces::{Clock, ClockSearch, Grid, RowRule};
use shared_proto::CHANNELS;
use shell_data::wrench::Axis;

use crate::encoding::StreamRow;

const ORDER: usize = 8;

const CUTOFF: f64 = 0.4;

/// Fraction of an old signal at which the filter counts as settled.
const FORGOTTEN: f64 = 1e-6;

const COLUMNS: usize = CHANNELS + Axis::ALL.len();

#[derive(Clone, Debug)]
pub struct Decimator {
    rate_hz: f64,
    stage: Stage,
    flags: String,
    lost: bool,
}

#[derive(Clone, Debug)]
enum Stage {
    Search(ClockSearch, Vec<StreamRow>),
    All,
    Filtered(Box<Filtered>),
}

#[derive(Clone, Debug)]
struct Filtered {
    clock: Clock,
    grid: Grid,
    memory: u64,
    design: Butterworth,
    /// For each column, the filter's state before the newest slot, and the newest value.
    filters: Vec<Option<(Filter, f64)>>,
    slot: u64,
    /// Number of the period, at the new rate, in which the last row was passed on.
    period: Option<i64>,
}

impl Decimator {
    pub fn new(rate_hz: f64) -> Self {
        let stage = Stage::Search(ClockSearch::default(), Vec::new());
        Self { rate_hz, stage, flags: String::new(), lost: false }
    }

    /// Takes rows; returns the rows to pass on. The first rows wait until the rows' rate is known. Fails with
    /// [`FilterError`] if the new rate is too low for the rate of the rows.
    pub fn push(
        &mut self,
        rows: Vec<StreamRow>,
        ended: bool,
    ) -> Result<Vec<StreamRow>, FilterError> {
        let rows = match &mut self.stage {
            Stage::All => return Ok(rows),
            Stage::Filtered(_) => rows,
            Stage::Search(search, waiting) => {
                let times_s: Vec<f64> = rows.iter().map(time_s).collect();
                search.look_at(&times_s);
                waiting.extend(rows);
                if !(search.is_done() || ended) {
                    return Ok(Vec::new());
                }
                let (clock, rows) = (search.finish(None), std::mem::take(waiting));
                self.stage = stage(clock, self.rate_hz)?;
                rows
            }
        };
        let Stage::Filtered(filtered) = &mut self.stage else { return Ok(rows) };
        let (rate_hz, flags, lost) = (self.rate_hz, &mut self.flags, &mut self.lost);
        let mut passed = Vec::new();
        for mut row in rows {
            row.flags.split(' ').for_each(|flag| add_flag(flags, flag));
            *lost |= row.lost;
            if filtered.take(&mut row, rate_hz) {
                row.flags = std::mem::take(flags);
                row.lost = std::mem::take(lost);
                passed.push(row);
            }
        }
        Ok(passed)
    }
}

fn add_flag(flags: &mut String, flag: &str) {
    if flags.split(' ').any(|known| known == flag) || flag.is_empty() {
        return;
    }
    if !flags.is_empty() {
        flags.push(' ');
    }
    flags.push_str(flag);
}

fn time_s(row: &StreamRow) -> f64 {
    row.time_us as f64 / 1e6
}

fn stage(clock: Option<Clock>, rate_hz: f64) -> Result<Stage, FilterError> {
    let Some(clock) = clock.filter(|clock| clock.rate_hz > rate_hz) else { return Ok(Stage::All) };
    let design = Butterworth::low_pass(ORDER, CUTOFF * rate_hz, clock.rate_hz)?;
    Ok(Stage::Filtered(Box::new(Filtered {
        clock,
        grid: Grid::new(clock, RowRule::Time),
        memory: design.memory(FORGOTTEN) as u64,
        design,
        filters: vec![None; COLUMNS],
        slot: 0,
        period: None,
    })))
}

impl Filtered {
    fn take(&mut self, row: &mut StreamRow, rate_hz: f64) -> bool {
        let slot = self.grid.slots(&[time_s(row)])[0];
        let steps = slot - std::mem::replace(&mut self.slot, slot);
        if steps > self.memory {
            self.filters.fill(None);
        }
        let readings = row.readings.iter_mut().flatten().enumerate();
        let wrench = row.wrench.iter_mut().flatten().enumerate();
        let wrench = wrench.map(|(axis, value)| (CHANNELS + axis, value));
        for (column, value) in readings.chain(wrench) {
            match &mut self.filters[column] {
                Some((filter, last)) => {
                    // A slot without a row repeats the previous one.
                    (0..steps).for_each(|_| filter.process(&mut [*last]));
                    *last = *value;
                    *value = filter.peek(*value);
                }
                none => *none = Some((Filter::settled(&self.design, *value), *value)),
            }
        }
        // Use the middle of the slot, so that rounding does not move a row into the next period.
        let periods = ((slot as f64 + 0.5) * rate_hz / self.clock.rate_hz).floor() as i64;
        let is_due = self.period.is_none_or(|last| periods > last);
        self.period = self.period.max(Some(periods));
        is_due
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    fn row(index: i64, period_us: i64, value: f64) -> StreamRow {
        StreamRow {
            time_us: index * period_us,
            index,
            host_us: 0,
            readings: None,
            wrench: Some([value; 6]),
            standard_errors: None,
            flags: if index == 777 { "mark1".to_owned() } else { String::new() },
            lost: index == 777,
        }
    }

    fn decimated(rate_hz: f64, sine_hz: f64) -> Vec<StreamRow> {
        let mut decimator = Decimator::new(rate_hz);
        let rows = (0..3000).map(|i| row(i, 1000, (TAU * sine_hz * i as f64 / 1000.0).sin()));
        rows.flat_map(|row| decimator.push(vec![row], false).unwrap()).collect()
    }

    #[test]
    fn a_rate_that_is_too_low_is_refused_and_no_row_is_held_back() {
        let rows = || (0..60).map(|i| row(i, 1000, 1.0)).collect::<Vec<_>>();
        assert!(Decimator::new(1e-6).push(rows(), false).is_err());
        let mut few = Decimator::new(100.0);
        assert_eq!(few.push(rows()[..20].to_vec(), false), Ok(Vec::new()));
        let passed: Vec<i64> =
            few.push(Vec::new(), true).unwrap().iter().map(|row| row.index).collect();
        assert_eq!(passed, [0, 10]);
    }

    /// Returns the amplitude of a sine by its mean square over whole periods: few samples hit the peak.
    fn amplitude(rows: &[StreamRow]) -> f64 {
        let rows = rows.iter().filter(|row| row.index >= 1000);
        let values: Vec<f64> = rows.map(|row| row.wrench.unwrap()[0]).collect();
        let squares: f64 = values.iter().map(|value| value * value).sum();
        (2.0 * squares / values.len() as f64).sqrt()
    }

    #[test]
    fn rows_come_evenly_and_flags_are_kept() {
        let rows = decimated(100.0, 5.0);
        assert_eq!(rows.len(), 300);
        assert!(rows.windows(2).all(|pair| pair[1].index - pair[0].index == 10));
        let marked: Vec<i64> =
            rows.iter().filter(|row| row.flags == "mark1").map(|row| row.index).collect();
        assert_eq!(marked, [780]);
        assert!(rows.iter().all(|row| row.lost == (row.index == 780)));
        // 1000/300 is no integer: rows are three or four apart.
        assert_eq!(decimated(300.0, 5.0).len(), 900);
        assert_eq!(decimated(1000.0, 5.0).len(), 3000);
        assert_eq!(decimated(5000.0, 5.0).len(), 3000);
    }

    #[test]
    fn frequencies_above_the_new_nyquist_are_removed_and_lower_ones_pass() {
        // Butterworth's formula at 0.2, 0.65 and 1.05 of the new rate.
        for (sine_hz, least, most) in
            [(20.0, 0.99, 1.01), (65.0, 0.0, 1.0 / 1.5_f64.powi(8)), (105.0, 0.0, 1e-3)]
        {
            let found = amplitude(&decimated(100.0, sine_hz));
            assert!((least..=most).contains(&found), "{sine_hz} Hz: {found}");
        }
    }
}
