//! The search for suspicious rows among those of a fit: found, named, and left out where that is asked for. A stretch of
//! rows that a model does not follow is said once.

use std::sync::Arc;

use super::stretches::ErrorStretch;
use crate::error::FitError;
use crate::passes::{Workers, each};
use crate::quality::significant;
use crate::validation::outliers::{LOOK_AT, RowChanges, RowJump};
use shell_data::block::Block;
use shell_data::dataset::{Dataset, LabelledBlock, RowSet};

/// More suspicious rows than this share, and than so many, are no faults of single rows.
const LARGEST_SHARE: f64 = 0.05;
const MANY: usize = 150;

/// Where more rows than this share, and than so many, are unusual, columns jump by nature.
const UNUSUAL_SHARE: f64 = 0.005;
const UNUSUAL: usize = 8;

/// Columns that jump by so many standard deviations are worth a word.
const WORTH_A_WORD: f64 = 2.0;

/// Pieces of the recording that show how columns change, and the rows of each.
const PIECES: usize = 128;
const PIECE_ROWS: usize = 34;

/// How rows are searched.
#[derive(Clone, Copy, Debug, Default)]
pub struct OutlierTest<'a> {
    /// Use only rows whose readings differ from those of the row before.
    pub fresh: bool,
    /// Readings outside are wrong whatever else they are.
    pub valid_range: Option<[f64; 2]>,
    /// Who works on it.
    pub workers: Workers<'a>,
}

/// Where a row is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct RowPlace {
    /// The number of its log.
    pub log: usize,
    /// Its block.
    pub place: u64,
    /// The row of the block.
    pub row: usize,
}

/// Why a row is suspicious.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reason {
    /// A reading is outside the valid range.
    OutOfRange,
    /// A column jumps, and no other column says why.
    Jump {
        /// By so many standard deviations of the differences of neighbouring rows.
        size: f64,
    },
}

/// A suspicious row.
#[derive(Clone, Debug, PartialEq)]
pub struct Outlier {
    /// Where it is.
    pub at: RowPlace,
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
    pub before: f64,
    /// Its value in the row after.
    pub after: f64,
}

/// What was found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outliers {
    /// The rows, in their order.
    pub rows: Vec<Outlier>,
    /// Suspicious rows where those are too many to be single faults: none of them is named.
    pub too_many: Option<usize>,
    /// Rows that the model does not follow.
    pub stretch: Option<ErrorStretch>,
}

impl Outliers {
    /// Whether there is anything to say.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty() && self.too_many.is_none() && self.stretch.is_none()
    }

    /// The rows, to be left out.
    pub fn excluded(&self) -> RowSet {
        self.rows.iter().map(|row| (row.at.log, row.at.place, row.at.row)).collect()
    }

    /// Takes out the rows that are to be left out, in a value of their own.
    pub(super) fn split_off(&mut self, is_left_out: impl Fn(&Outlier) -> bool) -> Self {
        let (rows, rest) = std::mem::take(&mut self.rows).into_iter().partition(is_left_out);
        self.rows = rest;
        Self { rows, ..Self::default() }
    }

    /// All places that have to be named: those of the rows, then the ends of the stretch.
    pub fn places(&self) -> Vec<RowPlace> {
        let ends = self.stretch.iter().flat_map(|stretch| stretch.ends);
        self.rows.iter().map(|row| row.at).chain(ends).collect()
    }

    /// What is to be said of them. `names` say where each of the [places](Self::places) is.
    pub fn warnings(&self, names: &[RowName]) -> Vec<String> {
        /// More would hide what else is said.
        const SHOWN: usize = 10;
        let in_words = |(row, name): (&Outlier, &RowName)| {
            let RowName { file, line, columns } = name;
            format!("`{file}` line {line} is suspicious: {}", row.why(columns))
        };
        let rows = self.rows.iter().zip(names);
        let mut said: Vec<String> = rows.take(SHOWN).map(in_words).collect();
        let count = self.rows.len();
        said.extend(
            (count > SHOWN).then(|| format!("{count} rows are suspicious, {SHOWN} of them above")),
        );
        said.extend(self.too_many.map(|rows| {
            format!(
                "{rows} rows jump in columns that the others do not follow, too many for faults of single rows: \
                 columns may not be what they are taken for (`shellcal info`)"
            )
        }));
        if let (Some(stretch), Some([first, last])) = (&self.stretch, names.last_chunk()) {
            said.push(stretch.in_words(&first.file, [first.line, last.line]));
        }
        said
    }
}

/// Where a row is, in words.
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
    /// Which of a row's columns jump, and by how much. `names` are those of all columns.
    pub fn why(&self, names: &[String]) -> String {
        let columns = self.columns.iter().take(3).map(|column| {
            let OutlierColumn { column, value, before, after } = column;
            let name = names.get(*column).map_or("", String::as_str);
            format!("`{name}` is {value} (neighbouring rows: {before} and {after})")
        });
        let more = match self.columns.len().saturating_sub(3) {
            0 => String::new(),
            more => format!(" and {more} more columns"),
        };
        let why = match self.reason {
            Reason::OutOfRange => "outside the valid range".to_owned(),
            Reason::Jump { size } => format!(
                "{} standard deviations of the differences of neighbouring rows",
                significant(size, 2)
            ),
        };
        format!("{}{more}; {why}", columns.collect::<Vec<_>>().join(", "))
    }
}

/// Looks for suspicious rows in `data`.
///
/// # Errors
/// [`FitError::Interrupted`].
pub fn find_outliers(data: &Dataset, test: &OutlierTest<'_>) -> Result<Outliers, FitError> {
    let blocks = searched_blocks(data, test.fresh);
    let pieces: Vec<Vec<&[f64]>> = pieces(&blocks);
    let changes = RowChanges::new(&pieces);
    let mut looked_at: Vec<(usize, usize, Option<Reason>)> = Vec::new();
    let work = |(): &mut (), (at, block): &(usize, SearchedBlock)| {
        let outside = test.valid_range.into_iter().flat_map(|range| outside(&block.rows, range));
        let mut rows: Vec<_> = outside.map(|row| (*at, row, Some(Reason::OutOfRange))).collect();
        if let Some(changes) = &changes {
            let jumps = changes.jumps(&columns(&block.rows));
            let is_edge = |row: usize| row == 0 || row + 1 == block.rows.rows;
            let is_looked_at = |&row: &usize| jumps[row] > LOOK_AT || is_edge(row);
            rows.extend((0..block.rows.rows).filter(is_looked_at).map(|row| (*at, row, None)));
        }
        Ok(rows)
    };
    let fold = |rows: Vec<_>| {
        looked_at.extend(rows);
        Ok(())
    };
    let numbered: Vec<(usize, SearchedBlock)> = blocks.iter().cloned().enumerate().collect();
    each(&numbered, |(_, block)| &block.rows, test.workers, || (), work, fold)?;
    let search = Search { blocks: &blocks, changes: changes.as_ref() };
    Ok(search.outliers(looked_at))
}

/// The rows of a block, or those among them that are fresh.
#[derive(Clone)]
struct SearchedBlock {
    log: usize,
    rows: Arc<Block>,
    /// Which they are of the block, if not all.
    fresh: Option<Vec<usize>>,
}

fn searched_blocks(data: &Dataset, fresh: bool) -> Vec<SearchedBlock> {
    let searched = |(log, block): (usize, &LabelledBlock)| {
        if !fresh {
            return SearchedBlock { log, rows: Arc::clone(&block.rows), fresh: None };
        }
        let keep = block.rows.fresh_rows();
        let mut rows = Block::clone(&block.rows);
        rows.groups.clear();
        rows.retain_rows(&keep);
        let fresh = (0..keep.len()).filter(|&row| keep[row]).collect();
        SearchedBlock { log, rows: Arc::new(rows), fresh: Some(fresh) }
    };
    let blocks = data.blocks().map(searched);
    blocks.filter(|block| block.rows.rows > 0).collect()
}

/// Readings, then loads.
fn columns(block: &Block) -> Vec<&[f64]> {
    block.readings.iter().chain(&block.wrench).map(Vec::as_slice).collect()
}

/// Pieces from all over the blocks; all of them, if the rows are few.
fn pieces(blocks: &[SearchedBlock]) -> Vec<Vec<&[f64]>> {
    let rows: usize = blocks.iter().map(|block| block.rows.rows).sum();
    let stride = (rows / PIECES).max(PIECE_ROWS);
    let mut pieces = Vec::new();
    let mut start = 0;
    for block in blocks {
        let count = block.rows.rows;
        // Pieces start at multiples of the stride.
        for first in (start.next_multiple_of(stride)..start + count).step_by(stride) {
            let piece = first - start..(first - start + PIECE_ROWS).min(count);
            pieces.push(columns(&block.rows).into_iter().map(|all| &all[piece.clone()]).collect());
        }
        start += count;
    }
    pieces
}

/// The rows of a block with a reading outside a range.
fn outside(block: &Block, [least, most]: [f64; 2]) -> Vec<usize> {
    let is_outside =
        |row: &usize| block.readings.iter().any(|column| !(least..=most).contains(&column[*row]));
    (0..block.rows).filter(is_outside).collect()
}

/// Rows that are judged.
struct Search<'a> {
    blocks: &'a [SearchedBlock],
    changes: Option<&'a RowChanges>,
}

impl Search<'_> {
    /// Judges rows by block and row of the block, in this order; those with a reason have one already.
    fn outliers(&self, looked_at: Vec<(usize, usize, Option<Reason>)>) -> Outliers {
        let mut found = Outliers::default();
        let (mut suspicious, mut unusual) = (Vec::new(), 0);
        for (at, row, reason) in looked_at {
            let Some(rows) = self.neighbours(at, row) else { continue };
            let judged = self.changes.map(|of| of.judge(rows.each_ref().map(Vec::as_slice)));
            match (reason, judged) {
                (Some(reason), _) => found.rows.push(self.name(at, row, &rows, reason)),
                (None, Some(jump)) if jump.is_suspicious() => {
                    suspicious.push((at, row, rows, jump))
                }
                (None, Some(jump)) => unusual += usize::from(jump.is_unusual()),
                (None, None) => {}
            }
        }
        let is_more = |count: usize, share: f64, than: usize| {
            let rows: usize = self.blocks.iter().map(|block| block.rows.rows).sum();
            count > than.max((share * rows as f64) as usize)
        };
        if is_more(suspicious.len(), LARGEST_SHARE, MANY) {
            found.too_many = Some(suspicious.len());
        } else if !is_more(unusual, UNUSUAL_SHARE, UNUSUAL) {
            let name = |(at, row, rows, RowJump { jump, .. })| {
                self.name(at, row, &rows, Reason::Jump { size: jump })
            };
            let named: Vec<Outlier> = suspicious.into_iter().map(name).collect();
            let is_new = |row: &Outlier| found.rows.iter().all(|other| other.at != row.at);
            let new: Vec<Outlier> = named.into_iter().filter(is_new).collect();
            found.rows.extend(new);
        }
        found.rows.sort_by_key(|row| row.at);
        found
    }

    /// The columns of a row, between those of its neighbours: at the ends of a log the two next to it.
    fn neighbours(&self, at: usize, row: usize) -> Option<[Vec<f64>; 3]> {
        let row = row as isize;
        let of = |by: isize| self.row(at, row + by);
        let (before, after) = match (of(-1), of(1)) {
            (Some(before), Some(after)) => (before, after),
            (None, Some(after)) => (of(2)?, after),
            (Some(before), None) => (before, of(-2)?),
            (None, None) => return None,
        };
        Some([before, of(0)?, after])
    }

    /// A row by its place in a block, or beyond its ends in the next one of the log.
    fn row(&self, mut at: usize, mut row: isize) -> Option<Vec<f64>> {
        let log = self.blocks[at].log;
        while row < 0 {
            at = at.checked_sub(1)?;
            row += self.blocks[at].rows.rows as isize;
        }
        while row >= self.blocks.get(at)?.rows.rows as isize {
            row -= self.blocks[at].rows.rows as isize;
            at += 1;
        }
        let block = &self.blocks[at];
        let values = || columns(&block.rows).into_iter().map(|column| column[row as usize]);
        (block.log == log).then(|| values().collect())
    }

    /// Names a row and the columns in it that jump most; of a row outside a range, the readings that are the farthest from
    /// their neighbours.
    fn name(
        &self,
        at: usize,
        row: usize,
        [before, values, after]: &[Vec<f64>; 3],
        reason: Reason,
    ) -> Outlier {
        let jump = |column: usize| {
            let of = |changes: &RowChanges| {
                changes.jump_of(column, [before[column], values[column], after[column]])
            };
            (column, self.changes.map_or(0.0, of))
        };
        let mut columns: Vec<(usize, f64)> = (0..values.len()).map(jump).collect();
        columns.sort_by(|a, b| b.1.total_cmp(&a.1));
        let far = columns.iter().filter(|(_, jump)| *jump > WORTH_A_WORD).count();
        columns.truncate(far.max(1));
        let column = |&(column, _): &(usize, f64)| OutlierColumn {
            column,
            value: values[column],
            before: before[column],
            after: after[column],
        };
        let block = &self.blocks[at];
        let row = block.fresh.as_ref().map_or(row, |fresh| fresh[row]);
        let at = RowPlace { log: block.log, place: block.rows.place, row };
        Outlier { at, reason, columns: columns.iter().map(column).collect() }
    }
}
