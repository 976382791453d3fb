use std::borrow::Cow;
use std::collections::BTreeSet;

use super::options::FitOptions;
use super::outliers::{Outlier, OutlierColumn, Outliers, Reason};
use super::refits::{PolynomialProblem, Solved, solve};
use crate::validation::outliers::{LIMIT, RowTest, Spread, TestedRow};
use least_squares::error::FitError;
use least_squares::exact::Accumulator;
use least_squares::model::{Basis, Model};
use least_squares::passes::{Rows, each, map};
use least_squares::solver::{Solution, SolverKind};
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axis, PerAxis};

const MOST_ROUNDS: usize = 12;

/// Most rows that can be slips: this share of all rows, but at least the second number.
const LARGEST_SHARE: f64 = 0.01;
const MANY: usize = 50;

/// An outlier's error exceeds this many times the largest error among all but `LARGEST_SHARE` of the rows.
const FAR_BEYOND: f64 = 2.5;

/// Distance from the nearer neighbour, in standard deviations, above which a warning names the
/// column.
const FAR_FROM_NEIGHBOURS: f64 = 2.0;

/// Minimum size of an impossible load, in standard deviations.
const FAR_BEYOND_LOADS: f64 = 10.0;

type Suspect = (usize, TestedRow);
/// A row, by the position of its block and its position in the block.
type RowKey = (usize, usize);
type RowKeys = BTreeSet<RowKey>;

fn key((block, tested): &Suspect) -> RowKey {
    (*block, tested.row)
}

/// Searches for outliers with the family of features in `options`, or else the cubic model.
///
/// # Errors
/// [`FitError`] if the other rows do not determine a calibration.
pub fn find_outliers(data: &Dataset, options: &FitOptions<'_>) -> Result<Outliers, FitError> {
    search(data, options, None)
}

pub(super) struct KnownFit<'a> {
    pub(super) fit: &'a Solved,
    pub(super) spread: Spread,
    pub(super) tested: Vec<Vec<TestedRow>>,
}

/// Searches for outliers among the used rows. Starts from the fit to all rows if it is `known`.
pub(super) fn name_outliers(
    train: &Dataset,
    known: Option<KnownFit<'_>>,
    options: &FitOptions<'_>,
) -> Result<Outliers, FitError> {
    let mut found = search(train, options, known)?;
    // Rows outside the valid range have been left out.
    found.rows.retain(|row| row.reason != Reason::OutOfRange);
    Ok(found)
}

/// Like [`find_outliers`], but starts from the fit to all rows if it is `known`.
fn search(
    data: &Dataset,
    options: &FitOptions<'_>,
    known: Option<KnownFit<'_>>,
) -> Result<Outliers, FitError> {
    let (known, spread) = match known {
        Some(KnownFit { fit, spread, tested }) => (Some((fit, tested)), spread),
        None => (None, Spread::new(data, options.workers)?),
    };
    let blocks: Vec<_> = data.blocks().map(|(log, block)| (log, &*block.rows)).collect();
    let suspects = vec![Vec::new(); blocks.len()];
    let mut search =
        OutlierSearch { data, options, blocks, suspects, spread: &spread, looked_by: None };
    let never = search.rows_out_of_range();
    let mut known_tests = None;
    let all = &match known {
        Some((fit, tested)) => {
            known_tests = Some(search.start_from(fit, tested));
            Cow::Borrowed(fit)
        }
        None => Cow::Owned(search.solve(&never)?),
    };
    let (mut left_out, mut suspects) = (RowKeys::new(), Vec::new());
    let mut fit = Cow::Borrowed(&all.solution);
    let mut tried = BTreeSet::from([left_out.clone()]);
    let most = MANY.max((LARGEST_SHARE * data.rows() as f64) as usize);
    for round in 0..MOST_ROUNDS {
        let excluded = &never | &left_out;
        if !left_out.is_empty() {
            fit = Cow::Owned(match search.without(all, &left_out)? {
                Some(fit) => fit,
                None => search.solve(&excluded)?.solution,
            });
        }
        let Some(test) = RowTest::new(&fit, &spread) else { return Ok(Outliers::default()) };
        let limit;
        (suspects, limit) = match known_tests.take() {
            Some(tested) => (tested, LIMIT),
            None => search.test(&test, &excluded, most)?,
        };
        // The first round leaves out all rows that stand out; later rounds return the good ones.
        suspects.retain(|suspect @ (_, tested)| match round {
            _ if never.contains(&key(suspect)) => false,
            0 => tested.stands_out(),
            _ => tested.is_outlier(limit),
        });
        if round > 0 && suspects.len() > most {
            return Ok(Outliers { too_many: Some(suspects.len()), ..Outliers::default() });
        }
        left_out = suspects.iter().map(key).collect();
        // If rows alternated between in and out, the search would never end.
        if !tried.insert(left_out.clone()) {
            break;
        }
    }
    let named = suspects.iter().map(|of| search.name(key(of), search.reason(of)));
    let outside = never.iter().map(|&row| search.name(row, Reason::OutOfRange));
    let mut rows: Vec<Outlier> = named.chain(outside).collect();
    rows.sort_by_key(|row| (row.log, row.offset, row.row));
    let rms = (!rows.is_empty()).then(|| search.rms([&all.solution, &fit], &left_out)).flatten();
    Ok(Outliers { rows, too_many: None, rms })
}

/// Size above which an error makes an outlier: far beyond the errors of all but `most` rows. `unseen` is an
/// upper bound on the errors of rows that are not suspects.
fn limit_beyond(tested: &[Suspect], most: usize, unseen: f64) -> f64 {
    let mut sizes: Vec<f64> = tested.iter().map(|(_, of)| of.size).collect();
    let tail = match sizes.len() > most {
        true => *sizes.select_nth_unstable_by(most, |a, b| b.total_cmp(a)).1,
        false => 0.0,
    };
    LIMIT.max(FAR_BEYOND * tail.max(unseen))
}

struct OutlierSearch<'a> {
    data: &'a Dataset,
    options: &'a FitOptions<'a>,
    blocks: Vec<(usize, &'a Block)>,
    suspects: Vec<Vec<usize>>,
    spread: &'a Spread,
    /// Standard deviations of the errors of the fit that last scanned all rows.
    looked_by: Option<PerAxis<f64>>,
}

impl OutlierSearch<'_> {
    fn start_from(&mut self, fit: &Solved, tested: Vec<Vec<TestedRow>>) -> Vec<Suspect> {
        self.looked_by = RowTest::new(&fit.solution, self.spread).map(|test| test.noise);
        self.suspects = tested.iter().map(|of| of.iter().map(|of| of.row).collect()).collect();
        let blocks = tested.into_iter().enumerate();
        blocks.flat_map(|(block, tested)| tested.into_iter().map(move |of| (block, of))).collect()
    }

    fn model(&self) -> Model {
        self.options.model_of(self.data, self.options.basis().unwrap_or(Basis::Cubic))
    }

    fn solve(&self, excluded: &RowKeys) -> Result<Solved, FitError> {
        let row = |&(block, row): &RowKey| (self.blocks[block].0, self.blocks[block].1.offset, row);
        let used = self.data.select(self.options.fresh, &excluded.iter().map(row).collect());
        let problem = PolynomialProblem {
            model: self.model(),
            solver: SolverKind::Exact,
            ridge: self.options.ridge,
            truncate: None,
        };
        let sample = self.data.logs.first().map(|log| &log.sample);
        solve(&problem, None, &Rows::new(&used, self.options.workers), sample)
    }

    /// Fits without some rows, from the solution or sums of `all`; `None` if that requires a pass
    /// over the other rows.
    fn without(&self, all: &Solved, left_out: &RowKeys) -> Result<Option<Solution>, FitError> {
        /// Maximum number of rows to remove from the solution, because each needs memory for all features.
        /// Sums or a pass are better for more rows.
        const MOST_TAKEN_OUT: usize = 4096;
        let rows = self.gather(left_out);
        let few = rows.rows <= MOST_TAKEN_OUT;
        Ok(match (few.then(|| all.solution.without(&rows)).flatten(), &all.sums) {
            (None, Some(sums)) => {
                let mut part = Accumulator::new(sums.basis(), sums.channels());
                part.absorb(&rows.readings, &rows.wrench)?;
                let rest = sums.without(&part.finish()?);
                Some(rest.solve(&self.model(), self.options.ridge)?.solution)
            }
            (solution, _) => solution,
        })
    }

    fn gather(&self, wanted: &RowKeys) -> Block {
        let mut gathered = Block::default();
        wanted.iter().for_each(|&(block, row)| gathered.append(self.blocks[block].1, row..row + 1));
        gathered
    }

    fn used(&self, block: &Block, rows: impl Iterator<Item = usize>) -> Vec<usize> {
        let fresh = self.options.fresh.then(|| block.fresh_rows());
        rows.filter(|&row| fresh.as_ref().is_none_or(|fresh| fresh[row])).collect()
    }

    fn look(&mut self, test: &RowTest<'_>) -> Result<(), FitError> {
        let work = |room: &mut PerAxis<Vec<f64>>, &(_, block): &(usize, &Block)| {
            test.calibration.wrench(&block.readings, room);
            Ok(self.used(block, test.suspects(block, room).into_iter()))
        };
        let mut all = Vec::with_capacity(self.blocks.len());
        let fold = |of_block| {
            all.push(of_block);
            Ok(())
        };
        let workers = self.options.workers;
        each(&self.blocks, |(_, block)| block, workers, PerAxis::default, work, fold)?;
        for (suspects, found) in self.suspects.iter_mut().zip(all) {
            suspects.extend(found);
            suspects.sort_unstable();
            suspects.dedup();
        }
        Ok(())
    }

    /// Tests the suspects by a fit without `excluded` rows, and finds the size above which errors make outliers.
    /// Scans all rows again only if others may be outliers, or if many large errors raise the limit.
    fn test(
        &mut self,
        test: &RowTest<'_>,
        excluded: &RowKeys,
        most: usize,
    ) -> Result<(Vec<Suspect>, f64), FitError> {
        /// An error of a smaller size stays below [`LIMIT`] even if the predictions change.
        const NEAR_LIMIT: f64 = LIMIT / 1.5;
        let unseen = self.looked_by.map(|noise| test.largest_unseen(&noise));
        if let Some(unseen) = unseen.filter(|&unseen| unseen < NEAR_LIMIT) {
            let tested = self.test_suspects(test, excluded)?;
            let [least, largest] = [0.0, unseen].map(|unseen| limit_beyond(&tested, most, unseen));
            let same = |(_, of): &Suspect| of.is_outlier(least) == of.is_outlier(largest);
            if tested.iter().all(same) {
                return Ok((tested, least));
            }
        }
        self.look(test)?;
        self.looked_by = Some(test.noise);
        let tested = self.test_suspects(test, excluded)?;
        let limit = limit_beyond(&tested, most, 0.0);
        Ok((tested, limit))
    }

    fn test_suspects(
        &self,
        test: &RowTest<'_>,
        excluded: &RowKeys,
    ) -> Result<Vec<Suspect>, FitError> {
        let test_block = |&block: &usize| {
            let is_left_out = |row: usize| excluded.contains(&(block, row));
            let tested = test.test(self.blocks[block].1, &self.suspects[block], &is_left_out);
            Ok(tested.into_iter().map(move |tested| (block, tested)))
        };
        let with_suspects = |block: &usize| !self.suspects[*block].is_empty();
        let blocks: Vec<usize> = (0..self.blocks.len()).filter(with_suspects).collect();
        // Other passes count these rows for the progress bar.
        let tested = map(&blocks, self.options.workers, test_block)?;
        Ok(tested.into_iter().flatten().collect())
    }

    fn rows_out_of_range(&self) -> RowKeys {
        let Some([least, most]) = self.options.valid_range else { return RowKeys::new() };
        let of_block = |(at, &(_, block)): (usize, &(usize, &Block))| {
            let is_outside = |row: &usize| {
                block.readings.iter().any(|column| !(least..=most).contains(&column[*row]))
            };
            let rows = self.used(block, (0..block.rows).filter(is_outside));
            rows.into_iter().map(move |row| (at, row))
        };
        self.blocks.iter().enumerate().flat_map(of_block).collect()
    }

    /// Root mean square errors of both fits on the rows other than `left_out`. The first fit used these rows,
    /// so their squared errors are subtracted from its sum. This loses few digits: a row with a far larger
    /// error bends the fit, so that others have errors, too.
    fn rms(&self, [all, without]: [&Solution; 2], left_out: &RowKeys) -> Option<[PerAxis<f64>; 2]> {
        let left_out = self.gather(left_out);
        let mut predicted = PerAxis::default();
        RowTest::new(all, self.spread)?.calibration.wrench(&left_out.readings, &mut predicted);
        let rms = |of: &Solution, axis: usize, (rows, square): (usize, f64)| {
            let Solution { residual_products, rows: all, .. } = of;
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

    fn reason(&self, &(block, TestedRow { row, error, size, axis, .. }): &Suspect) -> Reason {
        let (error, rows) = (error[axis], self.blocks[block].1);
        let predicted = error + rows.wrench[axis][row];
        let column = rows.readings.len() + axis;
        let is_possible = self.spread.apart(column, predicted, 0.0) < FAR_BEYOND_LOADS;
        Reason::Error { axis: Axis::ALL[axis], size, error, is_possible }
    }

    /// Names a row and its columns: those that differ most from its neighbours, or the readings outside the
    /// valid range.
    fn name(&self, (block, row): RowKey, reason: Reason) -> Outlier {
        let (log, rows) = self.blocks[block];
        let (channels, terms) = (self.data.channels(), rows.memory_columns);
        let all: Vec<&Vec<f64>> = rows.readings.iter().chain(&rows.wrench).collect();
        let beside = |column: usize| {
            [row.checked_sub(1), Some(row + 1)].map(|at| all[column].get(at?).copied())
        };
        // The distance to the nearer neighbour: at the edge of a contact the other is far away.
        let apart = |column: usize| {
            let known = beside(column).into_iter().flatten();
            let apart = known.map(|other| self.spread.apart(column, all[column][row], other));
            let nearest = apart.fold(f64::INFINITY, f64::min);
            (column, if nearest.is_finite() { nearest } else { 0.0 })
        };
        let range = self.options.valid_range.filter(|_| reason == Reason::OutOfRange);
        let is_named = |column: &usize| match range {
            Some([least, most]) => {
                *column < channels && !(least..=most).contains(&all[*column][row])
            }
            // Memory terms are not in the log.
            None => !(channels..channels + terms).contains(column),
        };
        let mut columns: Vec<(usize, f64)> = (0..all.len()).filter(is_named).map(apart).collect();
        columns.sort_by(|a, b| b.1.total_cmp(&a.1));
        let far = columns.iter().filter(|(_, apart)| *apart > FAR_FROM_NEIGHBOURS).count();
        let column = |&(column, _): &(usize, f64)| {
            let ([before, after], value) = (beside(column), all[column][row]);
            let column = if column < channels { column } else { column - terms };
            OutlierColumn { column, value, before, after }
        };
        let columns = columns.iter().take(far.max(1)).map(column).collect();
        Outlier { log, offset: rows.offset, row, reason, columns }
    }
}
