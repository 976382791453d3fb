//! From readings to forces: tared, filtered, row by row.

use super::error::TrialError;
use super::grid::Grid;
use super::options::{LowPass, Rule, TrialOptions};
use super::stretch::{Clock, Stretch};
use super::tare::TareFrames;
use crate::forces::filter::{Butterworth, Filter};
use calibration::Calibration;
use calibration::uncertainty::Tare;
use shell_data::wrench::{Axis, PerAxis};

/// How far a filter's answer may be from what it would be had it seen the whole log, as a share of
/// the largest change of the signal: far below what a converter's step means.
pub(super) const FORGOTTEN: f64 = 1e-12;

/// The forces of a stretch.
#[derive(Clone, Debug, Default)]
pub(super) struct Forces {
    /// Tared and filtered, one value a row, N and N·m; axes that were not asked for are empty.
    pub(super) wrench: PerAxis<Vec<f64>>,
    /// The number of the frame that each row shows.
    pub(super) frame_of_row: Vec<usize>,
    /// Readings of each frame, counts, one column a channel.
    pub(super) frames: Vec<Vec<f64>>,
    /// What was subtracted.
    pub(super) tare: Option<Tare>,
}

/// The filter for a log.
pub(super) fn design(
    low_pass: LowPass,
    clock: &Clock,
    options: &TrialOptions,
) -> Result<Butterworth, TrialError> {
    let rate_hz = options.rate_hz.unwrap_or(1.0 / clock.period_s);
    Ok(Butterworth::low_pass(low_pass.order, low_pass.cutoff_hz, rate_hz)?)
}

/// How far before the entry and after the exit rows are needed, s: what the filter remembers, with
/// a tenth to spare as `period_s`, the time from row to row, may be known roughly.
///
/// # Errors
/// [`TrialError::Filter`] if there can be no such filter at any rate.
pub fn warm_up_s(options: &TrialOptions, period_s: f64) -> Result<(f64, f64), TrialError> {
    let Some(low_pass) = options.low_pass else { return Ok((0.0, 0.0)) };
    // Well below the rate, memory is a matter of time alone; nearer, of samples.
    let fine =
        Butterworth::low_pass(low_pass.order, low_pass.cutoff_hz, 100.0 * low_pass.cutoff_hz)?;
    let rate_hz = options.rate_hz.unwrap_or(1.0 / period_s);
    let own = Butterworth::low_pass(low_pass.order, low_pass.cutoff_hz, rate_hz).ok();
    let seconds = |design: &Butterworth, period_s: f64| design.memory(FORGOTTEN) as f64 * period_s;
    let own = own.map_or(0.0, |design| seconds(&design, period_s));
    let seconds = 1.1 * seconds(&fine, 1.0 / fine.rate_hz()).max(own);
    Ok((seconds, if low_pass.zero_phase { seconds } else { 0.0 }))
}

impl Forces {
    /// The forces along `axes` of all rows of `stretch`.
    pub(super) fn new(
        stretch: &Stretch,
        calibration: &Calibration,
        tare: Option<&TareFrames>,
        axes: &[Axis],
        clock: &Clock,
        options: &TrialOptions,
    ) -> Result<Self, TrialError> {
        let tare = tare.and_then(|frames| calibration.tare(&frames.readings));
        let (frames, frame_of_row) = frames(stretch);
        let mut by_frame = PerAxis::default();
        calibration.wrench(&frames, &mut by_frame);
        let mut wrench = PerAxis::<Vec<f64>>::default();
        for axis in axes.iter().map(|axis| axis.index()) {
            let zero = tare.as_ref().map_or(0.0, |tare| tare.wrench[axis]);
            wrench[axis] = frame_of_row.iter().map(|&frame| by_frame[axis][frame] - zero).collect();
        }
        if let Some(low_pass) = options.low_pass {
            let design = design(low_pass, clock, options)?;
            let grid = match options.rule {
                Rule::Rows => Grid::by_row(stretch.times_s.len()),
                Rule::Time => {
                    let longest_gap = design.memory(FORGOTTEN) + 1;
                    Grid::by_time(&stretch.times_s, 1.0 / design.rate_hz(), longest_gap)
                }
            };
            let at_rest = tare.is_some() && stretch.starts_log;
            for signal in wrench.iter_mut().filter(|signal| !signal.is_empty()) {
                filter(signal, &grid, &design, low_pass.zero_phase, at_rest)?;
            }
        }
        Ok(Self { wrench, frame_of_row, frames, tare })
    }
}

/// Each frame once: its readings, and for every row the number of its frame.
fn frames(stretch: &Stretch) -> (Vec<Vec<f64>>, Vec<usize>) {
    let is_new = |row: usize| row == 0 || stretch.fresh[row];
    let rows: Vec<usize> = (0..stretch.times_s.len()).filter(|&row| is_new(row)).collect();
    let pick = |column: &Vec<f64>| rows.iter().map(|&row| column[row]).collect();
    let mut frame = 0;
    let frame_of_row = (0..stretch.times_s.len()).map(|row| {
        frame += usize::from(is_new(row));
        frame - 1
    });
    let frame_of_row = frame_of_row.collect();
    (stretch.readings.iter().map(pick).collect(), frame_of_row)
}

/// Filters a signal of rows. A causal filter starts at rest at zero where the log starts and is
/// tared, as the lab's `lfilter` did; else at the first value.
fn filter(
    signal: &mut [f64],
    grid: &Grid,
    design: &Butterworth,
    zero_phase: bool,
    at_rest: bool,
) -> Result<(), TrialError> {
    let mut even = grid.spread(signal);
    if zero_phase {
        design.zero_phase(&mut even)?;
    } else {
        let mut filter = Filter::new(design);
        filter.settle(if at_rest { 0.0 } else { even.first().copied().unwrap_or_default() });
        filter.process(&mut even);
    }
    grid.gather(&even, signal);
    Ok(())
}
