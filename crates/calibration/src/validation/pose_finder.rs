//! Groups in a recording without named ones: poses, which are rows of constant load, or rows between
//! jumps of its clock.
//!
//! A row continues a pose if every axis is within a [step](Steps) of the pose's mean. Rows that leave a pose start
//! another one as soon as [`FEWEST_ROWS`] of them agree; if the load returns before, they remain in the pose. Rows
//! between two poses belong to the first. Neighbouring poses are merged if they differ by less than [`SAME_POSE`] of
//! the range of every axis. A clock that restarts ends a pose.
//!
//! A pose is steady, not in motion, if it has [`FEWEST_ROWS`] and a line through its rows rises by no more than half a
//! step, or twice [`SAME_POSE`] of the range. A recording consists of poses if [`FEWEST_POSES`] are steady, these hold
//! [`STEADY_SHARE`] of the rows, and the variance within them is at most [`WITHIN_SHARE`] of that of the loads.
//! Memory grows with the number of poses only.

use shell_data::statistics::{MergeWeights, extremes};

use least_squares::grouped_rows::MAX_GROUPS;

/// Fewest consecutive rows of a pose.
pub const FEWEST_ROWS: u64 = 5;

/// Fewest steady poses of a recording that consists of poses.
pub const FEWEST_POSES: usize = 3;

/// Least share of rows on steady poses.
pub const STEADY_SHARE: f64 = 0.8;

/// Largest share of the variance within poses, over the axes that are loaded.
pub const WITHIN_SHARE: f64 = 0.05;

/// Consecutive poses are merged if they differ by less than this share of the range on every axis.
pub const SAME_POSE: f64 = 0.01;

/// A step is the largest of: this many standard deviations of the noise, this many times the difference that 85 % of
/// consecutive rows keep within, and half of [`SAME_POSE`] of the range. A reference that flickers by its last digit
/// makes no step.
const STEP_IN_NOISE: f64 = 8.0;
const STEP_IN_FLICKER: f64 = 4.0;
const FLICKER_SHARE: f64 = 0.85;

/// A clock jumps if it goes back by this many median intervals, or forward by this many and at least a second.
const BACK_IN_INTERVALS: f64 = 10.0;
const FORWARD_IN_INTERVALS: f64 = 100.0;
const FORWARD_S: f64 = 1.0;

/// Steady rows are slow motion, not a pose, if a usual pose has more than this many times as many.
const SHORT: u64 = 4;

/// Limits for a step of the load and for a jump of the clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Steps<const N: usize> {
    load: [f64; N],
    interval_s: f64,
}

impl<const N: usize> Steps<N> {
    /// Derives the limits from rows of all parts of a recording, most of them consecutive.
    pub fn from_sample(time_s: &[f64], wrench: &[Vec<f64>]) -> Self {
        let load = std::array::from_fn(|axis| {
            let column = wrench.get(axis).map_or(&[][..], Vec::as_slice);
            let mut sizes = differences(column);
            sizes.iter_mut().for_each(|size| *size = size.abs());
            // The median of |x₁ − x₂| is 0.6745·√2 standard deviations of x.
            let noise = quantile(&mut sizes, 0.5) / (0.674_489_75 * std::f64::consts::SQRT_2);
            let flicker = quantile(&mut sizes, FLICKER_SHARE);
            // Excludes the extremes, because a stray row is not part of the range.
            let mut loads = column.to_vec();
            let range = quantile(&mut loads, 0.99) - quantile(&mut loads, 0.01);
            (STEP_IN_NOISE * noise).max(STEP_IN_FLICKER * flicker).max(0.5 * SAME_POSE * range)
        });
        let mut intervals = differences(time_s);
        intervals.retain(|&interval| interval > 0.0);
        Self { load, interval_s: quantile(&mut intervals, 0.5) }
    }

    fn is_within(&self, mean: &[f64; N], load: &[f64; N]) -> bool {
        (0..N).all(|axis| (load[axis] - mean[axis]).abs() <= self.load[axis])
    }

    fn starts_anew(&self, before_s: f64, now_s: f64) -> bool {
        before_s - now_s > BACK_IN_INTERVALS * self.interval_s
    }

    fn jumps(&self, before_s: f64, now_s: f64) -> bool {
        let forward = (FORWARD_IN_INTERVALS * self.interval_s).max(FORWARD_S);
        self.starts_anew(before_s, now_s) || now_s - before_s > forward
    }
}

fn differences(values: &[f64]) -> Vec<f64> {
    values.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

/// Value that a share of `values` does not exceed; 0 for no values.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return 0.0 };
    let at = (share * last as f64) as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

#[derive(Clone, Debug, PartialEq)]
pub enum GroupLengths {
    /// Numbers of rows of each pose.
    Poses(Vec<u64>),
    /// Numbers of rows between jumps of the clock.
    Recordings(Vec<u64>),
    Nothing,
}

/// Consecutive rows with about the same load, which may still rise in slow motion.
#[derive(Clone, Copy, Debug)]
pub struct FoundPose<const N: usize> {
    pub start: u64,
    /// Number of rows that agree.
    pub rows: u64,
    pub mean: [f64; N],
    squares: [f64; N],
    /// Mean position of the rows, sum of squared distances from it, and sums of their products with the loads.
    position: f64,
    place_squares: f64,
    products: [f64; N],
    /// True if the pose begins because the clock restarted.
    is_parted: bool,
}

impl<const N: usize> FoundPose<N> {
    fn new(start: u64, load: &[f64; N], is_parted: bool) -> Self {
        Self {
            start,
            rows: 1,
            mean: *load,
            squares: [0.0; N],
            position: start as f64,
            place_squares: 0.0,
            products: [0.0; N],
            is_parted,
        }
    }

    fn merge(&mut self, next: &Self) {
        let MergeWeights { mean: share, product: weight } = MergeWeights::new(self.rows, next.rows);
        let away = next.position - self.position;
        for axis in 0..N {
            let apart = next.mean[axis] - self.mean[axis];
            self.mean[axis] += apart * share;
            self.squares[axis] += next.squares[axis] + apart * apart * weight;
            self.products[axis] += next.products[axis] + apart * away * weight;
        }
        self.position += away * share;
        self.place_squares += next.place_squares + away * away * weight;
        self.rows += next.rows;
    }

    fn rise(&self, axis: usize) -> f64 {
        match self.place_squares > 0.0 {
            true => (self.products[axis] / self.place_squares * self.rows as f64).abs(),
            false => 0.0,
        }
    }
}

#[derive(Clone, Debug)]
pub struct PoseFinder<const N: usize = 6> {
    steps: Steps<N>,
    rows: u64,
    last_s: Option<f64>,
    poses: Vec<FoundPose<N>>,
    /// Rows that have left the last pose and agree so far.
    leaving: Option<FoundPose<N>>,
    jumps: Vec<u64>,
}

impl<const N: usize> PoseFinder<N> {
    pub fn new(steps: Steps<N>) -> Self {
        let (poses, jumps) = (Vec::new(), Vec::new());
        Self { steps, rows: 0, last_s: None, poses, leaving: None, jumps }
    }

    /// Adds the next rows: their times, empty without a clock, and the columns of their wrench.
    pub fn add(&mut self, time_s: &[f64], wrench: &[Vec<f64>]) {
        let rows = wrench.first().map_or(0, Vec::len);
        let times = time_s.iter().copied().map(Some).chain(std::iter::repeat(None));
        for (row, now_s) in (0..rows).zip(times) {
            let load = std::array::from_fn(|axis| wrench.get(axis).map_or(0.0, |of| of[row]));
            self.add_row(now_s, &load);
        }
    }

    fn add_row(&mut self, now_s: Option<f64>, load: &[f64; N]) {
        let row = self.rows;
        self.rows += 1;
        let before_s = std::mem::replace(&mut self.last_s, now_s);
        let times = before_s.zip(now_s);
        let starts_anew = times.is_some_and(|(before, now)| self.steps.starts_anew(before, now));
        let jumps = times.is_some_and(|(before, now)| self.steps.jumps(before, now));
        // Stores about as many jumps as groups are allowed; more are useless.
        if jumps && self.jumps.len() <= MAX_GROUPS {
            self.jumps.push(row);
        }
        let Some(pose) = self.poses.last_mut().filter(|_| !starts_anew) else {
            self.leaving = None;
            return self.begin(FoundPose::new(row, load, true));
        };
        if self.steps.is_within(&pose.mean, load) {
            self.leaving = None;
            return pose.merge(&FoundPose::new(row, load, false));
        }
        match &mut self.leaving {
            Some(next) if self.steps.is_within(&next.mean, load) => {
                next.merge(&FoundPose::new(row, load, false));
                if next.rows >= FEWEST_ROWS {
                    let next = *next;
                    self.leaving = None;
                    self.begin(next);
                }
            }
            leaving => *leaving = Some(FoundPose::new(row, load, false)),
        }
    }

    fn begin(&mut self, pose: FoundPose<N>) {
        // Replaces the last pose if there are too many to be of use: memory stays bounded.
        if self.poses.len() > 8 * MAX_GROUPS {
            self.poses.pop();
        }
        self.poses.push(pose);
    }

    pub fn finish(self) -> GroupLengths {
        if let Some(poses) = self.pose_lengths() {
            return GroupLengths::Poses(poses);
        }
        let rows = lengths(std::iter::once(0).chain(self.jumps.iter().copied()), self.rows);
        let is_long = |rows: &Vec<u64>| self.rows >= FEWEST_ROWS * rows.len() as u64;
        match (2..=MAX_GROUPS).contains(&rows.len()) && is_long(&rows) {
            true => GroupLengths::Recordings(rows),
            false => GroupLengths::Nothing,
        }
    }

    fn ranges(&self) -> [f64; N] {
        std::array::from_fn(|axis| {
            let (low, high) = extremes(self.poses.iter().map(|pose| pose.mean[axis]));
            high - low
        })
    }

    /// Poses, after a merge of neighbours that are closer than a share of the range.
    fn merged(&self, ranges: &[f64; N], same: f64) -> Vec<FoundPose<N>> {
        let is_same = |a: &FoundPose<N>, b: &FoundPose<N>| {
            (0..N).all(|axis| (a.mean[axis] - b.mean[axis]).abs() <= same * ranges[axis])
        };
        let mut poses: Vec<FoundPose<N>> = Vec::new();
        for pose in &self.poses {
            match poses.last_mut() {
                Some(last) if !pose.is_parted && is_same(last, pose) => last.merge(pose),
                _ => poses.push(*pose),
            }
        }
        poses
    }

    fn is_steady(&self, pose: &FoundPose<N>, ranges: &[f64; N], same: f64) -> bool {
        let may_rise = |axis: usize| (0.5 * self.steps.load[axis]).max(2.0 * same * ranges[axis]);
        pose.rows >= FEWEST_ROWS && (0..N).all(|axis| pose.rise(axis) <= may_rise(axis))
    }

    /// Steady poses that are long compared with the others, without rows in transition.
    /// Merges neighbours that are closer than the share `same` of the range.
    pub fn steady_poses(&self, same: f64) -> Vec<FoundPose<N>> {
        let ranges = self.ranges();
        let mut poses = self.merged(&ranges, same);
        poses.retain(|pose| self.is_steady(pose, &ranges, same));
        // Half the rows are in poses at least as long as this.
        let mut lengths: Vec<u64> = poses.iter().map(|pose| pose.rows).collect();
        lengths.sort_unstable();
        let (half, mut sum) = (lengths.iter().sum::<u64>() / 2, 0);
        let usual = lengths.into_iter().find(|rows| {
            sum += rows;
            sum > half
        });
        poses.retain(|pose| SHORT * pose.rows >= usual.unwrap_or(0));
        poses
    }

    /// Number of rows of each pose, if the recording consists of poses.
    fn pose_lengths(&self) -> Option<Vec<u64>> {
        let ranges = self.ranges();
        let poses = self.merged(&ranges, SAME_POSE);
        let steady: Vec<&FoundPose<N>> =
            poses.iter().filter(|pose| self.is_steady(pose, &ranges, SAME_POSE)).collect();
        let (first, others) = steady.split_first()?;
        let mut all = **first;
        others.iter().for_each(|pose| all.merge(pose));
        let loaded: Vec<usize> =
            (0..N).filter(|&axis| ranges[axis] > 2.0 * self.steps.load[axis]).collect();
        let within = |axis: &usize| {
            steady.iter().map(|pose| pose.squares[*axis]).sum::<f64>() / all.squares[*axis]
        };
        let share = loaded.iter().map(within).sum::<f64>() / loaded.len() as f64;
        let is_made_of_them = steady.len() >= FEWEST_POSES
            && poses.len() <= MAX_GROUPS
            && all.rows as f64 >= STEADY_SHARE * self.rows as f64
            && share <= WITHIN_SHARE;
        is_made_of_them.then(|| lengths(poses.iter().map(|pose| pose.start), self.rows))
    }
}

/// Number of rows from each of `starts` to the next, and from the last to `end`.
fn lengths(starts: impl Iterator<Item = u64>, end: u64) -> Vec<u64> {
    let starts: Vec<u64> = starts.chain([end]).collect();
    starts.windows(2).map(|pair| pair[1] - pair[0]).collect()
}

#[cfg(test)]
mod tests {
    use system_tests::random::Random;

    use shell_data::wrench::PerAxis;

    use super::*;

    fn uniform(random: &mut Random) -> f64 {
        2.0 * random.unit() - 1.0
    }

    /// Six axes, each load held for the given number of rows; 100 rows a second.
    fn held(rows: &[usize], noise: f64) -> (Vec<f64>, Vec<Vec<f64>>) {
        let mut random = Random(7);
        let mut wrench = vec![Vec::new(); 6];
        for &rows in rows {
            let load: PerAxis<f64> = std::array::from_fn(|_| uniform(&mut random));
            for _ in 0..rows {
                for (column, load) in wrench.iter_mut().zip(load) {
                    column.push(load + noise * uniform(&mut random));
                }
            }
        }
        let time = (0..wrench[0].len()).map(|row| row as f64 * 0.01).collect();
        (time, wrench)
    }

    fn found(time_s: &[f64], wrench: &[Vec<f64>], parts: usize) -> GroupLengths {
        let mut finder = PoseFinder::<6>::new(Steps::from_sample(time_s, wrench));
        for start in (0..wrench[0].len()).step_by(parts) {
            let end = (start + parts).min(wrench[0].len());
            let part: Vec<Vec<f64>> = wrench.iter().map(|c| c[start..end].to_vec()).collect();
            finder.add(time_s.get(start..end).unwrap_or_default(), &part);
        }
        finder.finish()
    }

    const ROWS: [usize; 8] = [40, 25, 60, 31, 5, 77, 20, 100];

    fn lengths_of(rows: &[usize]) -> Vec<u64> {
        rows.iter().map(|&rows| rows as u64).collect()
    }

    #[test]
    fn every_pose_is_found_to_the_row_with_and_without_noise_in_any_parts() {
        for noise in [0.0, 0.02] {
            let (time, wrench) = held(&ROWS, noise);
            for parts in [1, 7, 1000] {
                let expected = GroupLengths::Poses(lengths_of(&ROWS));
                assert_eq!(found(&time, &wrench, parts), expected, "noise {noise}");
                assert_eq!(found(&[], &wrench, parts), expected);
            }
        }
    }

    #[test]
    fn strays_and_rows_on_the_way_to_the_next_load_end_no_pose() {
        let (time, mut wrench) = held(&ROWS, 0.01);
        wrench[2][10] = 40.0;
        (150..153).for_each(|row| wrench[0][row] -= 3.0);
        // A row in transition from the first load to the second.
        let ends: Vec<[f64; 2]> = wrench.iter().map(|c| [c[38], c[42]]).collect();
        for (column, [from, to]) in wrench.iter_mut().zip(ends) {
            column[40] = 0.5 * (from + to);
        }
        let mut expected = lengths_of(&ROWS);
        (expected[0], expected[1]) = (41, 24);
        assert_eq!(found(&time, &wrench, 1000), GroupLengths::Poses(expected));
    }

    #[test]
    fn a_flicker_of_the_last_digit_and_equal_loads_in_succession_part_no_pose() {
        let (time, mut wrench) = held(&ROWS, 0.0);
        let mut random = Random(3);
        for row in 0..wrench[0].len() {
            if uniform(&mut random) > 0.8 {
                wrench[4][row] += 0.001;
            }
        }
        assert_eq!(found(&time, &wrench, 50), GroupLengths::Poses(lengths_of(&ROWS)));
        // The third load equals the second.
        for column in &mut wrench {
            let load = column[50];
            column[65..125].fill(load);
        }
        let mut expected = lengths_of(&ROWS);
        expected.splice(1..3, [85]);
        assert_eq!(found(&time, &wrench, 50), GroupLengths::Poses(expected));
    }

    #[test]
    fn a_clock_that_restarts_parts_equal_loads() {
        let (mut time, wrench) = held(&[50], 0.0);
        let wrench: Vec<Vec<f64>> = wrench.iter().map(|c| c.repeat(3)).collect();
        time = time.repeat(3);
        // A single load does not define poses: these are recordings.
        assert_eq!(found(&time, &wrench, 20), GroupLengths::Recordings(vec![50; 3]));
        let (_, others) = held(&[50, 50, 50], 0.0);
        let both: Vec<Vec<f64>> =
            wrench.iter().zip(&others).map(|(a, b)| [&a[..100], b].concat()).collect();
        let time = [&time[..100], &held(&[150], 0.0).0].concat();
        assert_eq!(found(&time, &both, 20), GroupLengths::Poses(vec![50; 5]));
    }

    #[test]
    fn motion_and_noise_are_no_poses() {
        let motion = |row: usize, axis: usize| (0.013 * (axis + 1) as f64 * row as f64).sin();
        let wrench: Vec<Vec<f64>> =
            (0..6).map(|axis| (0..5000).map(|row| motion(row, axis)).collect()).collect();
        let time: Vec<f64> = (0..5000).map(|row| row as f64 * 0.001).collect();
        assert_eq!(found(&time, &wrench, 999), GroupLengths::Nothing);
        let (_, noise) = held(&[2000], 1.0);
        assert_eq!(found(&[], &noise, 999), GroupLengths::Nothing);
        assert_eq!(found(&[], &vec![vec![1.5; 300]; 6], 999), GroupLengths::Nothing);
        assert_eq!(
            PoseFinder::<6>::new(Steps::from_sample(&[], &[])).finish(),
            GroupLengths::Nothing
        );
        // Repeats the motion with two pauses of the recorder.
        let pause = |row: usize| row as f64 * 0.001 + 5.0 * (row / 2000) as f64;
        let time: Vec<f64> = (0..5000).map(pause).collect();
        assert_eq!(found(&time, &wrench, 999), GroupLengths::Recordings(vec![2000, 2000, 1000]));
    }
}
