//! Checks of a log.

use std::borrow::Cow;

use calibration::Calibration;
use calibration::memory::MemoryState;
use calibration::quality::{self, AxisErrors};
use calibration::validation::excitation::LONGEST_LEVER_M;
use log_file::{Column, Log, LogError, Meaning, ReadOptions, Wanted};
use shell_data::block::Block;
use shell_data::hint::with_causes;
use shell_data::statistics::RunningVariance;
use shell_data::wrench::{Axis, PerAxis};

use crate::channels::{
    best_exchange, channel_name, check_channels, exchanged, identical_in, outside,
    without_consequences,
};
use crate::poses::{LabelledRows, PoseJump};
use crate::rows::{KeptRows, are_still};
use crate::{Finding, percent};
use calibration_file::CalibrationFile;
use log_file::summary::LogSummary;

/// Limit on the jitter, as a share of the interval between frames.
const JITTER: f64 = 0.25;

/// Share of rows in which an unusable clock runs back. In concatenated logs, a clock runs back once per log.
const NO_CLOCK: f64 = 0.1;

/// Shares of missing rows: warning and fault.
const MISSING: [f64; 2] = [1e-3, 0.05];

const TARE_FRAMES: u64 = 50;

/// A log's error, relative to the training error, that starts a search for the reason.
const WORSE: f64 = 3.0;

/// Rows in the search for swapped channels, which takes 28 times as long as a conversion.
const SWAP_ROWS: usize = 20_000;

/// Minimum drift of the zero, as a share of the training load, and as a multiple of the scatter.
const DRIFT: f64 = 0.02;
const DRIFT_SCATTER: f64 = 4.0;

/// Rows per mean wrench that is kept to compare the ends of a log.
const STEP: usize = 64;

pub fn examine_log(
    log: Result<Log, LogError>,
    read: &ReadOptions<'_>,
    calibration: Option<&CalibrationFile>,
) -> Vec<Finding> {
    match log.and_then(|log| Ok(LogObservations::read(&log, read, calibration)?.check(&log))) {
        Ok(findings) => findings,
        Err(error) => {
            let advice = "name the columns, for example `--sensors 1-8 --wrench 9-14`; `--wrench-from` takes the \
                          wrench from another file; `docs/logs.md` has the formats that are read";
            vec![Finding::fault("unreadable", with_causes(&error), advice)]
        }
    }
}

#[derive(Default)]
struct LogObservations<'a> {
    calibration: Option<&'a CalibrationFile>,
    bad_rows: u64,
    first_bad: String,
    names: Vec<String>,
    summary: LogSummary,
    /// Lost frames, from the column `missing`.
    missing: Option<f64>,
    /// Sums of squares of the forces and of the moments.
    squares: [f64; 2],
    labelled: LabelledRows,
    rows: KeptRows<'static>,
    identical: Option<Vec<(usize, usize)>>,
    rows_outside: u64,
    memory: Option<MemoryState>,
    errors: PerAxis<AxisErrors>,
    kept: Block,
    /// Untared wrench in steps of [`STEP`] rows.
    means: Vec<PerAxis<RunningVariance>>,
}

impl<'a> LogObservations<'a> {
    fn read(
        log: &Log,
        read: &ReadOptions<'_>,
        calibration: Option<&'a CalibrationFile>,
    ) -> Result<Self, LogError> {
        let names = log.value_names().into_iter().take(log.channels()).map(str::to_owned);
        let mut found = Self { calibration, names: names.collect(), ..Self::default() };
        found.memory = calibration.and_then(|file| file.calibration.start_memory());
        let is_missing =
            |column: &Column| column.name == "missing" && column.meaning == Meaning::Other;
        let wanted = Wanted {
            time: log.has_time(),
            readings: log.channels() > 0,
            wrench: log.has_wrench(),
            groups: log.has_groups() && log.has_wrench(),
            others: log.columns().iter().position(is_missing).into_iter().collect(),
            ..Wanted::default()
        };
        let lenient = ReadOptions { skip_bad_rows: true, largest_bad_share: None, ..*read };
        let summary = log.read(&wanted, &lenient, std::mem::take, |block| {
            found.add(&block);
            Ok::<_, LogError>(())
        })?;
        found.bad_rows = summary.skipped_rows;
        if found.bad_rows > 0 {
            let strict = ReadOptions { skip_bad_rows: false, ..*read };
            let first = log.read(&wanted, &strict, |_| (), |()| Ok::<_, LogError>(())).err();
            found.first_bad = first.map(|error| with_causes(&error)).unwrap_or_default();
        }
        Ok(found)
    }

    fn add(&mut self, block: &Block) {
        self.summary.add(block);
        self.labelled.add(block);
        self.rows.add(Cow::Owned(Block {
            rows: block.rows,
            readings: block.readings.clone(),
            wrench: block.wrench.clone(),
            ..Block::default()
        }));
        if let [missing] = &block.others[..] {
            *self.missing.get_or_insert(0.0) += missing.iter().sum::<f64>();
        }
        let same = identical_in(&block.readings, self.identical.take());
        self.identical = Some(same);
        for (axis, column) in block.wrench.iter().enumerate() {
            self.squares[axis / 3] += column.iter().map(|value| value * value).sum::<f64>();
        }
        let Some(CalibrationFile { calibration, .. }) = self.calibration else { return };
        if block.readings.len() != calibration.channels() {
            return;
        }
        self.rows_outside += calibration.rows_out_of_range(&block.readings);
        let mut wrench = PerAxis::default();
        // Without the time that the terms need, the sensor is assumed to have been still.
        let terms = self.memory.as_mut().map(|memory| memory.terms(&block.time_s, &block.readings));
        match terms.and_then(Result::ok) {
            None => calibration.wrench(&block.readings, &mut wrench),
            Some(terms) => {
                calibration.wrench(&[&block.readings[..], &terms].concat(), &mut wrench);
            }
        }
        if !block.wrench.is_empty() {
            quality::merge(&mut self.errors, &quality::errors(&wrench, &block.wrench));
            let rows = block.rows.min(SWAP_ROWS - self.kept.rows);
            self.kept.append(block, 0..rows);
        }
        for start in (0..block.rows).step_by(STEP) {
            let end = (start + STEP).min(block.rows);
            self.means.push(wrench.each_ref().map(|axis| RunningVariance::new(&axis[start..end])));
        }
    }

    fn check(&self, log: &Log) -> Vec<Finding> {
        let Self { summary, names, .. } = self;
        if summary.readings.is_empty() && summary.wrench.is_empty() {
            let seen = "no column holds readings, and no six a wrench";
            let advice =
                "name them with `--sensors` or `--wrench`; `shellcal info` lists the columns";
            return vec![Finding::fault("no-values", seen, advice)];
        }
        let mut findings = Vec::new();
        if self.bad_rows > 0 {
            let seen = format!("{} wrong rows; the first: {}", self.bad_rows, self.first_bad);
            let advice = "correct them, or leave them out with `--skip-bad-rows`";
            findings.push(Finding::fault("bad-rows", seen, advice));
        }
        if let Some(found) = log.interleaving() {
            let (column, values) = (&found.column, found.values.join("`, `"));
            let seen = format!("rows of several sensors alternate, by `{column}`: `{values}`");
            let advice = format!("choose one with `--where '{column}={}'`", found.values[0]);
            findings.push(Finding::warning("sensors-interleaved", seen, advice));
        }
        self.check_length(log, &mut findings);
        self.check_timing(log, &mut findings);
        self.check_lever(log, &mut findings);
        let calibration = self.calibration.map(|file| &file.calibration);
        let of_its_size = calibration.filter(|of| of.channels() == summary.readings.len());
        let identical = self.identical.as_deref().unwrap_or_default();
        let readings = self.rows.readings();
        let still = are_still(&readings);
        check_channels((summary, still), names, identical, of_its_size, &mut findings);
        self.rows.check((summary, names), (&readings, log.axes()), &mut findings);
        for PoseJump { pose, rows_before, channel, means: [before, after] } in self.labelled.jumps()
        {
            let name = channel_name(names, channel);
            let seen = format!(
                "in pose `{pose}` {name} jumps from {before:.1} to {after:.1} after {rows_before} rows; its load is \
                 constant"
            );
            let advice =
                "rows of another pose under this label, or the sensor slipped: take them out";
            findings.push(Finding::warning("pose-jump", seen, advice));
        }
        if let Some(file) = self.calibration {
            self.check_calibrated(log, file, &mut findings);
        }
        without_consequences(&mut findings);
        findings
    }

    fn check_length(&self, log: &Log, findings: &mut Vec<Finding>) {
        let summary = &self.summary;
        let repeats = if log.repeats_are_stale() { summary.repeated_rows } else { 0 };
        let frames = summary.rows - repeats;
        if frames < TARE_FRAMES && !summary.readings.is_empty() {
            let advice = format!("record longer: a tare alone takes {TARE_FRAMES}");
            findings.push(Finding::warning("short", format!("{frames} frames"), advice));
        }
    }

    fn check_lever(&self, log: &Log, findings: &mut Vec<Finding>) {
        let [forces, moments] = self.squares;
        let lever_m = (moments / forces).sqrt();
        if forces > 0.0 && log.axes().are_all() && lever_m > LONGEST_LEVER_M {
            let seen = format!("moments / forces = {lever_m:.1} m");
            let advice = "moments are probably in mN·m (N·mm): use `--moment-unit mnm`, or rename the columns";
            findings.push(Finding::fault("moment-unit", seen, advice));
        }
    }

    fn check_timing(&self, log: &Log, findings: &mut Vec<Finding>) {
        let (rows, timing) = (self.summary.rows, &self.summary.timing);
        let backward = timing.backward_steps;
        if !log.has_time() {
            let advice = "name it with `--time` if there is one; without it `fit` finds no lag, `convert` needs \
                          `--rate` or `--no-lowpass`, and losses cannot be seen";
            findings.push(Finding::warning("no-time", "there is no column of time", advice));
            return;
        }
        if backward as f64 > NO_CLOCK * rows as f64 {
            let seen =
                format!("what is taken for time runs backwards at {backward} of {rows} rows");
            let advice = "it holds no times: name the columns with `--sensors`, `--wrench` and `--time`; without a \
                          line of names they are taken for what their number suggests";
            findings.push(Finding::fault("no-clock", seen, advice));
            return;
        }
        if let Some(row) = timing.first_backward_row {
            let seen = format!("time runs backwards {backward} times, first at row {}", row + 1);
            // A fit takes concatenated recordings as groups.
            findings.push(match log.has_wrench() {
                true => {
                    let advice = "recordings that were put together, it seems: `fit` takes each as a group of its \
                                  own; `convert` needs `--no-lowpass`";
                    Finding::warning("time-backward", seen, advice)
                }
                false => {
                    let advice =
                        "recordings that were put together: take them apart; or a clock that was set";
                    Finding::fault("time-backward", seen, advice)
                }
            });
        }
        if timing.equal_times > rows / 100 {
            let seen =
                format!("{} of {rows} rows have the time of the row before", timing.equal_times);
            let advice =
                "the clock is too coarse, or rows were written twice: take one with more digits";
            findings.push(Finding::warning("time-equal", seen, advice));
        }
        findings.push(self.check_losses());
        if let (Some(interval), Some(jitter)) = (timing.median_interval_s(), timing.jitter_s())
            && jitter > JITTER * interval
        {
            let (interval, jitter) = (interval * 1e3, jitter * 1e3);
            let seen = format!("intervals of {interval:.3} ms scatter by {jitter:.3} ms");
            let advice = "these are times of arrival, it seems: take the clock of the board, and set the adapter's \
                          latency timer to 1 ms";
            findings.push(Finding::warning("jitter", seen, advice));
        }
        self.check_repeats(log, findings);
    }

    /// Checks for missing rows, by the log's count or else its clock.
    fn check_losses(&self) -> Finding {
        let gaps = self.summary.timing.gaps();
        let missing = self.missing.unwrap_or(gaps.missing_rows as f64);
        let frames = self.summary.rows as f64 + missing;
        let share = missing / frames.max(1.0);
        let seen = format!("{missing} of {frames} frames are missing ({})", percent(share));
        let advice =
            "results hold the frame before for each; `shellcal doctor PORT` looks for the reason";
        Finding::graded("losses", share, MISSING, seen, advice)
    }

    fn check_repeats(&self, log: &Log, findings: &mut Vec<Finding>) {
        let summary = &self.summary;
        let share = summary.repeated_rows as f64 / summary.rows.max(1) as f64;
        let is_alive = summary.readings.iter().any(|column| !column.is_constant());
        if !log.repeats_are_stale() && share > 0.5 && is_alive {
            let seen =
                format!("{} of the rows repeat the readings of the row before", percent(share));
            let advice =
                "the log runs faster than the sensor: thin it out, or record at the sensor's rate";
            findings.push(Finding::warning("repeats", seen, advice));
        }
    }

    fn check_calibrated(&self, log: &Log, file: &CalibrationFile, findings: &mut Vec<Finding>) {
        let (channels, calibrated) = (self.summary.readings.len(), file.calibration.channels());
        if channels != calibrated {
            let seen =
                format!("the log has {channels} channels, the calibration is for {calibrated}");
            let advice =
                "name the columns with `--sensors`, or take the calibration of this sensor";
            findings.push(Finding::fault("channels-other", seen, advice));
            return;
        }
        findings.extend(outside(self.rows_outside, self.summary.rows));
        findings.extend(self.check_errors(log, file));
        let known = file.origin.diagnostics.as_ref();
        let Some(loads) = known.and_then(|known| known.excitation.as_ref()) else { return };
        for (axis, moved, of) in drift(&self.means, &loads.largest_loads()) {
            let (name, unit, share) = (axis.name(), axis.unit(), percent(moved.abs() / of));
            let seen = format!(
                "{name} has moved by {moved:.3} {unit} from the first tenth to the last ({share} of its range)"
            );
            let advice = "if nothing touched the shell then: let it warm up, tare more often, and keep light off it";
            findings.push(Finding::warning("drift", seen, advice));
        }
    }

    /// Compares the error on the log with the training error, and looks for a reason.
    fn check_errors(&self, log: &Log, file: &CalibrationFile) -> Option<Finding> {
        let trained = file.origin.diagnostics.as_ref()?.train;
        let found: Vec<_> = self.errors.iter().map(AxisErrors::quality).collect::<Option<_>>()?;
        let ratio = |axis: Axis| found[axis.index()].rms / trained[axis.index()].rms;
        let axes = file.calibration.axes.and(log.axes());
        let ratios = axes.iter().map(|axis| (axis, ratio(axis)));
        let worst = ratios.max_by(|a, b| a.1.total_cmp(&b.1));
        let (axis, ratio) = worst.filter(|(_, ratio)| ratio.is_finite() && *ratio > WORSE)?;
        if let Some((channels, factor)) = find_swap(&file.calibration, &self.kept) {
            let seen = format!("the error is {factor:.1} times smaller");
            return Some(exchanged(&self.names, channels, &seen));
        }
        let seen =
            format!("the error of {} is {ratio:.1} times that of the training data", axis.name());
        let advice = "this is not the sensor that was calibrated, not as it was then, or beyond its range; \
                      `shellcal fit --outliers report` names outliers";
        Some(Finding::fault("error", seen, advice))
    }
}

fn find_swap(calibration: &Calibration, rows: &Block) -> Option<((usize, usize), f64)> {
    let explained = |readings: &[Vec<f64>]| {
        let mut wrench = PerAxis::default();
        calibration.wrench(readings, &mut wrench);
        let errors = quality::errors(&wrench, &rows.wrench);
        // Relative to the load, so that forces and moments have equal weight.
        let unexplained = |errors: &AxisErrors| Some(1.0 - errors.quality()?.r_squared?);
        Some(-errors.iter().filter_map(unexplained).sum::<f64>())
    };
    let now = explained(&rows.readings)?;
    let (channels, then) = best_exchange(&rows.readings, explained)?;
    let factor = (now / then).sqrt();
    (factor > WORSE).then_some((channels, factor))
}

/// Returns axes that drift from the first tenth to the last, with change and largest load, if both tenths are quiet.
fn drift(means: &[PerAxis<RunningVariance>], largest: &PerAxis<f64>) -> Vec<(Axis, f64, f64)> {
    let tenth = means.len() / 10;
    if tenth == 0 {
        return Vec::new();
    }
    let merged = |part: &[PerAxis<RunningVariance>], axis: usize| {
        let mut all = RunningVariance::default();
        part.iter().for_each(|step| all.merge(&step[axis]));
        all
    };
    let sd = |of: &RunningVariance| (of.squares / (of.count.max(2) - 1) as f64).sqrt();
    let ends = Axis::ALL.map(|axis| {
        let first = merged(&means[..tenth], axis.index());
        let last = merged(&means[means.len() - tenth..], axis.index());
        (axis, last.mean - first.mean, sd(&first).max(sd(&last)))
    });
    // A tenth in which the load changes does not show the zero.
    let is_quiet = ends.iter().all(|(axis, _, sd)| *sd <= DRIFT * largest[axis.index()]);
    if !is_quiet {
        return Vec::new();
    }
    let moved = ends.into_iter().filter(|(axis, moved, sd)| {
        moved.abs() > DRIFT * largest[axis.index()] && moved.abs() > DRIFT_SCATTER * sd
    });
    moved.map(|(axis, moved, _)| (axis, moved, largest[axis.index()])).collect()
}
