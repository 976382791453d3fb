//! The search for the change that cures logs which contradict a calibration: of all rows, one log, or half of one.

use super::cures::{Cure, WrenchProducts, delay};
use super::parts::{ROWS, predicted, spread};
use crate::conversion::Calibration;
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, PerAxis};

/// Maximum number of rows on which each exchange of two channels is tried.
const ROWS_OF_EXCHANGE: usize = 300;

/// The change that cures the whole test, one of its files, or half of a file.
pub(super) fn cure_of_test(
    calibration: &Calibration,
    tested: &Dataset,
    limit: &PerAxis<f64>,
) -> Option<String> {
    let axes = calibration.axes;
    let search = |rows: &Block| cure(calibration, rows, limit, axes);
    let logs: Vec<Vec<&Block>> = tested
        .logs
        .iter()
        .map(|log| log.blocks.iter().map(|block| &*block.rows).collect())
        .collect();
    let all: Vec<&Block> = logs.iter().flatten().copied().collect();
    if let Some(found) = search(&spread(&all, 0.0..1.0)) {
        return Some(found.to_string());
    }
    for (log, blocks) in tested.logs.iter().zip(&logs) {
        let name = log.name.display();
        if let Some(found) = search(&spread(blocks, 0.0..1.0)).filter(|_| logs.len() > 1) {
            return Some(format!("in `{name}` {found}"));
        }
        if let Some(found) = late(calibration, blocks, limit, axes) {
            return Some(found.to_string());
        }
        for (half, part) in [("first", 0.0..0.5), ("second", 0.5..1.0)] {
            if let Some(found) = search(&spread(blocks, part)) {
                return Some(format!("in the {half} half of `{name}` {found}"));
            }
        }
    }
    None
}

/// The change of the reference, or the exchange of two channels, that cures the rows.
fn cure(calibration: &Calibration, rows: &Block, limit: &PerAxis<f64>, axes: Axes) -> Option<Cure> {
    if rows.rows == 0 {
        return None;
    }
    let products = WrenchProducts::new(&predicted(calibration, rows), &rows.wrench);
    let found = products.cure(limit, axes);
    found.or_else(|| exchanged_channels(calibration, rows, limit, axes))
}

fn exchanged_channels(
    calibration: &Calibration,
    rows: &Block,
    limit: &PerAxis<f64>,
    axes: Axes,
) -> Option<Cure> {
    let channels = calibration.channels();
    let few = {
        let every = rows.rows.div_ceil(ROWS_OF_EXCHANGE).max(1);
        let mut few = Block::default();
        (0..rows.rows).step_by(every).for_each(|row| few.append(rows, row..row + 1));
        few
    };
    let products = |readings: &[Vec<f64>]| {
        let mut predicted = PerAxis::default();
        calibration.wrench(readings, &mut predicted);
        WrenchProducts::new(&predicted, &few.wrench)
    };
    let now = products(&few.readings);
    let (before, loads) = (now.plain(), now.loads());
    let mut best: Option<Cure> = None;
    for (a, b) in (0..channels).flat_map(|a| (a + 1..channels).map(move |b| (a, b))) {
        let mut readings = few.readings.clone();
        // The memory terms of both channels are exchanged, too.
        for first in (0..readings.len()).step_by(channels) {
            readings.swap(first + a, first + b);
        }
        let change = format!("exchanging the readings s{} and s{}", a + 1, b + 1);
        let after = products(&readings).plain();
        let found = Cure::if_cured(change, axes, limit, &loads, [&before, &after]);
        let gain = |of: &Cure| of.rms[0] / of.rms[1];
        if let Some(found) = found
            && best.as_ref().is_none_or(|best| gain(&found) > gain(best))
        {
            best = Some(found);
        }
    }
    best
}

/// The delay that cures the rows of one log.
fn late(
    calibration: &Calibration,
    blocks: &[&Block],
    limit: &PerAxis<f64>,
    axes: Axes,
) -> Option<Cure> {
    let mut rows = Block::default();
    for block in blocks {
        let some = block.rows.min(ROWS - rows.rows);
        rows.append(block, 0..some);
    }
    delay(&predicted(calibration, &rows), &rows.wrench, limit, axes).map(|(_, cure)| cure)
}
