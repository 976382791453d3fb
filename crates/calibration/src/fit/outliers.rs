//! The search for outliers among training rows: found, named, and left out where that is asked for.

use std::collections::BTreeSet;
use std::ops::Range;

use super::polynomial::{PolynomialProblem, Solved, solve};
use crate::error::FitError;
use crate::exact::{Accumulator, Moments};
use crate::factor::InverseFactor;
use crate::model::{Basis, Model};
use crate::passes::{Rows, Workers, each, map};
use crate::quality::significant;
use crate::reading_ranges::ReadingRanges;
use crate::solver::{Solution, SolverKind, solve_moments};
use crate::validation::outliers::{LIMIT, LOOK_AT_ERROR, RowTest, Spread, TestedRow, far_readings};
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

/// What rows are tested by.
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

/// A row of one of the blocks that are searched, while it is looked at.
struct Suspect {
    block: usize,
    tested: TestedRow,
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
    search(data, test, None)
}

/// A fit to all rows, and the rows of each block that are to be tested by it.
pub(super) struct KnownFit {
    fit: Judging,
    suspects: Vec<Vec<usize>>,
}

impl KnownFit {
    pub(super) fn new(solved: &Solved, suspects: Vec<Vec<usize>>) -> Self {
        Self { fit: Judging::new(solved), suspects }
    }
}

/// As [`find_outliers`], where the fit to all rows may be `known`.
pub(super) fn search(
    data: &Dataset,
    test: &OutlierTest<'_>,
    known: Option<KnownFit>,
) -> Result<Outliers, FitError> {
    let mut search = OutlierSearch::new(data, test);
    let out_of_range = match test.valid_range {
        None => Vec::new(),
        Some(range) => search.rows_outside(range)?,
    };
    let never: RowKeys = out_of_range.iter().map(|of| search.key(of)).collect();
    let spread = search.spread()?;
    let known =
        known.filter(|known| known.suspects.len() == search.blocks.len() && never.is_empty());
    let mut looked_by = None;
    let all = match known {
        Some(KnownFit { fit, suspects }) => {
            looked_by = fit.row_test(&spread).map(|test| *test.noise());
            search.suspect(suspects);
            search.look(|block| far_readings(block, &spread))?;
            fit
        }
        None => search.solve(never.iter().copied())?,
    };
    let (mut left_out, mut suspects, mut fit) = (RowKeys::new(), Vec::new(), all.clone());
    let mut tried = BTreeSet::from([left_out.clone()]);
    let most = MANY.max((LARGEST_SHARE * data.rows() as f64) as usize);
    for round in 0..MOST_ROUNDS {
        fit = search.solve_without(&all, &left_out, &never)?;
        let Some(test) = fit.row_test(&spread) else { return Ok(Outliers::default()) };
        if looked_by.is_none_or(|noise| test.is_sharper(&noise)) {
            search.look(|block| test.suspects(block, &test.predict(block), &spread))?;
            looked_by = Some(*test.noise());
        }
        let excluded: RowSet = never.iter().chain(&left_out).copied().collect();
        suspects = search.test(&test, &spread, &excluded)?;
        let limit = limit_beyond(&suspects, most);
        // All that stands out is left out first; then what belongs goes back.
        suspects.retain(|of| match round {
            0 => of.tested.stands_out(),
            _ => of.tested.is_outlier(limit),
        });
        suspects.retain(|of| !never.contains(&search.key(of)));
        if round > 0 && suspects.len() > most {
            return Ok(Outliers { too_many: Some(suspects.len()), ..Outliers::default() });
        }
        left_out = suspects.iter().map(|of| search.key(of)).collect();
        // Some rows may come and go.
        if !tried.insert(left_out.clone()) {
            break;
        }
    }
    let named = suspects.iter().filter_map(|suspect| search.name(suspect, &spread, None));
    let outside = out_of_range.iter();
    let outside = outside.filter_map(|of| search.name(of, &spread, test.valid_range));
    let mut rows: Vec<Outlier> = named.chain(outside).collect();
    rows.sort_by_key(|row| (row.log, row.place, row.row));
    let rms = (!rows.is_empty()).then(|| search.rms([&all, &fit], &left_out, &spread)).flatten();
    Ok(Outliers { rows, too_many: None, rms })
}

/// The size of errors that is far beyond those of all but so many rows.
fn limit_beyond(looked_at: &[Suspect], most: usize) -> f64 {
    let mut sizes: Vec<f64> = looked_at.iter().map(|of| of.tested.size).collect();
    let tail = match sizes.len() > most {
        true => *sizes.select_nth_unstable_by(most, |a, b| b.total_cmp(a)).1,
        // The rows that are not looked at have smaller errors.
        false => LOOK_AT_ERROR,
    };
    LIMIT.max(FAR_BEYOND * tail)
}

/// A fit that rows are tested by.
#[derive(Clone)]
struct Judging {
    solution: Solution,
    ranges: ReadingRanges,
    /// The exact sums that it is the solution of, if it is.
    sums: Option<Moments>,
}

impl Judging {
    fn new(solved: &Solved) -> Self {
        let Solved { solution, ranges, sums, .. } = solved.clone();
        let factor = InverseFactor::Known(solution.factor.matrix().into_owned());
        Self { solution: Solution { factor, ..solution }, ranges, sums }
    }

    fn row_test(&self, spread: &Spread) -> Option<RowTest> {
        RowTest::new(&self.solution, &self.ranges, spread)
    }

    /// The fit without some of its rows, from what is known of all; `None` if that takes the other rows.
    fn without(&self, rows: &Block, model: &Model, ridge: f64) -> Result<Option<Self>, FitError> {
        /// More are better taken out of sums, or left out of a pass: what is kept of each is as long as the features.
        const MOST_TAKEN_OUT: usize = 4096;
        let few = rows.rows <= MOST_TAKEN_OUT;
        let solution = match (few.then(|| self.solution.without(rows)).flatten(), &self.sums) {
            (None, Some(sums)) => {
                let mut part = Accumulator::new(sums.basis(), sums.channels());
                part.absorb(&rows.readings, &rows.wrench)?;
                let rest = sums.without(&part.finish()?);
                Some(solve_moments(&rest, model, ridge, &self.ranges)?)
            }
            (solution, _) => solution,
        };
        Ok(solution.map(|solution| Self { solution, ranges: self.ranges.clone(), sums: None }))
    }
}

/// A block of rows, and which of them are to be tested, ascending, with their leverages.
struct SearchedBlock<'a> {
    log: usize,
    rows: &'a Block,
    suspects: Vec<(usize, f64)>,
}

/// Rows that are searched.
struct OutlierSearch<'a> {
    data: &'a Dataset,
    test: &'a OutlierTest<'a>,
    blocks: Vec<SearchedBlock<'a>>,
}

impl<'a> OutlierSearch<'a> {
    fn new(data: &'a Dataset, test: &'a OutlierTest<'a>) -> Self {
        let of = |(log, block): (usize, &'a LabelledBlock)| SearchedBlock {
            log,
            rows: &block.rows,
            suspects: Vec::new(),
        };
        Self { data, test, blocks: data.blocks().map(of).collect() }
    }

    fn model(&self) -> Model {
        Model {
            basis: self.test.basis,
            intercept: self.test.intercept,
            channels: self.data.channels(),
            memory: self.data.memory_terms(),
        }
    }

    fn solve(&self, excluded: impl Iterator<Item = RowKey>) -> Result<Judging, FitError> {
        let used = self.data.select(self.test.fresh, &excluded.collect());
        let problem = PolynomialProblem {
            model: self.model(),
            solver: SolverKind::Exact,
            ridge: self.test.ridge,
            truncate: None,
        };
        let sample = self.data.logs.first().map(|log| &log.sample);
        Ok(Judging::new(&solve(&problem, None, &Rows::new(&used, self.test.workers), sample)?))
    }

    /// The fit `all` without some of its rows, `left_out`; it was made without those of `never`.
    fn solve_without(
        &self,
        all: &Judging,
        left_out: &RowKeys,
        never: &RowKeys,
    ) -> Result<Judging, FitError> {
        if left_out.is_empty() {
            return Ok(all.clone());
        }
        let rows = gather(&self.blocks, |row| left_out.contains(row));
        match all.without(&rows, &self.model(), self.test.ridge)? {
            Some(fit) => Ok(fit),
            None => self.solve(never.iter().chain(left_out).copied()),
        }
    }

    /// Where a row is.
    fn key(&self, suspect: &Suspect) -> RowKey {
        let SearchedBlock { log, rows, .. } = &self.blocks[suspect.block];
        (*log, rows.place, suspect.tested.row)
    }

    /// Passes all blocks to `work`, on any thread, and what comes of them to `fold`, in order.
    fn each_block<S: Default + Send, T: Send>(
        &self,
        work: impl Fn(&mut S, &SearchedBlock<'_>) -> T + Sync,
        mut fold: impl FnMut(T) + Send,
    ) -> Result<(), FitError> {
        let fold = |value| {
            fold(value);
            Ok(())
        };
        let work = |state: &mut S, block: &SearchedBlock<'_>| Ok(work(state, block));
        each(&self.blocks, |block| block.rows, self.test.workers, S::default, work, fold)?;
        Ok(())
    }

    /// The spread of readings and loads.
    fn spread(&self) -> Result<Spread, FitError> {
        let mut all = Spread::default();
        self.each_block(|(), block| Spread::new(block.rows), |spread| all.merge(&spread))?;
        Ok(all)
    }

    /// Also tests the rows of each block that `find` finds.
    fn look(&mut self, find: impl Fn(&Block) -> Vec<usize> + Sync) -> Result<(), FitError> {
        let mut found = Vec::new();
        self.each_block(|(), block| find(block.rows), |rows| found.push(rows))?;
        self.suspect(found);
        Ok(())
    }

    /// Also tests some rows of each block.
    fn suspect(&mut self, found: Vec<Vec<usize>>) {
        for (block, mut rows) in self.blocks.iter_mut().zip(found) {
            if self.test.fresh {
                let fresh = block.rows.fresh_rows();
                rows.retain(|&row| fresh[row]);
            }
            block.suspects.extend(rows.into_iter().map(|row| (row, 0.0)));
            block.suspects.sort_unstable_by_key(|&(row, _)| row);
            block.suspects.dedup_by_key(|&mut (row, _)| row);
        }
    }

    /// Tests the rows that are to be.
    fn test(
        &mut self,
        test: &RowTest,
        spread: &Spread,
        excluded: &RowSet,
    ) -> Result<Vec<Suspect>, FitError> {
        self.find_leverages(test)?;
        self.suspects(|predicted, SearchedBlock { log, rows, suspects }| {
            let is_left_out = |row: usize| excluded.contains(*log, rows.place, row);
            test.test(rows, suspects, (spread, predicted), &is_left_out)
        })
    }

    /// The leverages of the rows that are tested, of many blocks together.
    fn find_leverages(&mut self, test: &RowTest) -> Result<(), FitError> {
        const TOGETHER: usize = 256;
        let (mut parts, mut rows) = (Vec::<Range<usize>>::new(), 0);
        for (place, block) in self.blocks.iter().enumerate() {
            match parts.last_mut().filter(|_| rows < TOGETHER) {
                Some(part) => part.end = place + 1,
                None => {
                    parts.push(place..place + 1);
                    rows = 0;
                }
            }
            rows += block.suspects.len();
        }
        let leverages = map(&parts, TOGETHER, self.test.workers, |part| {
            Ok(test.leverages(&gather(&self.blocks[part.clone()], |_| true).readings))
        })?;
        let rows = self.blocks.iter_mut().flat_map(|block| &mut block.suspects);
        rows.zip(leverages.concat()).for_each(|(suspect, leverage)| suspect.1 = leverage);
        Ok(())
    }

    /// The rows with a reading outside a range.
    fn rows_outside(&self, range: [f64; 2]) -> Result<Vec<Suspect>, FitError> {
        self.suspects(|_, block| {
            let mut outside = outside(block.rows, range);
            if self.test.fresh {
                let fresh = block.rows.fresh_rows();
                outside.retain(|of| fresh[of.row]);
            }
            outside
        })
    }

    fn suspects(
        &self,
        test: impl Fn(&mut PerAxis<Vec<f64>>, &SearchedBlock<'_>) -> Vec<TestedRow> + Sync,
    ) -> Result<Vec<Suspect>, FitError> {
        let mut found = Vec::new();
        self.each_block(test, |tested| found.push(tested))?;
        let of_block = |(block, tested): (usize, Vec<TestedRow>)| {
            tested.into_iter().map(move |tested| Suspect { block, tested })
        };
        Ok(found.into_iter().enumerate().flat_map(of_block).collect())
    }

    /// Errors of the fit to all rows, and of that without those `left_out`, on the rows that both are to hold for.
    ///
    /// Those of the first are what is left of the sum of its squared errors without those of the rows left out. That
    /// loses few digits: a row that errs by far more than all others bends the fit, and they err, too.
    fn rms(
        &self,
        [all, without]: [&Judging; 2],
        left_out: &RowKeys,
        spread: &Spread,
    ) -> Option<[PerAxis<f64>; 2]> {
        let left_out = gather(&self.blocks, |row| left_out.contains(row));
        let predicted = all.row_test(spread)?.predict(&left_out);
        let rms = |of: &Judging, axis: usize, (rows, square): (usize, f64)| {
            let Solution { residual_products, rows: all, .. } = &of.solution;
            let rest = (residual_products[(axis, axis)] - square).max(0.0);
            (rest / (all - rows as u64) as f64).sqrt()
        };
        let square = |axis: usize| {
            let pairs = predicted[axis].iter().zip(&left_out.wrench[axis]);
            pairs.map(|(predicted, measured)| (predicted - measured).powi(2)).sum()
        };
        Some([
            std::array::from_fn(|axis| rms(all, axis, (left_out.rows, square(axis)))),
            std::array::from_fn(|axis| rms(without, axis, (0, 0.0))),
        ])
    }

    /// Names a row and what in it differs most from its neighbours; of a row `outside` a range, the readings that
    /// are outside.
    fn name(
        &self,
        suspect: &Suspect,
        spread: &Spread,
        outside: Option<[f64; 2]>,
    ) -> Option<Outlier> {
        let SearchedBlock { log, rows, .. } = &self.blocks[suspect.block];
        let (channels, terms) = (self.data.channels(), rows.memory_columns);
        let TestedRow { row, error, size, axis, .. } = suspect.tested;
        let values = |row: usize| -> Option<Vec<f64>> {
            let columns = rows.readings.iter().chain(&rows.wrench);
            (row < rows.rows).then(|| columns.map(|column| column[row]).collect())
        };
        let (before, values, after) =
            (row.checked_sub(1).and_then(values), values(row)?, values(row + 1));
        let beside =
            |column: usize| [&before, &after].map(|row| row.as_ref().map(|values| values[column]));
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
        let reason = match outside {
            Some(_) => Reason::OutOfRange,
            None => {
                let (error, column) = (error[axis], channels + terms + axis);
                let is_possible =
                    spread.apart(column, error + values[column], 0.0) < FAR_BEYOND_LOADS;
                Reason::Error { axis: Axis::ALL[axis], size, error, is_possible }
            }
        };
        let columns = columns.iter().map(column).collect();
        Some(Outlier { log: *log, place: rows.place, row, reason, columns })
    }
}

/// A row by log, block and row of the block.
type RowKey = (usize, u64, usize);

/// Rows in their order.
type RowKeys = BTreeSet<RowKey>;

/// Some of the rows that are tested.
fn gather(blocks: &[SearchedBlock<'_>], is_meant: impl Fn(&RowKey) -> bool) -> Block {
    let mut gathered = Block::default();
    for SearchedBlock { log, rows, suspects } in blocks {
        let meant = suspects.iter().filter(|(row, _)| is_meant(&(*log, rows.place, *row)));
        meant.for_each(|&(row, _)| gathered.append(rows, row..row + 1));
    }
    gathered
}

/// The rows of a block with a reading outside a range.
fn outside(block: &Block, [least, most]: [f64; 2]) -> Vec<TestedRow> {
    let is_outside =
        |row: &usize| block.readings.iter().any(|column| !(least..=most).contains(&column[*row]));
    (0..block.rows).filter(is_outside).map(TestedRow::unseen).collect()
}
