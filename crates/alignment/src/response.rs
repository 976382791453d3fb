//! Features of a wrench, which map linearly to the straightened readings of sensors on springs.
//!
//! Springs respond late: they creep, and friction makes the response depend on the history of the
//! load. Both shift readings by milliseconds in one direction, whatever the clocks do, and bias an
//! alignment without a model of them. The kinds and directions of a sensor's memory are unknown.
//! The features cover several kinds, and [`choice`](super::choice) finds those that the readings
//! need:
//!
//! - *plays* on each axis, `p ← clamp(p, w − r, w + r)`, of several half-widths, which add up to
//!   any rate-independent hysteresis with a convex loop (Prandtl–Ishlinskii; Brokate & Sprekels,
//!   Hysteresis and Phase Transitions, 1996);
//! - *lags* on each axis, `τ ḷ = w − l`: creep;
//! - *quick lags* on each axis, faster than the load: viscous and other friction that depends on
//!   the speed;
//! - plays along the direction that each *channel* senses, as given by the current map;
//! - *joint* plays of all axes, `p ← w + min(1, r / ‖p − w‖) (p − w)`: friction in the direction of
//!   the load (a ball in place of the interval);
//! - products of two axes: effects that a single displacement does not describe.

use faer::MatRef;

/// Half-widths of the plays, as fractions of the largest load in the direction.
const PLAY: [f64; 6] = [0.04, 0.08, 0.14, 0.21, 0.3, 0.42];
const LAGS: [(f64, Family); 6] = [
    (0.15, Family::Lags),
    (0.5, Family::Lags),
    (2.0, Family::Lags),
    (6.0, Family::Lags),
    (0.02, Family::QuickLags),
    (0.06, Family::QuickLags),
];
/// Radii of the joint plays; the largest load on each axis is 1.
const JOINT: [f64; 5] = [0.05, 0.1, 0.2, 0.35, 0.6];
const MEMORIES: usize = PLAY.len() + LAGS.len();

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Family {
    AxisPlays,
    Lags,
    QuickLags,
    ChannelPlays,
    JointPlays,
}

impl Family {
    pub(super) const ALL: [Self; 5] =
        [Self::AxisPlays, Self::Lags, Self::QuickLags, Self::ChannelPlays, Self::JointPlays];
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct MemoryModel {
    axes: usize,
    /// The share of the response to each axis that passes through each of its plays and lags.
    shares: Vec<f64>,
    /// A direction of the scaled wrench for each channel, row by row, scaled so that
    /// the load reaches 1. Empty without plays along channels and joint plays.
    directions: Vec<f64>,
}

impl MemoryModel {
    /// Plays and lags on the axes, with the whole response immediate.
    pub(super) fn on_axes(axes: usize) -> Self {
        Self { axes, shares: vec![0.0; axes * MEMORIES], directions: Vec::new() }
    }

    pub(super) fn most_features(axes: usize, channels: usize) -> usize {
        Self { directions: vec![0.0; channels * axes], ..Self::on_axes(axes) }.features()
    }

    /// Learns shares from the map (features × channels): the coefficients of a play or lag, projected on the total
    /// coefficients of its axis.
    pub(super) fn learn_shares(&mut self, map: MatRef<'_, f64>) {
        let row = |i: usize| (0..map.ncols()).map(move |c| map[(i, c)]);
        self.shares.clear();
        for axis in 0..self.axes {
            let parts = self.memories_of(axis);
            let mut whole: Vec<f64> = row(axis).collect();
            for part in parts.clone() {
                whole.iter_mut().zip(row(part)).for_each(|(sum, x)| *sum += x);
            }
            let square = whole.iter().map(|x| x * x).sum::<f64>().max(1e-300);
            self.shares.extend(parts.map(|part| {
                let product: f64 = row(part).zip(&whole).map(|(x, whole)| x * whole).sum();
                (product / square).clamp(-1.0, 1.0)
            }));
        }
    }

    /// Adds plays along each channel's direction in `map`, and joint plays; `reach` is the largest
    /// load in a direction of the scaled wrench.
    pub(super) fn with_channels(
        mut self,
        map: MatRef<'_, f64>,
        reach: impl Fn(&[f64]) -> f64,
    ) -> Self {
        self.directions.clear();
        for c in 0..map.ncols() {
            let sees = |axis: usize| {
                map[(axis, c)] + self.memories_of(axis).map(|i| map[(i, c)]).sum::<f64>()
            };
            let direction: Vec<f64> = (0..self.axes).map(sees).collect();
            let scale = 1.0 / reach(&direction).max(1e-300);
            self.directions.extend(direction.iter().map(|x| x * scale));
        }
        self
    }

    fn memories_of(&self, axis: usize) -> std::ops::Range<usize> {
        self.axes + axis * MEMORIES..self.axes + (axis + 1) * MEMORIES
    }

    fn products(&self) -> usize {
        self.axes * (self.axes + 1) / 2
    }

    fn channel_plays(&self) -> usize {
        self.directions.len() / self.axes * PLAY.len()
    }

    fn joint_plays(&self) -> usize {
        if self.directions.is_empty() { 0 } else { JOINT.len() * self.axes }
    }

    pub(super) fn features(&self) -> usize {
        self.axes * (1 + MEMORIES) + self.products() + self.channel_plays() + self.joint_plays()
    }

    pub(super) fn families(&self) -> Vec<Option<Family>> {
        let mut families = vec![None; self.axes];
        for _ in 0..self.axes {
            families.extend([Some(Family::AxisPlays); PLAY.len()]);
            families.extend(LAGS.map(|(_, family)| Some(family)));
        }
        families.resize(families.len() + self.products(), None);
        families.resize(families.len() + self.channel_plays(), Some(Family::ChannelPlays));
        families.resize(families.len() + self.joint_plays(), Some(Family::JointPlays));
        families
    }

    /// The delayed part of each feature: the feature minus its immediate value.
    pub(super) fn late(&self, features: &[f64], late: &mut [f64]) {
        let wrench = &features[..self.axes];
        late.fill(0.0);
        for i in 0..self.axes * MEMORIES {
            late[self.axes + i] = features[self.axes + i] - wrench[i / MEMORIES];
        }
        let first = self.axes * (1 + MEMORIES) + self.products();
        for i in 0..self.channel_plays() {
            late[first + i] = features[first + i] - dot(self.direction(i / PLAY.len()), wrench);
        }
        let first = first + self.channel_plays();
        for i in 0..self.joint_plays() {
            late[first + i] = features[first + i] - wrench[i % self.axes];
        }
    }

    fn direction(&self, channel: usize) -> &[f64] {
        &self.directions[channel * self.axes..(channel + 1) * self.axes]
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[derive(Clone, Debug)]
pub(super) struct MemoryResponse {
    model: MemoryModel,
    largest: Vec<f64>,
    retained: [f64; LAGS.len()],
    on_axes: Vec<f64>,
    /// Plays, channel by channel, then joint plays.
    beside: Vec<f64>,
    is_first: bool,
    effective: Vec<f64>,
}

impl MemoryResponse {
    /// `largest` is the size of the load on each axis, `step_s` the time between samples.
    pub(super) fn new(largest: &[f64], step_s: f64, model: MemoryModel) -> Self {
        Self {
            largest: largest.to_vec(),
            retained: LAGS.map(|(lag_s, _)| (-step_s / lag_s).exp()),
            on_axes: vec![0.0; model.axes * MEMORIES],
            beside: vec![0.0; model.channel_plays() + model.joint_plays()],
            is_first: true,
            effective: vec![0.0; model.axes],
            model,
        }
    }

    /// Writes the features of the next sample, all of order 1: the wrench, its plays and lags axis
    /// by axis, the products of the effective responses of the axes, plays channel by channel,
    /// joint plays.
    pub(super) fn next(&mut self, wrench: &[f64], features: &mut [f64]) {
        let (immediate, rest) = features.split_at_mut(self.model.axes);
        let (memories, rest) = rest.split_at_mut(self.on_axes.len());
        let (products, beside) = rest.split_at_mut(self.model.products());
        let scaled = wrench.iter().zip(&self.largest).map(|(w, largest)| w / largest);
        immediate.iter_mut().zip(scaled).for_each(|(feature, w)| *feature = w);
        self.follow_axes(immediate);
        memories.copy_from_slice(&self.on_axes);
        let mut products = products.iter_mut();
        for (i, a) in self.effective.iter().enumerate() {
            // The product comes second: `zip` would lose a product for which no factor is left.
            for (b, product) in self.effective[i..].iter().zip(products.by_ref()) {
                *product = a * b;
            }
        }
        if !beside.is_empty() {
            self.follow_beside(immediate);
            beside.copy_from_slice(&self.beside);
        }
        self.is_first = false;
    }

    fn follow_axes(&mut self, immediate: &[f64]) {
        for (axis, &w) in immediate.iter().enumerate() {
            let state = &mut self.on_axes[axis * MEMORIES..][..MEMORIES];
            if self.is_first {
                state.fill(w);
            }
            let (plays, lags) = state.split_at_mut(PLAY.len());
            follow(plays, w);
            for (lag, retained) in lags.iter_mut().zip(self.retained) {
                *lag = w + retained * (*lag - w);
            }
            let shares = &self.model.shares[axis * MEMORIES..][..MEMORIES];
            let late: f64 = shares.iter().zip(state).map(|(share, m)| share * (*m - w)).sum();
            self.effective[axis] = w + late;
        }
    }

    fn follow_beside(&mut self, immediate: &[f64]) {
        let (channels, joint) = self.beside.split_at_mut(self.model.channel_plays());
        for (channel, plays) in channels.as_chunks_mut::<{ PLAY.len() }>().0.iter_mut().enumerate()
        {
            let w = dot(self.model.direction(channel), immediate);
            if self.is_first {
                plays.fill(w);
            }
            follow(plays, w);
        }
        for (play, radius) in joint.chunks_exact_mut(self.model.axes).zip(JOINT) {
            if self.is_first {
                play.copy_from_slice(immediate);
            }
            let square: f64 = play.iter().zip(immediate).map(|(p, w)| (p - w) * (p - w)).sum();
            let kept = radius / square.sqrt().max(radius);
            play.iter_mut().zip(immediate).for_each(|(p, w)| *p = w + kept * (*p - w));
        }
    }
}

fn follow(plays: &mut [f64], w: f64) {
    for (play, width) in plays.iter_mut().zip(PLAY) {
        // Not `clamp`, which would check the order of its bounds.
        *play = play.max(w - width).min(w + width);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Features of two axes with ranges of 2 and 4.
    fn run(wrench: &[[f64; 2]], model: &MemoryModel) -> Vec<Vec<f64>> {
        let mut response = MemoryResponse::new(&[2.0, 4.0], 0.01, model.clone());
        let mut features = vec![0.0; model.features()];
        let mut next = |w: &[f64; 2]| {
            response.next(w, &mut features);
            features.clone()
        };
        wrench.iter().map(&mut next).collect()
    }

    /// Two axes and one channel, which senses 0.6 of the first and 0.8 of the second.
    fn beside() -> MemoryModel {
        let on_axes = MemoryModel::on_axes(2);
        let mut map = faer::Mat::<f64>::zeros(on_axes.features(), 1);
        (map[(0, 0)], map[(1, 0)]) = (1.2, 1.6);
        on_axes.with_channels(map.as_ref(), |_| 2.0)
    }

    #[test]
    fn features_of_a_load_that_never_changes_are_its_powers() {
        let model = beside();
        let mut late = vec![1.0; model.features()];
        for features in run(&[[1.0, -2.0]; 50], &model) {
            assert_eq!(features[..2], [0.5, -0.5]);
            assert!(features[2..2 + MEMORIES].iter().all(|&x| x == 0.5));
            let products = 2 + 2 * MEMORIES;
            assert_eq!(features[products..products + 3], [0.25, -0.25, 0.25]);
            let channel = &features[products + 3..][..PLAY.len()];
            assert!(channel.iter().all(|x| (x + 0.1).abs() < 1e-15), "{channel:?}");
            let joint = &features[products + 3 + PLAY.len()..];
            assert!(joint.chunks(2).all(|play| play == [0.5, -0.5]));
            model.late(&features, &mut late);
            assert!(late.iter().all(|x| x.abs() < 1e-15), "nothing is late at rest");
        }
    }

    #[test]
    fn a_play_follows_at_its_half_width_and_stays_on_the_way_back() {
        let wrench = [[0.0, 0.0], [2.0, 0.0], [1.9, 0.0], [0.0, 0.0]];
        let features = run(&wrench, &MemoryModel::on_axes(2));
        let widest = 2 + PLAY.len() - 1;
        let width = PLAY[PLAY.len() - 1];
        let play: Vec<f64> = features.iter().map(|features| features[widest]).collect();
        assert_eq!(play, [0.0, 1.0 - width, 1.0 - width, width]);
    }

    #[test]
    fn a_channel_has_the_play_of_its_own_load() {
        // 0.6 · 1 + 0.8 · 0.5 = 1 there and 0 back.
        let features = run(&[[0.0, 0.0], [2.0, 2.0], [0.0, 0.0]], &beside());
        let first = MemoryModel::on_axes(2).features();
        for (k, width) in PLAY.into_iter().enumerate() {
            assert!((features[1][first + k] - (1.0 - width)).abs() < 1e-15);
            assert!((features[2][first + k] - width).abs() < 1e-15);
        }
    }

    #[test]
    fn a_joint_play_is_the_same_in_every_direction() {
        let model = beside();
        let first = model.features() - model.joint_plays();
        // Repeat the path on axes rotated by 45°.
        let straight = run(&[[0.0, 0.0], [2.0, 0.0], [0.6, 0.0]], &model);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let turned = run(&[[0.0, 0.0], [2.0 * half, 4.0 * half], [0.6 * half, 1.2 * half]], &model);
        for (straight, turned) in straight.iter().zip(&turned) {
            let plays = straight[first..].chunks(2).zip(turned[first..].chunks(2));
            for (straight, turned) in plays {
                assert!((half * (turned[0] + turned[1]) - straight[0]).abs() < 1e-15);
                assert!((turned[0] - turned[1]).abs() < 1e-15 && straight[1] == 0.0);
            }
        }
    }

    #[test]
    fn a_lag_relaxes_with_its_time_constant() {
        let mut wrench = vec![[0.0, 0.0]];
        wrench.extend([[2.0, 0.0]; 100]);
        let features = run(&wrench, &MemoryModel::on_axes(2));
        for (lag, (lag_s, _)) in LAGS.into_iter().enumerate() {
            // A unit step, 100 steps of 0.01 s ago.
            let expected = 1.0 - (-1.0 / lag_s).exp();
            assert!((features[100][2 + PLAY.len() + lag] - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn every_feature_has_its_family() {
        let model = beside();
        let families = model.families();
        assert_eq!(families.len(), model.features());
        let count = |family| families.iter().filter(|f| **f == family).count();
        assert_eq!(count(None), 2 + 3);
        assert_eq!(
            Family::ALL.map(|family| count(Some(family))),
            [2 * PLAY.len(), 2 * 4, 2 * 2, PLAY.len(), 2 * JOINT.len()]
        );
    }

    #[test]
    fn shares_of_the_memory_are_found_from_the_map() {
        let mut model = MemoryModel::on_axes(2);
        let mut map = faer::Mat::<f64>::zeros(model.features(), 3);
        for c in 0..3 {
            let whole = [3.0, -1.0, 2.0][c];
            map[(0, c)] = 0.7 * whole;
            map[(2, c)] = 0.3 * whole;
            map[(1, c)] = whole;
        }
        model.learn_shares(map.as_ref());
        assert!((model.shares[0] - 0.3).abs() < 1e-15);
        assert!(model.shares[1..].iter().all(|&share| share == 0.0));
    }
}
