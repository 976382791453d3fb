//! Rows assigned at random into folds.

use shell_data::block::Block;
use shell_data::fingerprint::row_hashes;

/// How rows are assigned at random, for the naive figure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct RandomSplit {
    /// Folds that all rows are assigned to.
    #[serde(rename = "random_folds")]
    pub folds: usize,
    /// Those of them that are summed, to be held out. Two of ten tell an error to a hundredth
    /// from some thousand rows, at a fifth of the work.
    #[serde(rename = "held_out_folds")]
    pub held_out: usize,
    /// Which way the rows are assigned.
    pub seed: u64,
}

/// The rows of the folds that are held out: at random, but a row, and all that equal it, always to the
/// same fold, whatever blocks a log is cut into and whatever other columns it has.
pub fn assign(block: &Block, split: &RandomSplit) -> Vec<Vec<usize>> {
    let mut assigned = vec![Vec::new(); split.held_out];
    if split.held_out == 0 {
        return assigned;
    }
    let columns = block.readings.iter().chain(&block.wrench).map(Vec::as_slice);
    let hashes = row_hashes(mix(split.seed), block.rows, columns);
    for (row, hash) in hashes.into_iter().enumerate() {
        let fold = ((u128::from(mix(hash)) * split.folds as u128) >> 64) as usize;
        assigned.get_mut(fold).into_iter().for_each(|fold| fold.push(row));
    }
    assigned
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014), after its increment.
pub(super) fn mix(state: u64) -> u64 {
    let z = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_dealt_evenly_each_once_and_by_the_seed() {
        let column: Vec<f64> = (0..10_000).map(f64::from).collect();
        let split = RandomSplit { folds: 10, held_out: 10, seed: 7 };
        let assign = |column: &[f64], split: RandomSplit| {
            let readings = vec![column.to_vec()];
            super::assign(&Block { rows: column.len(), readings, ..Block::default() }, &split)
        };
        let assigned = assign(&column, split);
        let mut all: Vec<usize> = assigned.iter().flatten().copied().collect();
        all.sort_unstable();
        assert_eq!(all, (0..10_000).collect::<Vec<_>>());
        // Binomial: mean 1000, standard deviation 30; five of those.
        assert!(assigned.iter().all(|rows| rows.len().abs_diff(1000) < 150));
        assert_ne!(assign(&column, RandomSplit { seed: 8, ..split }), assigned);
        // The same rows, whatever block they come in.
        let [first, second] = [&column[..4321], &column[4321..]];
        let parts = assign(first, split).into_iter().zip(assign(second, split));
        let parts: Vec<Vec<usize>> = parts
            .map(|(a, b)| a.into_iter().chain(b.iter().map(|row| row + 4321)).collect())
            .collect();
        assert_eq!(parts, assigned);
        let some = assign(&column, RandomSplit { held_out: 3, ..split });
        assert_eq!(some, assigned[..3]);
    }
}
