//! Replay of a recorded session: comparison of its poses in random and in planned orders.
//!
//! ```text
//! poses → some held out ─┬─ the first few, at random ─▶ the next by an order ─▶ model ─▶ error on those held out
//!                        └───────────────────────────────▲──────────────────────┘
//! ```
//!
//! Every order begins with the same poses and ends with all of them. The error is from the physics model, with new
//! priors each time, relative to the root mean square of the loads, averaged in squares over axes and poses.

use std::collections::BTreeMap;
use std::num::NonZeroU64;

use super::planner::{Order, Planner, SensorKnowledge};
use least_squares::error::FitError;
use least_squares::passes::{Workers, map_folds};
use sensor_physics::response::PARAMETERS;
use sensor_physics::{Choice, Inversion, Observation, PhysicsModel, wrench_scale};
use shell_data::random::{Purpose, RandomStream};
use shell_data::wrench::PerAxis;

/// The model is refitted after every pose at first, and after `n/16` more poses from `n` poses on.
const STEP_SHARE: usize = 16;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReplayOptions {
    pub held_out: usize,
    /// Random poses at the beginning of every order.
    pub start: usize,
    pub seed: u64,
    /// Number of random splits into training and held-out poses.
    pub splits: NonZeroU64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Replay {
    pub poses: Vec<usize>,
    /// Mean over the splits of the relative error, for each of [`Order::ALL`].
    pub errors: [Vec<f64>; 4],
}

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    #[error(
        "`{found}` poses are too few: with `{held_out}` held out at least `{needed}` are needed"
    )]
    TooFewPoses {
        found: usize,
        held_out: usize,
        /// Fewest poses that suffice.
        needed: usize,
    },
    #[error(transparent)]
    Fit(#[from] FitError),
}

type ReplayPose<'a> = Vec<&'a Observation>;

impl Replay {
    /// Replays `observations` in every order, split by split, with any number of threads.
    ///
    /// # Errors
    /// [`ReplayError`] if the poses outside the held-out set do not determine a model.
    pub fn new(
        observations: &[Observation],
        options: ReplayOptions,
        workers: Workers<'_>,
    ) -> Result<Self, ReplayError> {
        let (all, held_out) = (poses(observations), options.held_out);
        let (found, needed) = (all.len(), PARAMETERS + held_out + 1);
        if found < needed {
            return Err(ReplayError::TooFewPoses { found, held_out, needed });
        }
        let training = found - held_out;
        let start = options.start.clamp(1, training);
        let first = start.max(PARAMETERS);
        let steps = std::iter::successors(Some(first), |&n| Some(n + (n / STEP_SHARE).max(1)));
        let mut poses: Vec<usize> = steps.take_while(|&n| n < training).collect();
        poses.push(training);
        let scale = wrench_scale(&observations.iter().collect::<Vec<_>>());
        let replayed = |&split: &u64| -> Result<[Vec<f64>; 4], FitError> {
            let mut shuffled = all.clone();
            shuffle(&mut shuffled, &mut RandomStream::new(options.seed, Purpose::Replay, split));
            let (held_out, training) = shuffled.split_at(held_out);
            let replay = SplitReplay { training, held_out, scale };
            let [random, design, gain, variance] =
                Order::ALL.map(|order| replay.errors(order, start, &poses));
            Ok([random?, design?, gain?, variance?])
        };
        let splits: Vec<u64> = (0..options.splits.get()).collect();
        let splits = map_folds(&splits, workers, replayed)?;
        let mean = |order: usize, at: usize| {
            splits.iter().map(|errors| errors[order][at]).sum::<f64>() / splits.len() as f64
        };
        let errors =
            std::array::from_fn(|order| (0..poses.len()).map(|at| mean(order, at)).collect());
        Ok(Self { poses, errors })
    }

    /// Number of poses from which on the error of an order exceeds that with all poses by `share` at most, e.g. 0.15.
    pub fn poses_within(&self, order: Order, share: f64) -> usize {
        let limit = (1.0 + share) * self.errors[0].last().copied().unwrap_or(f64::NAN);
        let errors = &self.errors[order as usize];
        let beyond = errors.iter().rposition(|&error| error > limit);
        self.poses[beyond.map_or(0, |at| (at + 1).min(self.poses.len() - 1))]
    }
}

struct SplitReplay<'a> {
    training: &'a [ReplayPose<'a>],
    held_out: &'a [ReplayPose<'a>],
    scale: PerAxis<f64>,
}

impl SplitReplay<'_> {
    /// Errors with these numbers of poses, in an order that begins with the first `start` poses.
    fn errors(&self, order: Order, start: usize, counts: &[usize]) -> Result<Vec<f64>, FitError> {
        let mut taken: Vec<usize> = (0..start).collect();
        let mut errors = Vec::with_capacity(counts.len());
        let mut model: Option<PhysicsModel> = None;
        for &count in counts {
            let more = count - taken.len();
            let next = self.next(order, &taken, model.as_ref(), more);
            taken.extend(next);
            let observations: Vec<Observation> =
                taken.iter().flat_map(|&at| self.training[at].iter().map(|&o| o.clone())).collect();
            let fitted = Choice::fit(&observations, Workers::ONE)?.model;
            errors.push(self.error(&fitted));
            model = Some(fitted);
        }
        Ok(errors)
    }

    fn next(
        &self,
        order: Order,
        taken: &[usize],
        model: Option<&PhysicsModel>,
        count: usize,
    ) -> Vec<usize> {
        let left: Vec<usize> = (0..self.training.len()).filter(|at| !taken.contains(at)).collect();
        let load = |&at: &usize| mean_load(&self.training[at]);
        let candidates: Vec<PerAxis<f64>> = left.iter().map(load).collect();
        let loads: Vec<PerAxis<f64>> = taken.iter().map(load).collect();
        if order == Order::Random {
            return left.into_iter().take(count).collect();
        }
        let model = model.filter(|_| order != Order::DOptimal);
        let sensors = model.map(SensorKnowledge::from_model);
        let planner = Planner::new(sensors, order, &loads, &candidates);
        planner.take(count).map(|next| left[next.candidate]).collect()
    }

    fn error(&self, model: &PhysicsModel) -> f64 {
        let held_out = self.held_out.concat();
        let squares = Inversion::new(model).squared_errors(&held_out, &self.scale);
        let sum: f64 = squares.iter().map(|square| square / 6.0).sum();
        (sum / held_out.len() as f64).sqrt()
    }
}

fn poses(observations: &[Observation]) -> Vec<ReplayPose<'_>> {
    let mut groups = BTreeMap::<u64, ReplayPose<'_>>::new();
    observations.iter().for_each(|o| groups.entry(o.group).or_default().push(o));
    groups.into_values().collect()
}

fn mean_load(pose: &ReplayPose<'_>) -> PerAxis<f64> {
    let sum = |axis: usize| pose.iter().map(|o| o.wrench[axis]).sum::<f64>();
    std::array::from_fn(|axis| sum(axis) / pose.len() as f64)
}

/// Fisher-Yates shuffle (Knuth, The Art of Computer Programming, vol. 2, §3.4.2, algorithm P).
fn shuffle<T>(values: &mut [T], random: &mut RandomStream) {
    for last in (1..values.len()).rev() {
        let other = (random.uniform() * (last + 1) as f64) as usize;
        values.swap(last, other);
    }
}
