//! What a spring-borne optical sensor may do with a wrench, as features that its readings are a
//! linear map of.
//!
//! Springs answer late: they creep, and their friction makes the answer depend on where the load
//! came from. Both shift a reading against the load by milliseconds in one direction, whatever the
//! clocks do, so that an alignment without a model of them is biased by as much. Beside the wrench
//! itself the features are therefore
//!
//! - *play* operators of several widths, `p ← clamp(p, w − r, w + r)`: any rate-independent
//!   hysteresis with a convex loop is a sum of them (Prandtl–Ishlinskii; Brokate & Sprekels,
//!   Hysteresis and Phase Transitions, 1996);
//! - *lags*, `τ ḷ = w − l`: creep;
//! - products of two axes: the curvature of the optical response.

/// Half-widths of the play, as fractions of the largest load on the axis.
const PLAY: [f64; 6] = [0.04, 0.08, 0.14, 0.21, 0.3, 0.42];
/// Time constants of the lags, s.
const LAG_S: [f64; 2] = [0.5, 2.0];

/// Turns samples of a wrench, one after another, into features.
#[derive(Clone, Debug)]
pub(super) struct Response {
    axes: usize,
    largest: Vec<f64>,
    retained: [f64; LAG_S.len()],
    /// Plays and lags, axis by axis.
    state: Vec<f64>,
    at_rest: bool,
    memory: Memory,
    effective: Vec<f64>,
}

/// How much of the answer to each axis goes through each play and lag: axis by axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Memory(Vec<f64>);

const MEMORIES: usize = PLAY.len() + LAG_S.len();

/// The delay-like part of the readings: what the memory adds to an immediate answer, per channel,
/// from the features of one row and the map (features × channels).
pub(super) fn late_part(
    features: &[f64],
    map: faer::MatRef<'_, f64>,
    axes: usize,
    late: &mut [f64],
) {
    let memories = &features[axes..axes + axes * MEMORIES];
    for (c, late) in late.iter_mut().enumerate() {
        let share = |i: usize| map[(axes + i, c)] * (memories[i] - features[i / MEMORIES]);
        *late = (0..memories.len()).map(share).sum();
    }
}

impl Memory {
    /// All of the answer is immediate.
    pub(super) fn none(axes: usize) -> Self {
        Self(vec![0.0; axes * MEMORIES])
    }

    /// From the map (features × channels) that the readings were found to follow.
    ///
    /// Over the channels, the coefficients of one axis' play are a share of those of all that the
    /// axis does.
    pub(super) fn of(map: faer::MatRef<'_, f64>, axes: usize) -> Self {
        let row = |i: usize| (0..map.ncols()).map(move |c| map[(i, c)]);
        let mut shares = Vec::with_capacity(axes * MEMORIES);
        for axis in 0..axes {
            let parts = axes + axis * MEMORIES..axes + (axis + 1) * MEMORIES;
            let mut whole: Vec<f64> = row(axis).collect();
            for part in parts.clone() {
                whole.iter_mut().zip(row(part)).for_each(|(sum, x)| *sum += x);
            }
            let square = whole.iter().map(|x| x * x).sum::<f64>().max(1e-300);
            shares.extend(parts.map(|part| {
                let product: f64 = row(part).zip(&whole).map(|(x, whole)| x * whole).sum();
                (product / square).clamp(-1.0, 1.0)
            }));
        }
        Self(shares)
    }
}

impl Response {
    /// `largest` is the size of the load on each axis, `step_s` the time between samples.
    pub(super) fn new(largest: &[f64], step_s: f64, memory: Memory) -> Self {
        let axes = largest.len();
        Self {
            axes,
            largest: largest.to_vec(),
            retained: LAG_S.map(|lag_s| (-step_s / lag_s).exp()),
            state: vec![0.0; axes * MEMORIES],
            at_rest: true,
            memory,
            effective: vec![0.0; axes],
        }
    }

    /// Number of features.
    pub(super) fn features(axes: usize) -> usize {
        axes * (1 + MEMORIES) + axes * (axes + 1) / 2
    }

    /// Writes the features of the next sample, all of order 1: the wrench, then its plays and lags
    /// axis by axis, then the products of what the axes effectively do.
    pub(super) fn next(&mut self, wrench: &[f64], features: &mut [f64]) {
        let (immediate, rest) = features.split_at_mut(self.axes);
        let (memories, products) = rest.split_at_mut(self.axes * MEMORIES);
        for axis in 0..self.axes {
            let w = wrench[axis] / self.largest[axis];
            immediate[axis] = w;
            let state = &mut self.state[axis * MEMORIES..][..MEMORIES];
            if self.at_rest {
                state.fill(w);
            }
            let (plays, lags) = state.split_at_mut(PLAY.len());
            for (play, width) in plays.iter_mut().zip(PLAY) {
                // Not `clamp`: it would check the order of its bounds.
                *play = play.max(w - width).min(w + width);
            }
            for (lag, retained) in lags.iter_mut().zip(self.retained) {
                *lag = w + retained * (*lag - w);
            }
            memories[axis * MEMORIES..][..MEMORIES].copy_from_slice(state);
            let shares = &self.memory.0[axis * MEMORIES..][..MEMORIES];
            let late: f64 = shares.iter().zip(state).map(|(share, m)| share * (*m - w)).sum();
            self.effective[axis] = w + late;
        }
        self.at_rest = false;
        let mut products = products.iter_mut();
        for (i, a) in self.effective.iter().enumerate() {
            // In this order: a product taken for no factor would be lost.
            for (b, product) in self.effective[i..].iter().zip(products.by_ref()) {
                *product = a * b;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(wrench: &[[f64; 2]], memory: Memory) -> Vec<Vec<f64>> {
        let mut response = Response::new(&[2.0, 4.0], 0.01, memory);
        let mut features = vec![0.0; Response::features(2)];
        let mut next = |w: &[f64; 2]| {
            response.next(w, &mut features);
            features.clone()
        };
        wrench.iter().map(&mut next).collect()
    }

    #[test]
    fn features_of_a_load_that_never_changes_are_its_powers() {
        for features in run(&[[1.0, -2.0]; 50], Memory::none(2)) {
            assert_eq!(features[..2], [0.5, -0.5]);
            assert!(features[2..2 + MEMORIES].iter().all(|&x| x == 0.5));
            assert_eq!(features[2 + 2 * MEMORIES..], [0.25, -0.25, 0.25]);
        }
    }

    #[test]
    fn a_play_follows_at_its_half_width_and_stays_on_the_way_back() {
        let wrench = [[0.0, 0.0], [2.0, 0.0], [1.9, 0.0], [0.0, 0.0]];
        let features = run(&wrench, Memory::none(2));
        let widest = 2 + PLAY.len() - 1;
        let width = PLAY[PLAY.len() - 1];
        let play: Vec<f64> = features.iter().map(|features| features[widest]).collect();
        assert_eq!(play, [0.0, 1.0 - width, 1.0 - width, width]);
    }

    #[test]
    fn a_lag_relaxes_with_its_time_constant() {
        let mut wrench = vec![[0.0, 0.0]];
        wrench.extend([[2.0, 0.0]; 100]);
        let features = run(&wrench, Memory::none(2));
        for (lag, lag_s) in LAG_S.into_iter().enumerate() {
            // A unit step, 100 steps of 0.01 s ago.
            let expected = 1.0 - (-1.0 / lag_s).exp();
            assert!((features[100][2 + PLAY.len() + lag] - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn shares_of_the_memory_are_found_from_the_map() {
        let mut map = faer::Mat::<f64>::zeros(Response::features(2), 3);
        for c in 0..3 {
            let whole = [3.0, -1.0, 2.0][c];
            map[(0, c)] = 0.7 * whole;
            map[(2, c)] = 0.3 * whole;
            map[(1, c)] = whole;
        }
        let Memory(shares) = Memory::of(map.as_ref(), 2);
        assert!((shares[0] - 0.3).abs() < 1e-15);
        assert!(shares[1..].iter().all(|&share| share == 0.0));
    }
}
