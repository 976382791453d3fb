//! Checks of a log.

use calibration::Calibration;
use calibration::quality::{self, AxisErrors};
use calibration::validation::excitation::LONGEST_LEVER_M;
use log_file::{Log, LogError, Meaning, ReadOptions, Wanted};
use shell_data::block::Block;
use shell_data::hint::with_causes;
use shell_data::statistics::RunningVariance;
use shell_data::wrench::{Axes, Axis, PerAxis};

use crate::Finding;
use crate::channels::{channel_name, check_channels, identical_in, outside, without_consequences};
use crate::finding::percent;
use crate::poses::{LabelledRows, PoseJump};
use calibration_file::CalibrationFile;
use log_file::summary::LogSummary;

/// Jitter, as a share of the interval, from which forces between frames are not where they seem.
const JITTER: f64 = 0.25;

/// A clock that runs back at more than this share of the rows is none: recordings that were put together do so
/// where each begins.
const NO_CLOCK: f64 = 0.1;

/// Missing rows that make a warning, and a fault.
const MISSING: [f64; 2] = [1e-3, 0.05];

/// Frames that a tare takes.
const TARE_FRAMES: u64 = 50;

/// How many times the error of the training data a log's error must be to look for the reason.
const WORSE: f64 = 3.0;

/// Rows in which swapped channels are looked for: conversion takes 28 times as long as usual.
const SWAP_ROWS: usize = 20_000;

/// The share of the training load that a drift of zero must exceed, and how many times the scatter.
const DRIFT: f64 = 0.02;
const DRIFT_SCATTER: f64 = 4.0;

/// What is known of a log.
#[derive(Clone, Debug, Default)]
pub struct LogObservations {
    /// Wrong rows, and what is wrong with the first.
    pub bad_rows: Option<(u64, String)>,
    /// The names of its channels.
    pub channel_names: Vec<String>,
    /// Whether it has time.
    pub has_time: bool,
    /// Whether it has the wrench of a reference.
    pub has_wrench: bool,
    /// Whether equal readings in a row are one frame.
    pub repeats_are_stale: bool,
    /// Timing and columns.
    pub summary: LogSummary,
    /// Frames that did not arrive, by the column `missing`.
    pub missing: Option<f64>,
    /// Poses of constant load in which the readings jump.
    pub jumps: Vec<PoseJump>,
    /// Channels that are the same in every row.
    pub identical: Vec<(usize, usize)>,
    /// Root mean square of the moments over that of the forces, m.
    pub lever_m: Option<f64>,
    /// What a calibration says of it.
    pub calibrated: Option<CalibratedObservations>,
}

/// What a calibration says of a log.
#[derive(Clone, Debug, Default)]
pub struct CalibratedObservations {
    /// How many channels it is for.
    pub channels: usize,
    /// Rows outside the range of its training data.
    pub rows_outside: u64,
    /// RMS error over that of the training data, the axis where that is largest, where the log has
    /// measured the wrench.
    pub worse: Option<(Axis, f64)>,
    /// Two channels after whose exchange the error is so many times smaller.
    pub swap: Option<(usize, usize, f64)>,
    /// How far the zero has moved from the first to the last tenth, where both are quiet, and the largest
    /// load of the training data: N and N·m.
    pub drift: Vec<(Axis, f64, f64)>,
}

/// Reads a log, if it could be opened, and checks it, with a calibration if there is one.
pub fn examine_log(
    log: Result<Log, LogError>,
    read: &ReadOptions<'_>,
    calibration: Option<&CalibrationFile>,
) -> Vec<Finding> {
    match log.and_then(|log| read_facts(&log, read, calibration)) {
        Ok(facts) => check_log(&facts, calibration.map(|file| &file.calibration)),
        Err(error) => {
            let advice = "name the columns, for example `--sensors 1-8 --wrench 9-14`; `--wrench-from` takes the \
                          wrench from another file; `docs/logs.md` has the formats that are read";
            vec![Finding::fault("unreadable", with_causes(&error), advice)]
        }
    }
}

fn read_facts(
    log: &Log,
    read: &ReadOptions<'_>,
    calibration: Option<&CalibrationFile>,
) -> Result<LogObservations, LogError> {
    let strict = ReadOptions { skip_bad_rows: false, ..*read };
    let first = match Collector::new(log, calibration).read(log, &strict) {
        Ok(facts) => return Ok(facts),
        Err(error) => with_causes(&error),
    };
    let lenient = ReadOptions { skip_bad_rows: true, ..*read };
    let mut facts = Collector::new(log, calibration).read(log, &lenient)?;
    let rows = facts.bad_rows.map_or(1, |(rows, _)| rows);
    facts.bad_rows = Some((rows, first));
    Ok(facts)
}

/// What is gathered from block to block.
struct Collector<'a> {
    facts: LogObservations,
    calibration: Option<&'a CalibrationFile>,
    /// The position of the column `missing`.
    missing: Option<usize>,
    /// Those of the log.
    axes: Axes,
    squares: [f64; 2],
    labelled: LabelledRows,
    identical: Option<Vec<(usize, usize)>>,
    errors: PerAxis<AxisErrors>,
    /// Rows for the search for swapped channels.
    kept: Block,
    /// Time and untared wrench in steps of [`STEP`] rows.
    means: Vec<PerAxis<RunningVariance>>,
}

/// Rows whose mean wrench is kept, to tell the ends of a log by.
const STEP: usize = 64;

impl<'a> Collector<'a> {
    fn new(log: &Log, calibration: Option<&'a CalibrationFile>) -> Self {
        let is_missing = |column: &log_file::Column| {
            column.name == "missing" && column.meaning == Meaning::Other
        };
        Self {
            facts: LogObservations {
                channel_names: log.value_names()[..log.channels()]
                    .iter()
                    .map(|name| (*name).to_owned())
                    .collect(),
                has_time: log.has_time(),
                has_wrench: log.has_wrench(),
                repeats_are_stale: log.repeats_are_stale(),
                ..LogObservations::default()
            },
            axes: log.axes(),
            calibration,
            missing: log.columns().iter().position(is_missing),
            squares: [0.0; 2],
            labelled: LabelledRows::default(),
            identical: None,
            errors: PerAxis::default(),
            kept: Block::default(),
            means: Vec::new(),
        }
    }

    fn read(mut self, log: &Log, options: &ReadOptions<'_>) -> Result<LogObservations, LogError> {
        let wanted = Wanted {
            time: log.has_time(),
            readings: log.channels() > 0,
            wrench: log.has_wrench(),
            groups: log.has_groups() && log.has_wrench(),
            others: self.missing.into_iter().collect(),
            ..Wanted::default()
        };
        let summary = log.read(&wanted, options, std::mem::take, |block| {
            self.add(&block);
            Ok::<_, LogError>(())
        })?;
        if summary.skipped_rows > 0 {
            self.facts.bad_rows = Some((summary.skipped_rows, String::new()));
        }
        Ok(self.finish(log.channels()))
    }

    fn add(&mut self, block: &Block) {
        self.facts.summary.add(block);
        self.labelled.add(block);
        if let [missing] = &block.others[..] {
            *self.facts.missing.get_or_insert(0.0) += missing.iter().sum::<f64>();
        }
        let same = identical_in(&block.readings, self.identical.take());
        self.identical = Some(same);
        for (axis, column) in block.wrench.iter().enumerate() {
            self.squares[axis / 3] += column.iter().map(|value| value * value).sum::<f64>();
        }
        let Some(file) = self.calibration else { return };
        if block.readings.len() != file.calibration.channels() {
            return;
        }
        let facts = self.facts.calibrated.get_or_insert_default();
        facts.rows_outside += file.calibration.rows_out_of_range(&block.readings);
        let mut wrench = PerAxis::default();
        file.calibration.wrench(&block.readings, &mut wrench);
        if !block.wrench.is_empty() {
            quality::merge(&mut self.errors, &quality::errors(&wrench, &block.wrench));
            self.keep(block);
        }
        for start in (0..block.rows).step_by(STEP) {
            let end = (start + STEP).min(block.rows);
            self.means.push(wrench.each_ref().map(|axis| RunningVariance::new(&axis[start..end])));
        }
    }

    fn keep(&mut self, block: &Block) {
        let rows = block.rows.min(SWAP_ROWS - self.kept.rows);
        for (kept, columns) in
            [(&mut self.kept.readings, &block.readings), (&mut self.kept.wrench, &block.wrench)]
        {
            kept.resize_with(columns.len(), Vec::new);
            kept.iter_mut().zip(columns).for_each(|(kept, column)| kept.extend(&column[..rows]));
        }
        self.kept.rows += rows;
    }

    fn finish(mut self, channels: usize) -> LogObservations {
        let constant = |channel: usize| self.facts.summary.readings[channel].is_constant();
        let pairs = self.identical.unwrap_or_default().into_iter();
        self.facts.identical = pairs.filter(|&(first, _)| !constant(first)).collect();
        self.facts.jumps = self.labelled.jumps();
        let [forces, moments] = self.squares;
        let is_known = forces > 0.0 && self.axes.are_all();
        self.facts.lever_m = is_known.then(|| (moments / forces).sqrt());
        let Some(file) = self.calibration else { return self.facts };
        let calibrated = self.facts.calibrated.get_or_insert_default();
        calibrated.channels = file.calibration.channels();
        if calibrated.channels != channels {
            return self.facts;
        }
        let trained = file.origin.diagnostics.as_ref().map(|known| known.train);
        if let (Some(trained), Some(found)) = (trained, quality_of(&self.errors)) {
            let ratio = |axis: Axis| found[axis.index()].rms / trained[axis.index()].rms;
            let axes = file.calibration.axes.and(self.axes);
            let ratios = axes.iter().map(|axis| (axis, ratio(axis)));
            let worst = ratios.max_by(|a, b| a.1.total_cmp(&b.1));
            calibrated.worse = worst.filter(|(_, ratio)| ratio.is_finite());
            if calibrated.worse.is_some_and(|(_, ratio)| ratio > WORSE) {
                calibrated.swap = find_swap(&file.calibration, &self.kept);
            }
        }
        let loads = file.origin.diagnostics.as_ref().and_then(|known| known.excitation.as_ref());
        if let Some(loads) = loads {
            calibrated.drift = drift(&self.means, &loads.largest_loads());
        }
        self.facts
    }
}

fn quality_of(errors: &PerAxis<AxisErrors>) -> Option<Vec<quality::AxisQuality>> {
    errors.iter().map(AxisErrors::quality).collect()
}

/// The exchange of two channels that makes the error smallest, if it does so by far.
fn find_swap(calibration: &Calibration, rows: &Block) -> Option<(usize, usize, f64)> {
    let error = |readings: &[Vec<f64>]| {
        let mut wrench = PerAxis::default();
        calibration.wrench(readings, &mut wrench);
        let errors = quality::errors(&wrench, &rows.wrench);
        // Relative to the load, so that forces and moments count alike.
        let unexplained = |errors: &AxisErrors| Some(1.0 - errors.quality()?.r_squared?);
        errors.iter().filter_map(unexplained).sum::<f64>()
    };
    let mut readings = rows.readings.clone();
    let now = error(&readings);
    let mut best = None;
    for first in 0..readings.len() {
        for second in first + 1..readings.len() {
            readings.swap(first, second);
            let then = error(&readings);
            readings.swap(first, second);
            if best.is_none_or(|(_, _, least)| then < least) {
                best = Some((first, second, then));
            }
        }
    }
    let (first, second, then) = best?;
    let factor = (now / then).sqrt();
    (factor > WORSE).then_some((first, second, factor))
}

/// How far the wrench has moved from the first tenth to the last, where both are quiet and nothing says
/// that it was loaded there.
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
    // A tenth in which any axis was loaded has no zero.
    let is_quiet = ends.iter().all(|(axis, _, sd)| *sd <= DRIFT * largest[axis.index()]);
    if !is_quiet {
        return Vec::new();
    }
    let moved = ends.into_iter().filter(|(axis, moved, sd)| {
        moved.abs() > DRIFT * largest[axis.index()] && moved.abs() > DRIFT_SCATTER * sd
    });
    moved.map(|(axis, moved, _)| (axis, moved, largest[axis.index()])).collect()
}

/// What is wrong with a log.
pub fn check_log(facts: &LogObservations, calibration: Option<&Calibration>) -> Vec<Finding> {
    if facts.summary.readings.is_empty() && facts.summary.wrench.is_empty() {
        let seen = "no column holds readings, and no six a wrench";
        let advice = "name them with `--sensors` or `--wrench`; `shellcal info` lists the columns";
        return vec![Finding::fault("no-values", seen, advice)];
    }
    let mut findings = Vec::new();
    if let Some((rows, first)) = &facts.bad_rows {
        findings.push(Finding::fault(
            "bad-rows",
            format!("{rows} wrong rows; the first: {first}"),
            "correct them, or leave them out with `--skip-bad-rows`",
        ));
    }
    findings.extend(check_length(facts));
    findings.extend(check_timing(facts));
    if let Some(lever_m) = facts.lever_m.filter(|&lever_m| lever_m > LONGEST_LEVER_M) {
        findings.push(Finding::fault(
            "moment-unit",
            format!("moments over forces make a lever of {lever_m:.1} m"),
            "the moments are in mN·m (which is N·mm), it seems: give `--moment-unit mnm`, or name the columns so",
        ));
    }
    let of_its_size =
        calibration.filter(|calibration| calibration.channels() == facts.summary.readings.len());
    let names = &facts.channel_names;
    findings.extend(check_channels(&facts.summary, names, &facts.identical, of_its_size));
    findings.extend(facts.jumps.iter().map(|jump| {
        let [before, after] = jump.means;
        Finding::warning(
            "pose-jump",
            format!(
                "in pose `{}` {} jumps from {before:.1} to {after:.1} after {} rows; its load is constant",
                jump.pose,
                channel_name(names, jump.channel),
                jump.rows_before
            ),
            "rows of another pose under this label, or the sensor slipped: take them out",
        )
    }));
    if let Some(calibrated) = &facts.calibrated {
        findings.extend(check_calibrated(calibrated, &facts.summary, names));
    }
    without_consequences(findings)
}

fn check_length(facts: &LogObservations) -> Option<Finding> {
    let summary = &facts.summary;
    let frames = summary.rows - if facts.repeats_are_stale { summary.repeated_rows } else { 0 };
    (frames < TARE_FRAMES && !summary.readings.is_empty()).then(|| {
        Finding::warning(
            "short",
            format!("{frames} frames"),
            format!("record longer: a tare alone takes {TARE_FRAMES}"),
        )
    })
}

fn check_timing(facts: &LogObservations) -> Vec<Finding> {
    let summary = &facts.summary;
    let timing = &summary.timing;
    if !facts.has_time {
        return vec![Finding::warning(
            "no-time",
            "there is no column of time",
            "name it with `--time` if there is one; without it `fit` finds no lag, `convert` needs `--rate` or \
             `--no-lowpass`, and losses cannot be seen",
        )];
    }
    if timing.backward_steps as f64 > NO_CLOCK * summary.rows as f64 {
        return vec![Finding::fault(
            "no-clock",
            format!(
                "what is taken for time runs backwards at {} of {} rows",
                timing.backward_steps, summary.rows
            ),
            "it holds no times: name the columns with `--sensors`, `--wrench` and `--time`; without a line of names \
             they are taken for what their number suggests",
        )];
    }
    let mut findings = Vec::new();
    if let Some(row) = timing.first_backward_row {
        let seen = format!(
            "time runs backwards {} times, first at row {}",
            timing.backward_steps,
            row + 1
        );
        // A fit takes recordings that were put together as groups.
        findings.push(match facts.has_wrench {
            true => Finding::warning(
                "time-backward",
                seen,
                "recordings that were put together, it seems: `fit` takes each as a group of its own; \
                 `convert` needs `--no-lowpass`",
            ),
            false => Finding::fault(
                "time-backward",
                seen,
                "recordings that were put together: take them apart; or a clock that was set",
            ),
        });
    }
    if timing.equal_times > summary.rows / 100 {
        findings.push(Finding::warning(
            "time-equal",
            format!(
                "{} of {} rows have the time of the row before",
                timing.equal_times, summary.rows
            ),
            "the clock is too coarse, or rows were written twice: take one with more digits",
        ));
    }
    findings.extend(check_losses(facts));
    if let (Some(interval), Some(jitter)) = (timing.median_interval_s(), timing.jitter_s())
        && jitter > JITTER * interval
    {
        findings.push(Finding::warning(
            "jitter",
            format!(
                "intervals of {:.3} ms scatter by {:.3} ms",
                interval * 1e3,
                jitter * 1e3
            ),
            "these are times of arrival, it seems: take the clock of the board, and set the adapter's \
             latency timer to 1 ms",
        ));
    }
    if facts.repeats_are_stale {
        return findings;
    }
    let share = summary.repeated_rows as f64 / summary.rows.max(1) as f64;
    let is_alive = summary.readings.iter().any(|column| !column.is_constant());
    if share > 0.5 && is_alive {
        findings.push(Finding::warning(
            "repeats",
            format!("{} of the rows repeat the readings of the row before", percent(share)),
            "the log runs faster than the sensor: thin it out, or record at the sensor's rate",
        ));
    }
    findings
}

/// Rows that are missing, by the log's own count where it has one, else by its clock.
fn check_losses(facts: &LogObservations) -> Option<Finding> {
    let rows = facts.summary.rows as f64;
    let gaps = facts.summary.timing.gaps();
    let missing = facts.missing.unwrap_or(gaps.missing_rows as f64);
    let share = missing / (rows + missing).max(1.0);
    let seen = format!("{missing} of {} frames are missing ({})", rows + missing, percent(share));
    let advice =
        "results hold the frame before for each; `shellcal doctor PORT` looks for the reason";
    let [some, most] = MISSING;
    Some(match share {
        _ if share > most => Finding::fault("losses", seen, advice),
        _ if share > some => Finding::warning("losses", seen, advice),
        _ => Finding::fine("losses", seen),
    })
}

fn check_calibrated(
    facts: &CalibratedObservations,
    summary: &LogSummary,
    names: &[String],
) -> Vec<Finding> {
    let channels = summary.readings.len();
    if channels != facts.channels {
        return vec![Finding::fault(
            "channels-other",
            format!("the log has {channels} channels, the calibration is for {}", facts.channels),
            "name the columns with `--sensors`, or take the calibration of this sensor",
        )];
    }
    let mut findings: Vec<Finding> =
        outside(facts.rows_outside, summary.rows).into_iter().collect();
    if let Some((first, second, factor)) = facts.swap {
        findings.push(Finding::fault(
            "channels-swapped",
            format!(
                "with {} and {} exchanged, the error is {factor:.1} times smaller",
                channel_name(names, first),
                channel_name(names, second)
            ),
            "exchange their wires, or name the columns in the order of the calibration with `--sensors`",
        ));
    } else if let Some((axis, ratio)) = facts.worse.filter(|(_, ratio)| *ratio > WORSE) {
        findings.push(Finding::fault(
            "error",
            format!("the error of {} is {ratio:.1} times that of the training data", axis.name()),
            "this is not the sensor that was calibrated, not as it was then, or beyond its range; \
             `shellcal fit --outliers report` names outliers",
        ));
    }
    for &(axis, moved, of) in &facts.drift {
        findings.push(Finding::warning(
            "drift",
            format!(
                "{} has moved by {moved:.3} {} from the first tenth to the last ({} of its range)",
                axis.name(),
                axis.unit(),
                percent(moved.abs() / of)
            ),
            "if nothing touched the shell then: let it warm up, tare more often, and keep light off it",
        ));
    }
    findings
}
