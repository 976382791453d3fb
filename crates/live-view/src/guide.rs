//! A guide through planned loads: the next load, its stillness, and the loads recorded so far.
//!
//! ```text
//! still, unloaded ─▶ hang ─▶ still and loaded ─▶ for two seconds: recorded ─▶ take off, or the next ─▶ …
//!                      ▲                                                             │
//!                      └──────────────────────── it moves ◀─────────────────────────┘
//! ```
//!
//! *Still*: over a second no channel scatters by more than [`QUIET`] times its noise at the start, and the means of its
//! halves differ by no more. *Loaded*, with known forces: the wrench is nearer to the planned one than to zero, with
//! axes scaled by the largest load of the plan. Without forces: a reading differs from its unloaded value by more than
//! a multiple of its noise and a tenth of its largest excursion so far, and all together differ by more than a quarter
//! of the excursion predicted from the recorded loads.

use std::collections::VecDeque;

use serde::Serialize;

use super::history::LiveRow;
use shared_proto::CHANNELS;
use shell_data::block::FrameLabel;
use shell_data::wrench::PerAxis;

/// Length of the examined block of time, s.
const TIME_BLOCK_S: f64 = 1.0;

/// Stillness after which a load is recorded, s.
const STILL_S: f64 = 2.0;

/// Maximum noise of a pose, relative to the noise at the start.
const QUIET: f64 = 3.0;

/// Minimum noise, counts and N: few bits, and wrenches from a board, seem noiseless.
const LEAST_NOISE: f64 = 0.5;
const LEAST_FORCE_NOISE: f64 = 1e-3;

/// Minimum distance from the unloaded reading: a multiple of the noise, a share of the excursion.
const OFF_NOISE: f64 = 8.0;
const OFF_SHARE: f64 = 0.1;

/// Minimum excursion of all channels together, as a share of that predicted from the load.
const OFF_LOAD: f64 = 0.25;

#[derive(Clone, Debug, PartialEq)]
pub struct GuidedLoad {
    pub group: String,
    pub text: String,
    pub wrench: PerAxis<f64>,
    /// In any unit.
    pub gain: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GuidePhase {
    /// A time without a load, which determines noise and unloaded readings.
    #[default]
    #[serde(rename = "rest")]
    Unloaded,
    Hang,
    Hold,
    Release,
    Done,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ErrorPoint {
    pub loads: usize,
    /// Largest error of a force, and of a moment, N and N·m.
    pub error: [f64; 2],
    /// Upper ends of the 95 % intervals.
    pub upper: [f64; 2],
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnloadedValues {
    /// Distance of the readings from those at the start, relative to the largest excursion.
    pub readings: [f64; CHANNELS],
    pub wrench: PerAxis<f64>,
}

impl UnloadedValues {
    pub fn distance(&self, other: &Self) -> f64 {
        length(&std::array::from_fn(|c| self.readings[c] - other.readings[c]))
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct GuideView {
    /// Empty if all are recorded.
    pub group: String,
    pub text: String,
    pub wrench: PerAxis<f64>,
    pub number: usize,
    pub count: usize,
    pub recorded: usize,
    pub phase: GuidePhase,
    /// Share of the required stillness that has passed, 0 to 1.
    pub held: f64,
    /// Share of the plan's gain still to come, 0 to 1; `None` if errors are known instead.
    pub remaining_gain: Option<f64>,
    /// Errors after each load, if a calibration is refitted.
    pub errors: Vec<ErrorPoint>,
    /// Errors from which on no more loads are needed, N and N·m.
    pub limits: [Option<f64>; 2],
    pub finding: String,
}

pub trait LoadGuide {
    /// Takes the next row; returns the label of a load that it completes.
    fn push(&mut self, row: &LiveRow) -> Option<FrameLabel>;

    /// Index of the first frame that may still become part of a pose.
    fn first_unsettled(&self) -> Option<i64>;

    fn skip(&mut self);

    fn back(&mut self);

    fn view(&self) -> GuideView;
}

#[derive(Clone, Debug, Default)]
pub struct Guide {
    loads: Vec<GuidedLoad>,
    recorded: Vec<bool>,
    next: usize,
    phase: GuidePhase,
    /// Rows of the block of time, with the values that must be still.
    time_block: VecDeque<(LiveRow, [f64; CHANNELS])>,
    /// Mean and noise without a load.
    unloaded: Option<([f64; CHANNELS], [f64; CHANNELS])>,
    /// Largest distance of each channel from its unloaded reading.
    excursion: [f64; CHANNELS],
    /// Minimum excursion of all channels under the recorded loads, relative to their size.
    response: Option<f64>,
    /// Time and frame since which the sensor is still and loaded.
    still_since: Option<(f64, i64)>,
}

impl Guide {
    pub fn new(loads: Vec<GuidedLoad>) -> Self {
        Self {
            recorded: vec![false; loads.len()],
            phase: if loads.is_empty() { GuidePhase::Done } else { GuidePhase::Unloaded },
            loads,
            ..Self::default()
        }
    }

    /// Asks for this load next, or for none. If another `was_held`, it has to be taken off first.
    pub fn choose(&mut self, load: Option<usize>, was_held: bool) {
        self.next = load.unwrap_or(self.next);
        self.await_load(load.is_none());
        if was_held && self.phase == GuidePhase::Hang {
            self.phase = GuidePhase::Release;
        }
    }

    pub fn phase(&self) -> GuidePhase {
        self.phase
    }

    pub fn next(&self) -> usize {
        self.next
    }

    /// Returns the mean readings without a load at the start.
    pub fn unloaded_readings(&self) -> Option<[f64; CHANNELS]> {
        self.unloaded.map(|(means, _)| means)
    }

    /// Begins again with the time without a load.
    pub fn forget_unloaded(&mut self) {
        self.unloaded = None;
        self.time_block.clear();
        self.await_load(self.phase == GuidePhase::Done);
    }

    /// Returns the newest readings and wrench, if the sensor is unloaded and still.
    pub fn unloaded_values(&self) -> Option<UnloadedValues> {
        let (unloaded, noise) = self.unloaded?;
        // After a load was recorded it is still on, and a light one hardly moves the readings.
        if self.phase != GuidePhase::Hang {
            return None;
        }
        let (means, scatter, step) = self.statistics();
        let readings: [f64; CHANNELS] =
            std::array::from_fn(|c| (means[c] - unloaded[c]) / length(&self.excursion));
        let is_still = |c: usize| scatter[c].max(step[c]) <= QUIET * noise[c];
        let is_near = length(&readings) <= OFF_SHARE;
        if !is_near || !(0..CHANNELS).all(is_still) {
            return None;
        }
        // The wrench may come later than the readings.
        let wrench = self.mean_wrench(self.time_block.len() / 2)?;
        Some(UnloadedValues { readings, wrench })
    }

    fn continue_pose(&mut self, time_s: f64, index: i64) -> Option<FrameLabel> {
        let (since_s, from) = self.still_since?;
        if time_s - since_s < STILL_S {
            return None;
        }
        let group = self.loads[self.next].group.clone();
        self.recorded[self.next] = true;
        let (size, (means, ..)) = (self.size(self.next), self.statistics());
        if let (Some((unloaded, _)), true) = (self.unloaded, size > 0.0) {
            let response = length(&std::array::from_fn(|c| means[c] - unloaded[c])) / size;
            self.response = Some(self.response.map_or(response, |least| least.min(response)));
        }
        self.still_since = None;
        self.skip();
        if self.phase != GuidePhase::Done {
            self.phase = GuidePhase::Release;
        }
        Some(FrameLabel { from, until: index, group })
    }

    fn await_load(&mut self, is_done: bool) {
        self.phase = match self.unloaded {
            _ if is_done => GuidePhase::Done,
            None => GuidePhase::Unloaded,
            Some(_) => GuidePhase::Hang,
        };
        self.still_since = None;
    }

    /// Returns mean and scatter of each channel, and the distance between the means of the block's halves.
    fn statistics(&self) -> ([f64; CHANNELS], [f64; CHANNELS], [f64; CHANNELS]) {
        let mean = |rows: std::ops::Range<usize>| -> [f64; CHANNELS] {
            let count = rows.len().max(1) as f64;
            let sum = |c: usize| {
                self.time_block.range(rows.clone()).map(|(_, values)| values[c]).sum::<f64>()
            };
            std::array::from_fn(|c| sum(c) / count)
        };
        let (rows, half) = (self.time_block.len(), self.time_block.len() / 2);
        let (means, first, second) = (mean(0..rows), mean(0..half), mean(half..rows));
        let square = |c: usize| -> f64 {
            self.time_block.iter().map(|(_, values)| (values[c] - means[c]).powi(2)).sum()
        };
        let scatter = std::array::from_fn(|c| (square(c) / (rows - 1).max(1) as f64).sqrt());
        (means, scatter, std::array::from_fn(|c| (second[c] - first[c]).abs()))
    }

    fn mean_wrench(&self, from: usize) -> Option<PerAxis<f64>> {
        let wrenches = self.time_block.range(from..).filter_map(|(row, _)| row.wrench);
        let (sum, count) = wrenches.fold(([0.0; 6], 0.0), |(sum, count), wrench| {
            (std::array::from_fn(|axis| sum[axis] + wrench[axis]), count + 1.0)
        });
        (count > 0.0).then(|| sum.map(|sum: f64| sum / count))
    }

    fn size(&self, load: usize) -> f64 {
        let largest =
            |axis: usize| self.loads.iter().map(|load| load.wrench[axis].abs()).fold(0.0, f64::max);
        let share = |axis: usize| match largest(axis) {
            largest if largest > 0.0 => self.loads[load].wrench[axis].abs() / largest,
            _ => 0.0,
        };
        (0..6).map(share).fold(0.0, f64::max)
    }

    fn is_loaded(&self, off: &[f64; CHANNELS], noise: &[f64; CHANNELS]) -> bool {
        let planned = self.loads[self.next].wrench;
        let is_wanted_empty = planned.iter().all(|value| *value == 0.0);
        if let Some(wrench) = self.mean_wrench(0).filter(|_| !is_wanted_empty) {
            let loads = |axis: usize| self.loads.iter().map(move |load| load.wrench[axis].abs());
            let largest: PerAxis<f64> = std::array::from_fn(|axis| loads(axis).fold(0.0, f64::max));
            let distance = |from: &PerAxis<f64>| -> f64 {
                let of = |axis: usize| match largest[axis] > 0.0 {
                    true => ((wrench[axis] - from[axis]) / largest[axis]).powi(2),
                    false => 0.0,
                };
                (0..6).map(of).sum()
            };
            return distance(&planned) < distance(&[0.0; 6]);
        }
        let is_off = (0..CHANNELS)
            .any(|c| off[c] > (OFF_NOISE * noise[c]).max(OFF_SHARE * self.excursion[c]));
        // A remainder from springs after the previous load is far less than the next prediction.
        let least =
            self.response.map_or(0.0, |response| OFF_LOAD * response * self.size(self.next));
        is_off && length(off) > least || is_wanted_empty
    }
}

impl LoadGuide for Guide {
    fn push(&mut self, row: &LiveRow) -> Option<FrameLabel> {
        let values = match (row.readings, row.wrench) {
            (Some(readings), _) => readings,
            (None, Some(wrench)) => std::array::from_fn(|at| wrench.get(at).map_or(0.0, |x| *x)),
            (None, None) => return None,
        };
        let LiveRow { time_s, index, .. } = *row;
        // A restarted board begins a new recording.
        if self.time_block.back().is_some_and(|(last, _)| time_s < last.time_s) {
            self.time_block.clear();
            self.still_since = None;
        }
        self.time_block.push_back((*row, values));
        while self
            .time_block
            .get(1)
            .is_some_and(|(second, _)| time_s - second.time_s >= TIME_BLOCK_S)
        {
            self.time_block.pop_front();
        }
        let (first, _) = *self.time_block.front()?;
        if time_s - first.time_s < TIME_BLOCK_S {
            return None;
        }
        let (means, scatter, step) = self.statistics();
        let Some((unloaded, noise)) = self.unloaded else {
            let least = if row.readings.is_some() { LEAST_NOISE } else { LEAST_FORCE_NOISE };
            self.unloaded = Some((means, scatter.map(|noise| noise.max(least))));
            self.phase = GuidePhase::Hang;
            return None;
        };
        let is_still =
            (0..CHANNELS).all(|c| scatter[c] <= QUIET * noise[c] && step[c] <= QUIET * noise[c]);
        if !is_still {
            self.still_since = None;
            if self.phase != GuidePhase::Done {
                self.phase = GuidePhase::Hang;
            }
            return None;
        }
        let off: [f64; CHANNELS] = std::array::from_fn(|c| (means[c] - unloaded[c]).abs());
        (0..CHANNELS).for_each(|c| self.excursion[c] = self.excursion[c].max(off[c]));
        match self.phase {
            GuidePhase::Hang if self.is_loaded(&off, &noise) => {
                self.phase = GuidePhase::Hold;
                // The first half may hold the end of the movement.
                let (middle, _) = self.time_block[self.time_block.len() / 2];
                self.still_since = Some((middle.time_s, middle.index));
                None
            }
            GuidePhase::Hold => self.continue_pose(time_s, index),
            _ => None,
        }
    }

    fn first_unsettled(&self) -> Option<i64> {
        let is_done = self.phase == GuidePhase::Done;
        let first = if is_done { self.time_block.back() } else { self.time_block.front() };
        self.still_since.map(|(_, index)| index).or(first.map(|(row, _)| row.index))
    }

    fn skip(&mut self) {
        let position = |steps: usize| (self.next + steps) % self.loads.len();
        let mut others = (1..=self.loads.len()).map(position);
        let left = others.find(|&at| !self.recorded[at]);
        self.next = left.unwrap_or(self.next);
        self.await_load(left.is_none());
    }

    fn back(&mut self) {
        let count = self.loads.len().max(1);
        self.next = (self.next + count - 1) % count;
        self.await_load(false);
    }

    fn view(&self) -> GuideView {
        let next = self.loads.get(self.next).filter(|_| self.phase != GuidePhase::Done);
        let newest_s = self.time_block.back().map_or(0.0, |(newest, _)| newest.time_s);
        let held = self.still_since.map_or(0.0, |(since_s, _)| (newest_s - since_s) / STILL_S);
        let whole: f64 = self.loads.iter().map(|load| load.gain).sum();
        let left = self.loads.iter().zip(&self.recorded).filter(|(_, is_recorded)| !**is_recorded);
        let left: f64 = left.map(|(load, _)| load.gain).sum();
        let recorded = self.recorded.iter().filter(|is_recorded| **is_recorded).count();
        let unrecorded = 1.0 - recorded as f64 / self.loads.len().max(1) as f64;
        GuideView {
            group: next.map(|load| load.group.clone()).unwrap_or_default(),
            text: next.map(|load| load.text.clone()).unwrap_or_default(),
            wrench: next.map_or([0.0; 6], |load| load.wrench),
            number: self.next + 1,
            count: self.loads.len(),
            recorded,
            phase: self.phase,
            held: if self.phase == GuidePhase::Hold { held.clamp(0.0, 1.0) } else { 0.0 },
            // Without gains, loads are counted instead.
            remaining_gain: Some(if whole > 0.0 { left / whole } else { unrecorded }),
            ..GuideView::default()
        }
    }
}

fn length(off: &[f64; CHANNELS]) -> f64 {
    off.iter().map(|off| off * off).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guide(gains: [f64; 3]) -> Guide {
        let load = |(at, gain): (usize, f64)| GuidedLoad {
            group: ["a", "b", "c"][at].to_owned(),
            text: format!("load {at}"),
            wrench: [[1.0, 0.0, -2.0][at], 0.0, 0.0, 0.0, 0.0, 0.0],
            gain,
        };
        Guide::new(gains.into_iter().enumerate().map(load).collect())
    }

    struct Bench {
        index: i64,
        found: Vec<FrameLabel>,
    }

    impl Bench {
        /// Applies a force for a time. With `forces`, a calibration measures it.
        fn apply(&mut self, guide: &mut Guide, fx: f64, seconds: f64, forces: bool) {
            for _ in 0..(100.0 * seconds) as usize {
                let noise = f64::from([3, -1, 0, -3, 1, 2, -2][(self.index % 7) as usize]);
                let readings = std::array::from_fn(|c| 2000.0 + 100.0 * fx * c as f64 + noise);
                let row = LiveRow {
                    time_s: self.index as f64 / 100.0,
                    index: self.index,
                    readings: Some(readings),
                    wrench: forces.then_some([fx + 0.01 * noise, 0.0, 0.0, 0.0, 0.0, 0.0]),
                    ..LiveRow::default()
                };
                self.found.extend(guide.push(&row));
                self.index += 1;
            }
        }
    }

    fn bench() -> Bench {
        Bench { index: 0, found: Vec::new() }
    }

    #[test]
    fn loads_that_are_held_are_recorded_one_after_the_other() {
        let (mut guide, mut bench) = (guide([4.0, 3.0, 1.0]), bench());
        assert_eq!(guide.view().phase, GuidePhase::Unloaded);
        bench.apply(&mut guide, 0.0, 3.0, true);
        let view = guide.view();
        assert_eq!((view.phase, view.number, view.count), (GuidePhase::Hang, 1, 3));
        assert_eq!((view.group.as_str(), view.remaining_gain), ("a", Some(1.0)));
        bench.apply(&mut guide, 1.02, 2.0, true);
        assert_eq!(guide.view().phase, GuidePhase::Hold);
        assert!(guide.view().held > 0.4, "{:?}", guide.view());
        bench.apply(&mut guide, 1.02, 1.2, true);
        let view = guide.view();
        // 2 s from the middle of the first still second, which may begin with a movement's end.
        assert_eq!(bench.found, [FrameLabel { from: 350, until: 550, group: "a".to_owned() }]);
        assert_eq!((view.phase, view.number, view.recorded), (GuidePhase::Release, 2, 1));
        assert!((view.remaining_gain.unwrap() - 0.5).abs() < 1e-12);
        // The load stays on, and is not recorded again. The second load is zero.
        bench.apply(&mut guide, 1.02, 3.0, true);
        assert_eq!(bench.found.len(), 1);
        bench.apply(&mut guide, 0.0, 4.0, true);
        assert_eq!(bench.found[1].group, "b");
        bench.apply(&mut guide, -1.9, 4.0, true);
        assert_eq!(guide.view().phase, GuidePhase::Done);
        assert_eq!((bench.found.len(), guide.view().remaining_gain), (3, Some(0.0)));
        assert_eq!(guide.view().group, "");
    }

    #[test]
    fn a_light_load_that_is_still_on_is_not_unloaded() {
        let load = |fx: f64| GuidedLoad {
            group: fx.to_string(),
            text: String::new(),
            wrench: [fx, 0.0, 0.0, 0.0, 0.0, 0.0],
            gain: 1.0,
        };
        let mut guide = Guide::new([-2.0, 0.15, 1.0].map(load).to_vec());
        let mut bench = bench();
        // Before the first load the excursion of the readings is unknown.
        for (fx, is_known) in [(-2.0, false), (0.15, true)] {
            bench.apply(&mut guide, 0.0, 3.0, true);
            assert_eq!(guide.unloaded_values().is_some(), is_known);
            bench.apply(&mut guide, fx, 5.0, true);
            assert_eq!((guide.phase(), guide.unloaded_values()), (GuidePhase::Release, None));
        }
        assert_eq!(bench.found.len(), 2);
    }

    #[test]
    fn without_a_calibration_a_load_is_a_change_from_the_unloaded_readings() {
        let (mut guide, mut bench) = (guide([0.0; 3]), bench());
        bench.apply(&mut guide, 0.0, 2.0, false);
        bench.apply(&mut guide, 1.0, 4.0, false);
        assert_eq!(bench.found.len(), 1);
        assert!((guide.view().remaining_gain.unwrap() - 2.0 / 3.0).abs() < 1e-12);
        guide.skip();
        assert_eq!(guide.view().group, "c");
        // Nearly unloaded, and with a large remainder in the springs: not loaded.
        for kept in [0.05, 0.3] {
            bench.apply(&mut guide, kept, 4.0, false);
            assert_eq!(bench.found.len(), 1);
        }
        bench.apply(&mut guide, -2.0, 4.0, false);
        assert_eq!(bench.found.len(), 2);
        assert_eq!(guide.view().group, "b", "the one that was skipped comes back");
        guide.back();
        assert_eq!(guide.view().group, "a");
    }

    #[test]
    fn another_load_than_the_planned_one_and_one_that_moves_are_not_recorded() {
        let (mut guide, mut bench) = (guide([1.0; 3]), bench());
        bench.apply(&mut guide, 0.0, 2.0, true);
        bench.apply(&mut guide, -1.0, 5.0, true);
        for step in 0..100 {
            bench.apply(&mut guide, 1.0 + 0.02 * f64::from(step), 0.1, true);
        }
        assert_eq!(bench.found, []);
        bench.apply(&mut guide, 1.2, 4.0, true);
        assert_eq!(bench.found.len(), 1);
    }
}
