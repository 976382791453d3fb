//! Rows at which the readings of a recording without labels are still, matched with loads in their order.

use crate::groups::label_runs;
use crate::validation::plateaus::{Level, PlateauFinder, Steps};
use sensor_physics::MOST_CHANNELS;
use shell_data::dataset::{Dataset, LogRows, sample};
use shell_data::statistics::extremes;

/// A hold is one without a load if every channel is within this share of its range from the first: weights that are
/// taken off leave play.
const AT_REST: f64 = 0.03;

/// Holds that are not as many as the loads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "readings are still in `{holds}` stretches, `{loaded}` of them unlike the first, for `{loads}` loads"
)]
pub struct HoldMismatch {
    /// Stretches.
    pub holds: usize,
    /// Those that differ from the first.
    pub loaded: usize,
    /// Loads.
    pub loads: usize,
}

type ReadingHold = Level<MOST_CHANNELS>;

/// The rows of a data set labelled by the load that was hung: stretches of still readings, in their order, are the loads
/// in theirs. If there are more, those that read like the first are taken for moments without a load. Rows in none have
/// the empty label.
///
/// # Errors
/// [`HoldMismatch`] if there are not as many stretches as labels either way.
pub fn label_holds(data: &Dataset, labels: &[String]) -> Result<Dataset, HoldMismatch> {
    let holds: Vec<(usize, ReadingHold)> = (data.logs.iter().enumerate())
        .flat_map(|(log, rows)| holds(rows).into_iter().map(move |hold| (log, hold)))
        .collect();
    let loaded = unlike_the_first(&holds);
    let chosen = match labels.len() {
        count if count == holds.len() => &holds,
        count if count == loaded.len() => &loaded,
        loads => {
            return Err(HoldMismatch { holds: holds.len(), loaded: loaded.len(), loads });
        }
    };
    let mut data = data.clone();
    for (at, log) in data.logs.iter_mut().enumerate() {
        let own = chosen.iter().zip(labels).filter(|((log, _), _)| *log == at);
        label(log, &own.map(|((_, hold), name)| (*hold, name)).collect::<Vec<_>>());
    }
    Ok(data)
}

fn holds(log: &LogRows) -> Vec<ReadingHold> {
    let blocks = || log.blocks.iter().map(|block| &*block.rows);
    let mut finder = PlateauFinder::new(Steps::from_sample(&[], &sample(blocks()).readings));
    blocks().for_each(|block| finder.add(&block.time_s, &block.readings));
    finder.holds()
}

fn unlike_the_first(holds: &[(usize, ReadingHold)]) -> Vec<(usize, ReadingHold)> {
    let Some((_, first)) = holds.first() else { return Vec::new() };
    let ends = |channel: usize| extremes(holds.iter().map(|(_, hold)| hold.mean[channel]));
    let is_at_rest = |hold: &ReadingHold| {
        (0..MOST_CHANNELS).all(|channel| {
            let (low, high) = ends(channel);
            (hold.mean[channel] - first.mean[channel]).abs() <= AT_REST * (high - low)
        })
    };
    holds.iter().filter(|(_, hold)| !is_at_rest(hold)).copied().collect()
}

fn label(log: &mut LogRows, holds: &[(ReadingHold, &String)]) {
    let mut end = 0;
    let runs = holds.iter().flat_map(|(hold, label)| {
        let before = hold.start.saturating_sub(end);
        end = hold.start + hold.rows;
        [(String::new(), before), ((*label).clone(), hold.rows)]
    });
    label_runs(log, runs.chain([(String::new(), u64::MAX)]));
    log.has_groups = true;
}

#[cfg(test)]
mod tests {
    use system_tests::random::Random;

    use std::sync::Arc;

    use super::*;
    use shell_data::block::Block;
    use shell_data::wrench::Axes;

    /// Three loads with rest between them, moved to in 30 rows: 100 rows of rest, 200 of a load.
    fn recording() -> Dataset {
        let mut random = Random(3);
        let loads = [[0.0; 3], [200.0, -50.0, 30.0], [-90.0, 100.0, 10.0], [40.0, 60.0, -150.0]];
        let mut readings = vec![Vec::new(); 3];
        for at in [0, 1, 0, 2, 0, 3, 0] {
            let rows = if at == 0 { 100 } else { 200 };
            for row in 0..rows + 30 {
                for (column, load) in readings.iter_mut().zip(loads[at]) {
                    let before: f64 = column.last().copied().unwrap_or(500.0);
                    let target = 500.0 + load;
                    let value = if row < 30 { before + (target - before) / 8.0 } else { target };
                    column.push(value + random.normal());
                }
            }
        }
        let block = Block { rows: readings[0].len(), readings, ..Block::default() };
        Dataset::from_blocks("bench", Axes::NONE, vec![block])
    }

    #[test]
    fn loads_are_the_still_stretches_that_are_not_like_the_first() {
        let labels = ["a", "b", "c"].map(str::to_owned);
        let labelled = label_holds(&recording(), &labels).unwrap();
        let runs = &labelled.logs[0].blocks[0].labels;
        let named: Vec<&(String, usize)> = runs.iter().filter(|run| !run.0.is_empty()).collect();
        assert_eq!(named.iter().map(|run| &run.0).collect::<Vec<_>>(), ["a", "b", "c"]);
        // The end of the way there, of 30 rows, is nearer to the load than a step.
        assert!(named.iter().all(|run| (200..=225).contains(&run.1)), "{named:?}");
        assert_eq!(runs.iter().map(|run| run.1).sum::<usize>(), recording().rows() as usize);
    }

    #[test]
    fn channels_beyond_the_sixth_tell_loads_as_the_first_do() {
        let labels = ["a", "b", "c"].map(str::to_owned);
        let mut last = recording();
        let rows = Arc::make_mut(&mut last.logs[0].blocks[0].rows);
        // Six channels that see nothing come first.
        rows.readings.splice(0..0, vec![vec![500.0; rows.rows]; 6]);
        let runs =
            |data: &Dataset| label_holds(data, &labels).unwrap().logs[0].blocks[0].labels.clone();
        assert_eq!(runs(&last), runs(&recording()));
    }

    #[test]
    fn with_a_label_for_each_stretch_rest_is_a_load_too_and_other_numbers_are_told() {
        let labels = |count: usize| (0..count).map(|at| at.to_string()).collect::<Vec<_>>();
        assert!(label_holds(&recording(), &labels(7)).is_ok());
        let error = label_holds(&recording(), &labels(4)).unwrap_err();
        assert_eq!(error, HoldMismatch { holds: 7, loaded: 3, loads: 4 });
    }
}
