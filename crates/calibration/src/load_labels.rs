//! Poses without labels, matched in order with a list of loads.

use crate::groups::label_runs;
use crate::validation::pose_finder::{FoundPose, PoseFinder, SAME_POSE, Steps};
use sensor_physics::MOST_CHANNELS;
use shell_data::dataset::{Dataset, LogRows, sample};
use shell_data::statistics::extremes;

/// Largest distance of an unloaded pose from the first pose, as a share of the channel's range: play leaves some.
const UNLOADED: f64 = 0.03;

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("found `{poses}` still intervals, `{loaded}` of them loaded, for `{loads}` loads{times}")]
pub struct PoseMismatch {
    pub poses: usize,
    /// Poses that differ from the first.
    pub loaded: usize,
    pub loads: usize,
    /// Times of the first poses, in words; empty if logs have no time.
    pub times: String,
}

/// Shares of a channel's range within which poses merge: that of the pose finder, then wider
/// ones for creep of springs.
const SAME: [f64; 3] = [SAME_POSE, 0.02, 0.04];

type ReadingPose = FoundPose<MOST_CHANNELS>;

/// Labels rows by the hung load, matching poses and labels in order. If there are more poses than labels,
/// poses that read like the first have no load. Rows outside the matched poses have the empty label.
///
/// # Errors
/// [`PoseMismatch`] if neither the poses nor the loaded poses are as many as the labels.
pub fn label_loads(data: &Dataset, labels: &[String]) -> Result<Dataset, PoseMismatch> {
    let finders: Vec<_> = data.logs.iter().map(finder).collect();
    let found = |same: f64| -> Vec<(usize, ReadingPose)> {
        let of = |(log, finder): (usize, &PoseFinder<MOST_CHANNELS>)| {
            finder.steady_poses(same).into_iter().map(move |pose| (log, pose))
        };
        finders.iter().enumerate().flat_map(of).collect()
    };
    // Creep of springs divides poses: wider limits merge them, until there are as many poses as labels.
    let chosen = SAME.into_iter().find_map(|same| {
        let poses = found(same);
        let loaded = unlike_the_first(&poses, UNLOADED.max(same));
        [poses, loaded].into_iter().find(|of| of.len() == labels.len())
    });
    let Some(chosen) = chosen else {
        let poses = found(SAME[0]);
        let loaded = unlike_the_first(&poses, UNLOADED).len();
        let times = times(data, &poses);
        return Err(PoseMismatch { poses: poses.len(), loaded, loads: labels.len(), times });
    };
    let mut data = data.clone();
    for (at, log) in data.logs.iter_mut().enumerate() {
        let own = chosen.iter().zip(labels).filter(|((log, _), _)| *log == at);
        label(log, &own.map(|((_, pose), name)| (*pose, name)).collect::<Vec<_>>());
    }
    Ok(data)
}

/// Start and end of the first few poses, s, if logs have time.
fn times(data: &Dataset, poses: &[(usize, ReadingPose)]) -> String {
    const SHOWN: usize = 4;
    let time_s = |log: usize, row: u64| {
        let blocks = data.logs[log].blocks.iter();
        blocks.flat_map(|block| block.rows.time_s.iter()).nth(row as usize).copied()
    };
    let span = |(log, pose): &(usize, ReadingPose)| {
        let ends = (time_s(*log, pose.start)?, time_s(*log, pose.start + pose.rows - 1)?);
        Some(format!("{:.1} to {:.1} s", ends.0, ends.1))
    };
    let spans: Option<Vec<String>> = poses.iter().take(SHOWN).map(span).collect();
    match spans {
        Some(spans) if !spans.is_empty() => {
            let more = if poses.len() > SHOWN { ", …" } else { "" };
            format!(" (still: {}{more})", spans.join(", "))
        }
        _ => String::new(),
    }
}

fn finder(log: &LogRows) -> PoseFinder<MOST_CHANNELS> {
    let blocks = || log.blocks.iter().map(|block| &*block.rows);
    let mut finder = PoseFinder::new(Steps::from_sample(&[], &sample(blocks()).readings));
    blocks().for_each(|block| finder.add(&block.time_s, &block.readings));
    finder
}

fn unlike_the_first(poses: &[(usize, ReadingPose)], unloaded: f64) -> Vec<(usize, ReadingPose)> {
    let Some((_, first)) = poses.first() else { return Vec::new() };
    let ends = |channel: usize| extremes(poses.iter().map(|(_, pose)| pose.mean[channel]));
    let is_unloaded = |pose: &ReadingPose| {
        (0..MOST_CHANNELS).all(|channel| {
            let (low, high) = ends(channel);
            (pose.mean[channel] - first.mean[channel]).abs() <= unloaded * (high - low)
        })
    };
    poses.iter().filter(|(_, pose)| !is_unloaded(pose)).copied().collect()
}

fn label(log: &mut LogRows, poses: &[(ReadingPose, &String)]) {
    let mut end = 0;
    let runs = poses.iter().flat_map(|(pose, label)| {
        let before = pose.start.saturating_sub(end);
        end = pose.start + pose.rows;
        [(String::new(), before), ((*label).clone(), pose.rows)]
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

    /// Three loads of 200 rows, each after 100 rows without a load and 30 rows of transition.
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
    fn loads_are_the_poses_that_differ_from_the_first() {
        let labels = ["a", "b", "c"].map(str::to_owned);
        let labelled = label_loads(&recording(), &labels).unwrap();
        let runs = &labelled.logs[0].blocks[0].labels;
        let named: Vec<&(String, usize)> = runs.iter().filter(|run| !run.0.is_empty()).collect();
        assert_eq!(named.iter().map(|run| &run.0).collect::<Vec<_>>(), ["a", "b", "c"]);
        // The end of the transition, which takes 30 rows, is nearer to the load than a step.
        assert!(named.iter().all(|run| (200..=225).contains(&run.1)), "{named:?}");
        assert_eq!(runs.iter().map(|run| run.1).sum::<usize>(), recording().rows() as usize);
    }

    #[test]
    fn channels_beyond_the_sixth_tell_loads_as_the_first_do() {
        let labels = ["a", "b", "c"].map(str::to_owned);
        let mut last = recording();
        let rows = Arc::make_mut(&mut last.logs[0].blocks[0].rows);
        // Puts six channels that measure nothing first.
        rows.readings.splice(0..0, vec![vec![500.0; rows.rows]; 6]);
        let runs =
            |data: &Dataset| label_loads(data, &labels).unwrap().logs[0].blocks[0].labels.clone();
        assert_eq!(runs(&last), runs(&recording()));
    }

    /// A tenth of each change is delayed by an exponential of 1.5 s. Each load takes 12 s at 50 Hz.
    #[test]
    fn loads_that_creep_are_found_too() {
        let (mut random, mut readings, mut times) = (Random(9), Vec::new(), Vec::new());
        let (mut crept, mut load) = (0.0, 0.0);
        for (at, target) in [0.0, 800.0, 0.0, -500.0, 0.0, 300.0, 0.0].into_iter().enumerate() {
            for row in 0..600 {
                // Hanging the load takes half a second.
                load += (target - load) / if row < 25 { 5.0 } else { 1.0 };
                crept += (0.1 * target - crept) * 0.02 / 1.5;
                readings.push(2000.0 + 0.9 * load + crept + 2.0 * random.normal());
                times.push(f64::from(600 * at as u32 + row) * 0.02);
            }
        }
        let rows = readings.len();
        let block = Block { rows, readings: vec![readings], time_s: times, ..Block::default() };
        let data = Dataset::from_blocks("bench", Axes::NONE, vec![block]);
        let labels = ["a", "b", "c"].map(str::to_owned);
        let labelled = label_loads(&data, &labels).unwrap();
        let runs = &labelled.logs[0].blocks[0].labels;
        let named: Vec<&(String, usize)> = runs.iter().filter(|run| !run.0.is_empty()).collect();
        // Rows before the first ones that agree belong to no pose.
        assert!(named.len() == 3 && named.iter().all(|run| run.1 > 400), "{named:?}");
        let error = label_loads(&data, &labels[..2]).unwrap_err();
        assert!(error.to_string().contains("(still: 0.0 to 1"), "{error}");
    }

    #[test]
    fn unloaded_poses_are_loads_if_each_has_a_label_and_other_numbers_are_refused() {
        let labels = |count: usize| (0..count).map(|at| at.to_string()).collect::<Vec<_>>();
        assert!(label_loads(&recording(), &labels(7)).is_ok());
        let error = label_loads(&recording(), &labels(4)).unwrap_err();
        assert_eq!((error.poses, error.loaded, error.loads), (7, 3, 4));
    }
}
