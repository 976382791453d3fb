//! The search for outliers among training rows: found, named, and left out where that is asked for.

use std::collections::BTreeSet;

use super::polynomial::{Problem, solve};
use crate::error::FitError;
use crate::model::{Basis, Model};
use crate::passes::{Rows, Workers, each};
use crate::quality::{self, AxisErrors, significant};
use crate::reading_ranges::ReadingRanges;
use crate::solver::{Solution, SolverKind};
use crate::validation::outliers::{Judge, Judged, LIMIT, LOOK_AT_ERROR, Spread};
use shell_data::block::Block;
use shell_data::dataset::{Dataset, LabelledBlock, RowSet};
use shell_data::wrench::{Axes, Axis, PerAxis};

/// Fits that are made before the search is given up.
const MOST_ROUNDS: usize = 12;

/// More rows than this share, and than so many, are no slips of single rows.
const LARGEST_SHARE: f64 = 0.01;
const MANY: usize = 50;

/// An error is far beyond those of so large a share of the rows if it is so many times as large.
const FAR_BEYOND: f64 = 2.5;

/// A column whose value is so many standard deviations from that of its neighbours is worth a word.
const FAR_FROM_NEIGHBOURS: f64 = 2.0;

/// A load of so many standard deviations is not possible.
const FAR_BEYOND_LOADS: f64 = 10.0;

/// What rows are judged by.
#[derive(Clone, Copy, Debug)]
pub struct OutlierTest<'a> {
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
    /// Who works on it.
    pub workers: Workers<'a>,
}

impl Default for OutlierTest<'_> {
    /// By the cubic model.
    fn default() -> Self {
        Self {
            basis: Basis::Cubic,
            intercept: true,
            ridge: 0.0,
            fresh: false,
            valid_range: None,
            workers: Workers::default(),
        }
    }
}

/// Why a row is an outlier.
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
        /// Whether such a load is possible; beyond all that were measured a model predicts nonsense.
        is_possible: bool,
    },
}

/// A suspicious row.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlier {
    /// The number of its log.
    pub log: usize,
    /// Its block.
    pub place: u64,
    /// The row of the block.
    pub row: usize,
    /// Why.
    pub reason: Reason,
    /// The columns that differ most from the rows before and after, most first; at least one.
    pub columns: Vec<OutlierColumn>,
}

/// A value and its neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutlierColumn {
    /// The channel, or after all channels the axis of the wrench.
    pub column: usize,
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
    /// The rows, in their order.
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
    pub fn excluded(&self) -> RowSet {
        self.rows.iter().map(|row| (row.log, row.place, row.row)).collect()
    }

    /// What is to be said of them. `names` say where each row is.
    pub fn warnings(&self, axes: Axes, names: &[RowName]) -> Vec<String> {
        /// More would hide what else is said.
        const SHOWN: usize = 10;
        let in_words = |(row, name): (&Outlier, &RowName)| {
            let RowName { file, line, columns } = name;
            format!("suspicious reading: `{file}` line {line}: {}", row.why(columns))
        };
        let rows = self.rows.iter().zip(names);
        let mut said: Vec<String> = rows.take(SHOWN).map(in_words).collect();
        said.extend(self.too_many.map(|rows| {
            format!(
                "{rows} rows stand out by an error or a reading, too many for slips of single rows: the \
                 model does not follow them, or columns are not what they are taken for (`shellcal info`)"
            )
        }));
        let errors = |[with, without]: &[PerAxis<f64>; 2]| {
            let of = |axis: Axis| {
                let [with, without] = [with, without].map(|rms| significant(rms[axis.index()], 3));
                format!("{} {with} → {without} {}", axis.name(), axis.unit())
            };
            axes.iter().map(of).collect::<Vec<_>>().join(", ")
        };
        let count = self.rows.len();
        let others =
            if count > SHOWN { format!(" ({SHOWN} of them listed above)") } else { String::new() };
        let worth = self.rms.as_ref().map_or_else(String::new, |rms| {
            format!("; RMS error on the other rows, with → without them: {}", errors(rms))
        });
        let s = if count == 1 { "" } else { "s" };
        said.extend((count > 0).then(|| format!("{count} suspicious row{s}{others}{worth}")));
        said
    }
}

/// Where a row is.
#[derive(Clone, Debug)]
pub struct RowName {
    /// Its file, or what else it comes from.
    pub file: String,
    /// Its line.
    pub line: u64,
    /// The names of the channels, then of all axes of the wrench.
    pub columns: Vec<String>,
}

impl Outlier {
    /// Which of a row's columns stand out, and by how much it is off. `names` are those of all columns.
    pub fn why(&self, names: &[String]) -> String {
        let columns = self.columns.iter().take(3).map(|column| {
            let beside: Vec<String> = [column.before, column.after]
                .into_iter()
                .flatten()
                .map(|x| x.to_string())
                .collect();
            let beside = match beside.len() {
                0 => String::new(),
                _ => format!(" (neighbours {})", beside.join(" and ")),
            };
            let name = names.get(column.column).map_or("", String::as_str);
            format!("`{name}` is {}{beside}", column.value)
        });
        let more = match self.columns.len().saturating_sub(3) {
            0 => String::new(),
            more => format!(" and {more} columns more"),
        };
        let why = match self.reason {
            Reason::OutOfRange => "outside the valid range".to_owned(),
            Reason::Error { axis, is_possible: false, .. } => {
                format!("{} cannot be predicted from such readings", axis.name())
            }
            Reason::Error { axis, size, error, .. } => format!(
                "{} is predicted {} {} off, {} standard deviations",
                axis.name(),
                significant(error, 3),
                axis.unit(),
                significant(size, 2)
            ),
        };
        format!("{}{more}; {why}", columns.collect::<Vec<_>>().join(", "))
    }
}

/// Looks for outliers in `data`.
///
/// # Errors
/// [`FitError`] if the other rows do not determine a calibration.
pub fn find_outliers(data: &Dataset, test: &OutlierTest<'_>) -> Result<Outliers, FitError> {
    let blocks: Vec<_> = data.blocks().collect();
    let search = Search { data, test, blocks: &blocks };
    let spread = search.spread()?;
    let out_of_range = match test.valid_range {
        None => Vec::new(),
        Some(range) => search.suspects(|_, block| outside(block, range))?,
    };
    let never: RowSet = keys(&out_of_range).collect();
    let everything = search.solve(&never)?;
    let (mut left_out, mut suspects, mut judge) = (BTreeSet::new(), Vec::new(), None);
    let most = MANY.max((LARGEST_SHARE * data.rows() as f64) as usize);
    let mut limit = LIMIT;
    for round in 0..MOST_ROUNDS {
        let excluded: RowSet = keys(&out_of_range).chain(left_out.iter().copied()).collect();
        let by = match round {
            0 => everything.judge(&spread),
            _ => search.solve(&excluded)?.judge(&spread),
        };
        let Some(by) = by else { return Ok(Outliers::default()) };
        let judged = search.suspects(|log, block| {
            let is_left_out = |row: usize| excluded.contains(log, block.place, row);
            by.judge(block, &spread, &is_left_out)
        })?;
        limit = limit_beyond(&judged, most);
        // All that stands out is left out first; then what belongs goes back.
        let is_left_out = |suspect: &&Suspect| match round {
            0 => suspect.judged.stands_out(),
            _ => suspect.judged.is_outlier(limit),
        };
        let next: BTreeSet<_> = keys(judged.iter().filter(is_left_out)).collect();
        if round > 0 && next.len() > most {
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
        .filter(|of| {
            of.judged.is_outlier(limit) && !never.contains(of.log, of.place, of.judged.row)
        })
        .collect();
    let excluded: RowSet = keys(&named).chain(keys(&out_of_range)).collect();
    let columns = (data.channels(), data.channels() * data.memory_terms());
    let name = |suspect: &Suspect, range| suspect.name(columns, &spread, range);
    let named = named.iter().filter_map(|suspect| name(suspect, None));
    let outside = out_of_range.iter().filter_map(|suspect| name(suspect, test.valid_range));
    let mut found = Outliers { rows: named.chain(outside).collect(), ..Outliers::default() };
    found.rows.sort_by_key(|row| (row.log, row.place, row.row));
    if let (Some(without), Some(with)) =
        (judge.filter(|_| !found.rows.is_empty()), everything.judge(&spread))
    {
        found.rms = search.rms(&excluded, [&with, &without])?;
    }
    Ok(found)
}

/// The size of errors that is far beyond those of all but so many rows.
fn limit_beyond(looked_at: &[Suspect], most: usize) -> f64 {
    let mut sizes: Vec<f64> = looked_at.iter().map(|of| of.judged.size).collect();
    let tail = match sizes.len() > most {
        true => *sizes.select_nth_unstable_by(most, |a, b| b.total_cmp(a)).1,
        // The rows that are not looked at have smaller errors.
        false => LOOK_AT_ERROR,
    };
    LIMIT.max(FAR_BEYOND * tail)
}

/// A fit that rows are judged by.
struct Judging {
    solution: Solution,
    ranges: ReadingRanges,
}

impl Judging {
    fn judge(&self, spread: &Spread) -> Option<Judge> {
        Judge::new(&self.solution, &self.ranges, spread)
    }
}

/// Rows that are searched.
struct Search<'a> {
    data: &'a Dataset,
    test: &'a OutlierTest<'a>,
    blocks: &'a [(usize, &'a LabelledBlock)],
}

impl Search<'_> {
    fn solve(&self, excluded: &RowSet) -> Result<Judging, FitError> {
        let used = self.data.select(self.test.fresh, excluded);
        let problem = Problem {
            model: Model {
                basis: self.test.basis,
                intercept: self.test.intercept,
                channels: self.data.channels(),
                memory: self.data.memory_terms(),
            },
            solver: SolverKind::Exact,
            ridge: self.test.ridge,
            truncate: None,
        };
        let sample = self.data.logs.first().map(|log| &log.sample);
        let solved = solve(&problem, None, &Rows::new(&used, self.test.workers), sample)?;
        Ok(Judging { solution: solved.solution, ranges: solved.ranges })
    }

    /// Passes all blocks to `work`, on any thread, and what comes of them to `fold`, in order.
    fn each_block<T: Send>(
        &self,
        work: impl Fn(usize, &Block) -> T + Sync,
        mut fold: impl FnMut(T) + Send,
    ) -> Result<(), FitError> {
        let work =
            |(): &mut (), (log, block): &(usize, &LabelledBlock)| Ok(work(*log, &block.rows));
        let fold = |value| {
            fold(value);
            Ok(())
        };
        each(self.blocks, |(_, block)| &block.rows, self.test.workers, || (), work, fold)?;
        Ok(())
    }

    /// The spread of readings and loads.
    fn spread(&self) -> Result<Spread, FitError> {
        let mut all = Spread::default();
        self.each_block(|_, block| Spread::of(block), |spread| all.merge(&spread))?;
        Ok(all)
    }

    /// The rows that `look` finds, with their neighbours.
    fn suspects(
        &self,
        look: impl Fn(usize, &Block) -> Vec<Judged> + Sync,
    ) -> Result<Vec<Suspect>, FitError> {
        let mut found = Vec::new();
        let work = |log: usize, block: &Block| -> Vec<Suspect> {
            let mut judged = look(log, block);
            if self.test.fresh {
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
        self.each_block(work, |suspects| found.extend(suspects))?;
        Ok(found)
    }

    /// Errors of two fits on the rows that both are to hold for.
    fn rms(
        &self,
        excluded: &RowSet,
        judges: [&Judge; 2],
    ) -> Result<Option<[PerAxis<f64>; 2]>, FitError> {
        let mut errors = [PerAxis::<AxisErrors>::default(); 2];
        let used = self.data.select(self.test.fresh, excluded);
        let blocks: Vec<_> = used.blocks().collect();
        let work = |_: usize, block: &Block| {
            judges.map(|judge| {
                let mut predicted = PerAxis::default();
                judge.calibration().wrench(&block.readings, &mut predicted);
                quality::errors(&predicted, &block.wrench)
            })
        };
        let used = Search { blocks: &blocks, ..*self };
        used.each_block(work, |of_block| {
            errors.iter_mut().zip(&of_block).for_each(|(all, block)| quality::merge(all, block));
        })?;
        let rms = errors.map(|axes| axes.map(|axis| axis.quality().map_or(0.0, |of| of.rms)));
        Ok((errors[0][0].rows() > 0).then_some(rms))
    }
}

fn keys<'a>(
    suspects: impl IntoIterator<Item = &'a Suspect>,
) -> impl Iterator<Item = (usize, u64, usize)> {
    suspects.into_iter().map(|of| (of.log, of.place, of.judged.row))
}

/// The rows of a block with a reading outside a range.
fn outside(block: &Block, [least, most]: [f64; 2]) -> Vec<Judged> {
    let is_outside =
        |row: &usize| block.readings.iter().any(|column| !(least..=most).contains(&column[*row]));
    (0..block.rows).filter(is_outside).map(Judged::unseen).collect()
}

impl Suspect {
    /// Names the row and what in it differs most from its neighbours; of a row `outside` a range, the readings that
    /// are outside.
    fn name(
        &self,
        (channels, terms): (usize, usize),
        spread: &Spread,
        outside: Option<[f64; 2]>,
    ) -> Option<Outlier> {
        let [before, Some(values), after] = &self.values else { return None };
        let beside =
            |column: usize| [before, after].map(|row| row.as_ref().map(|values| values[column]));
        // The nearer of both: at the edge of a contact one of them is far.
        let apart = |column: usize| {
            let known = beside(column).into_iter().flatten();
            let apart = known.map(|other| spread.apart(column, values[column], other));
            let nearest = apart.fold(f64::INFINITY, f64::min);
            (column, if nearest.is_finite() { nearest } else { 0.0 })
        };
        // Logs have no memory terms.
        let is_in_log = |column: &usize| !(channels..channels + terms).contains(column);
        let mut columns: Vec<(usize, f64)> =
            (0..values.len()).filter(is_in_log).map(apart).collect();
        if let Some([least, most]) = outside {
            columns.retain(|&(column, _)| {
                column < channels && !(least..=most).contains(&values[column])
            });
        }
        columns.sort_by(|a, b| b.1.total_cmp(&a.1));
        let far = columns.iter().filter(|(_, apart)| *apart > FAR_FROM_NEIGHBOURS).count();
        columns.truncate(far.max(1));
        let column = |&(column, _): &(usize, f64)| {
            let [before, after] = beside(column);
            let value = values[column];
            let column = if column < channels { column } else { column - terms };
            OutlierColumn { column, value, before, after }
        };
        let Judged { row, error, size, axis, .. } = self.judged;
        let axis = Axis::ALL[axis];
        Some(Outlier {
            log: self.log,
            place: self.place,
            row,
            reason: match outside {
                Some(_) => Reason::OutOfRange,
                None => {
                    let error = error[axis.index()];
                    let column = channels + axis.index();
                    let is_possible =
                        spread.apart(column, error + values[column], 0.0) < FAR_BEYOND_LOADS;
                    Reason::Error { axis, size, error, is_possible }
                }
            },
            columns: columns.iter().map(column).collect(),
        })
    }
}
