//! Sums of rows, group by group, in one pass.
//!
//! Beside the groups, rows are assigned at random into as many folds as are asked for, for the naive
//! figure. All sums are exact, so those of the groups add up to those of all rows, bit for bit, and
//! so do those of the random folds, in any order of the rows.
//!
//! Every worker thread has a [`GroupWorker`], which sums rows by group without locks. It hands over
//! the sums of the groups that it has not seen for longest with its blocks, to the [`GroupSums`] of
//! the caller, and the others at the end.
//!
//! Memory: a group costs about 16 bytes for each distinct sum and some 50 for each sum with a wrench
//! (under 150 kB for eight channels and poly3, 20 kB for the cubic model), in each worker that has
//! met it up to 256 rows that wait to be summed together, and at most `MAX_OPEN` groups of a worker
//! have working sums besides. There may be [`MAX_GROUPS`] groups, or any number
//! of them in as many sets, see [`Apart::Sets`].

mod sums;

pub use self::sums::{
    Apart, BlockGroups, GroupKind, GroupSums, GroupWorker, GroupedMoments, MAX_GROUPS, RandomSplit,
    assign,
};
