//! Random assignment of rows to folds.

use shell_data::block::Block;
use shell_data::fingerprint::row_hashes;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct RandomSplit {
    #[serde(rename = "random_folds")]
    pub folds: usize,
    /// Number of folds to hold out. With some thousand rows or more, two folds of ten determine an error to 1 %, at a
    /// fifth of the work.
    #[serde(rename = "held_out_folds")]
    pub held_out: usize,
    pub seed: u64,
}

/// Rows of each held-out fold, by a hash of values and seed: equal rows share a fold in any log.
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
pub(crate) fn mix(state: u64) -> u64 {
    let z = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
