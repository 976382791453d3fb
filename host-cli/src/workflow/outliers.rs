//! Rows of training logs that do not belong: found, named, and left out where that is asked for.

use std::collections::BTreeSet;

use super::fit::{self, FitOptions};
use super::selection::{Excluded, UsedRows};
use super::{WorkflowError, check_logs};
use calibration::Basis;
use calibration::quality::{self, AxisErrors};
use calibration::reading_ranges::ReadingRanges;
use calibration::solver::Solution;
use calibration::validation::outliers::{Judge, Judged, Spread};
use log_file::{self, Log, ReadOptions, Wanted};
use shell_data::block::Block;
use shell_data::wrench::{Axis, PerAxis};

/// Fits that are made before the search is given up.
const MOST_ROUNDS: usize = 12;

/// More rows than this share, and than so many, are no slips of single rows.
const LARGEST_SHARE: f64 = 0.01;
const MANY: usize = 50;

/// A column whose value is so many standard deviations from that of its neighbours is worth a word.
const FAR_FROM_NEIGHBOURS: f64 = 2.0;

/// What is judged by.
#[derive(Clone, Copy)]
pub struct OutlierOptions<'a> {
    /// The family of features.
    pub basis: Basis,
    /// Whether there is a constant beside them.
    pub intercept: bool,
    /// λ of a ridge on columns of norm one.
    pub ridge: f64,
    /// Use only rows whose readings differ from those of the row before.
    pub fresh: bool,
    /// Readings outside are wrong whatever else they are.
    pub valid_range: Option<[f64; 2]>,
    /// How logs are read.
    pub read: ReadOptions<'a>,
}

impl Default for OutlierOptions<'_> {
    /// By the cubic model.
    fn default() -> Self {
        Self {
            basis: Basis::Cubic,
            intercept: true,
            ridge: 0.0,
            fresh: false,
            valid_range: None,
            read: ReadOptions::default(),
        }
    }
}

/// Why a row does not belong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reason {
    /// A reading is outside the valid range.
    OutOfRange,
    /// The error of an axis is so many times its standard deviation.
    Error {
        /// The axis.
        axis: Axis,
        /// How many times.
        size: f64,
        /// Predicted less measured, N or N·m.
        error: f64,
    },
}

/// A row that does not belong.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlier {
    /// The place of its log.
    pub log: usize,
    /// Its line in the file.
    pub line: u64,
    /// Why.
    pub reason: Reason,
    /// The columns that differ most from the rows beside it, most first; at least one.
    pub columns: Vec<OutlierColumn>,
    place: u64,
    row: usize,
}

/// A value and what stands beside it.
#[derive(Clone, Debug, PartialEq)]
pub struct OutlierColumn {
    /// The name of the column.
    pub name: String,
    /// Its value in the row, N and N·m for loads.
    pub value: f64,
    /// Its value in the row before.
    pub before: Option<f64>,
    /// Its value in the row after.
    pub after: Option<f64>,
}

/// What was found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outliers {
    /// The rows, in the order of the logs.
    pub rows: Vec<Outlier>,
    /// Rows that stand out where those are too many to be slips: none of them is named.
    pub too_many: Option<usize>,
    /// Root mean square errors on the other rows of the fit to all rows, and of that without these.
    pub rms: Option<[PerAxis<f64>; 2]>,
}

/// A row while it is looked at.
struct Suspect {
    log: usize,
    place: u64,
    judged: Judged,
    /// The row before, the row, and the row after.
    values: [Option<Vec<f64>>; 3],
}

impl Outliers {
    /// The rows, to be left out.
    pub fn excluded(&self) -> Excluded {
        self.rows.iter().map(|row| (row.log, row.place, row.row)).collect()
    }
}

/// Looks for rows of `train` that do not belong.
///
/// # Errors
/// [`WorkflowError`] if a log cannot be read or the other rows do not determine a calibration.
pub fn find(train: &[Log], options: &OutlierOptions<'_>) -> Result<Outliers, WorkflowError> {
    check_logs(train, &[], &wanted())?;
    let (spread, rows) = spread(train, options)?;
    let out_of_range = match options.valid_range {
        None => Vec::new(),
        Some(range) => pass(train, options, |_, block| outside(block, range))?,
    };
    let never: Excluded = key(&out_of_range).collect();
    let everything = options.solve(train, &never)?;
    let (mut left_out, mut suspects, mut judge) = (BTreeSet::new(), Vec::new(), None);
    for round in 0..MOST_ROUNDS {
        let excluded: Excluded = key(&out_of_range).chain(left_out.iter().copied()).collect();
        let by = match round {
            0 => everything.judge(&spread),
            _ => options.solve(train, &excluded)?.judge(&spread),
        };
        let Some(by) = by else { return Ok(Outliers::default()) };
        let judged = pass(train, options, |log, block| {
            let is_left_out = |row: usize| excluded.contains(log, block.place, row);
            by.judge(block, &spread, &is_left_out)
        })?;
        // All that stands out is left out first; then what belongs goes back.
        let is_left_out = |suspect: &&Suspect| match round {
            0 => suspect.judged.stands_out(),
            _ => suspect.judged.is_outlier(),
        };
        let next: BTreeSet<_> = key(judged.iter().filter(is_left_out)).collect();
        if round > 0 && next.len() > MANY.max((LARGEST_SHARE * rows as f64) as usize) {
            return Ok(Outliers { too_many: Some(next.len()), ..Outliers::default() });
        }
        let is_same = next == left_out;
        (left_out, suspects, judge) = (next, judged, Some(by));
        if is_same {
            break;
        }
    }
    let named: Vec<Suspect> = suspects
        .into_iter()
        .filter(|of| of.judged.is_outlier() && !never.contains(of.log, of.place, of.judged.row))
        .collect();
    let excluded: Excluded = key(&named).chain(key(&out_of_range)).collect();
    let mut found = Outliers::default();
    for (suspects, is_outside) in [(named, false), (out_of_range, true)] {
        for suspect in suspects {
            found.rows.push(suspect.name(train, &spread, is_outside, options)?);
        }
    }
    found.rows.sort_by_key(|row| (row.log, row.line));
    if let (Some(without), Some(with)) =
        (judge.filter(|_| !found.rows.is_empty()), everything.judge(&spread))
    {
        found.rms = rms(train, options, &excluded, [&with, &without])?;
    }
    Ok(found)
}

/// A fit that rows are judged by.
struct Solved {
    solution: Solution,
    ranges: ReadingRanges,
}

impl Solved {
    fn judge(&self, spread: &Spread) -> Option<Judge> {
        Judge::new(&self.solution, &self.ranges, spread)
    }
}

impl OutlierOptions<'_> {
    fn solve(&self, train: &[Log], excluded: &Excluded) -> Result<Solved, WorkflowError> {
        let options = FitOptions {
            basis: self.basis,
            intercept: self.intercept,
            ridge: self.ridge,
            used: UsedRows { fresh: self.fresh, excluded: Some(excluded) },
            read: self.quiet(),
            ..FitOptions::default()
        };
        let (solution, ranges) = fit::solution(train, &options)?;
        Ok(Solved { solution, ranges })
    }

    /// Passes over all rows: their blocks to `map`, on any thread, and what comes of them to `fold`, in
    /// order.
    fn each_block<T: Send>(
        &self,
        train: &[Log],
        map: impl Fn(usize, &mut Block) -> T + Sync,
        mut fold: impl FnMut(T),
    ) -> Result<(), WorkflowError> {
        let logs: Vec<&Log> = train.iter().collect();
        let map = |(): &mut (), log: usize, block: &mut Block| map(log, block);
        let fold = |_: usize, of_block: T| {
            fold(of_block);
            Ok::<_, WorkflowError>(())
        };
        log_file::read_all(&logs, &wanted(), &self.quiet(), || (), map, fold)?;
        Ok(())
    }

    /// How logs are read: what a fit says of them, it says itself.
    fn quiet(&self) -> ReadOptions<'_> {
        ReadOptions { checksum: false, progress: None, ..self.read }
    }
}

fn wanted() -> Wanted {
    Wanted { readings: true, wrench: true, ..Wanted::default() }
}

fn key<'a>(
    suspects: impl IntoIterator<Item = &'a Suspect>,
) -> impl Iterator<Item = (usize, u64, usize)> {
    suspects.into_iter().map(|of| (of.log, of.place, of.judged.row))
}

/// The spread of readings and loads, and the number of rows.
fn spread(train: &[Log], options: &OutlierOptions<'_>) -> Result<(Spread, u64), WorkflowError> {
    let (mut all, mut rows) = (Spread::default(), 0);
    let map = |_: usize, block: &mut Block| (Spread::of(block, 1), block.rows as u64);
    options.each_block(train, map, |(spread, of_block)| {
        all.merge(&spread);
        rows += of_block;
    })?;
    Ok((all, rows))
}

/// Passes over all rows and gathers those that `look` finds, with the rows beside them.
fn pass(
    train: &[Log],
    options: &OutlierOptions<'_>,
    look: impl Fn(usize, &Block) -> Vec<Judged> + Sync,
) -> Result<Vec<Suspect>, WorkflowError> {
    let mut found = Vec::new();
    let map = |log: usize, block: &mut Block| -> Vec<Suspect> {
        let mut judged = look(log, block);
        if options.fresh {
            let fresh = block.fresh_rows();
            judged.retain(|of| fresh[of.row]);
        }
        let values = |row: usize| -> Option<Vec<f64>> {
            let columns = block.readings.iter().chain(&block.wrench);
            (row < block.rows).then(|| columns.map(|column| column[row]).collect())
        };
        let suspect = |judged: Judged| Suspect {
            log,
            place: block.place,
            values: [
                judged.row.checked_sub(1).and_then(values),
                values(judged.row),
                values(judged.row + 1),
            ],
            judged,
        };
        judged.into_iter().map(suspect).collect()
    };
    options.each_block(train, map, |suspects| found.extend(suspects))?;
    Ok(found)
}

/// The rows of a block with a reading outside a range.
fn outside(block: &Block, [least, most]: [f64; 2]) -> Vec<Judged> {
    let is_outside =
        |row: &usize| block.readings.iter().any(|column| !(least..=most).contains(&column[*row]));
    (0..block.rows).filter(is_outside).map(Judged::unseen).collect()
}

/// Errors of two fits on the rows that both are to hold for.
fn rms(
    train: &[Log],
    options: &OutlierOptions<'_>,
    excluded: &Excluded,
    judges: [&Judge; 2],
) -> Result<Option<[PerAxis<f64>; 2]>, WorkflowError> {
    let mut errors = [PerAxis::<AxisErrors>::default(); 2];
    let used = UsedRows { fresh: options.fresh, excluded: Some(excluded) };
    let map = |log: usize, block: &mut Block| {
        used.select(log, block);
        judges.map(|judge| {
            let mut predicted = PerAxis::default();
            judge.calibration().wrench(&block.readings, &mut predicted);
            quality::errors(&predicted, &block.wrench)
        })
    };
    options.each_block(train, map, |of_block| {
        errors.iter_mut().zip(&of_block).for_each(|(all, block)| quality::merge(all, block));
    })?;
    let rms = errors.map(|axes| axes.map(|axis| axis.quality().map_or(0.0, |of| of.rms)));
    Ok((errors[0][0].rows() > 0).then_some(rms))
}

impl Suspect {
    /// Names the row and what in it differs most from the rows beside it.
    fn name(
        &self,
        train: &[Log],
        spread: &Spread,
        is_outside: bool,
        options: &OutlierOptions<'_>,
    ) -> Result<Outlier, WorkflowError> {
        let log = &train[self.log];
        let [before, Some(values), after] = &self.values else {
            return Err(WorkflowError::Changed { path: log.path().to_path_buf() });
        };
        let beside =
            |column: usize| [before, after].map(|row| row.as_ref().map(|values| values[column]));
        // The nearer of both: at the edge of a contact one of them is far.
        let apart = |column: usize| {
            let known = beside(column).into_iter().flatten();
            let apart = known.map(|other| spread.apart(column, values[column], other));
            apart.fold(f64::INFINITY, f64::min)
        };
        let mut columns: Vec<(usize, f64)> = (0..values.len())
            .map(|column| (column, apart(column)))
            .map(|(column, apart)| (column, if apart.is_finite() { apart } else { 0.0 }))
            .collect();
        if is_outside && let Some([least, most]) = options.valid_range {
            let channels = log.channels();
            columns.retain(|&(column, _)| {
                column < channels && !(least..=most).contains(&values[column])
            });
        }
        columns.sort_by(|a, b| b.1.total_cmp(&a.1));
        let far = columns.iter().filter(|(_, apart)| *apart > FAR_FROM_NEIGHBOURS).count();
        columns.truncate(far.max(1));
        let names = log.value_names();
        let column = |&(column, _): &(usize, f64)| {
            let [before, after] = beside(column);
            OutlierColumn { name: names[column].to_owned(), value: values[column], before, after }
        };
        let Judged { row, error, size, axis, .. } = self.judged;
        let axis = Axis::ALL[axis];
        Ok(Outlier {
            log: self.log,
            line: log.line_of_row(&wanted(), self.place, row)?,
            reason: match is_outside {
                true => Reason::OutOfRange,
                false => Reason::Error { axis, size, error: error[axis.index()] },
            },
            columns: columns.iter().map(column).collect(),
            place: self.place,
            row,
        })
    }
}
