//! What a spring-borne optical sensor may do with a wrench, as features that its readings are a linear
//! map of.
//!
//! Springs answer late: they creep, and their friction makes the answer depend on where the load
//! came from. Both shift a reading against the load by milliseconds in one direction, whatever the
//! clocks do, so that an alignment without a model of them is biased by as much. Beside the wrench itself the
//! features are therefore
//!
//! - *play* operators of several widths, `p ← clamp(p, w − r, w + r)`: any rate-independent
//!   hysteresis with a convex loop is a sum of them (Prandtl–Ishlinskii; Brokate & Sprekels,
//!   Hysteresis and Phase Transitions, 1996);
//! - *lags*, `τ ḷ = w − l`: creep;
//! - products of two axes: the curvature of the optical response.

/// Half-widths of the play, as fractions of the largest load on the axis.
const PLAY: [f64; 8] = [0.03, 0.06, 0.1, 0.15, 0.2, 0.27, 0.35, 0.45];
/// Time constants of the lags, s.
const LAG_S: [f64; 2] = [0.5, 2.0];

/// Turns samples of a wrench, one after another, into features.
#[derive(Clone, Debug)]
pub(super) struct Response {
    axes: usize,
    largest: Vec<f64>,
    retained: [f64; LAG_S.len()],
    play: Vec<f64>,
    lag: Vec<f64>,
    at_rest: bool,
    memory: Memory,
    effective: Vec<f64>,
}

/// How much of the answer to each axis goes through each play and lag: axis by axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Memory(Vec<f64>);

const MEMORIES: usize = PLAY.len() + LAG_S.len();

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
            play: vec![0.0; axes * PLAY.len()],
            lag: vec![0.0; axes * LAG_S.len()],
            at_rest: true,
            memory,
            effective: vec![0.0; axes],
        }
    }

    /// Number of features.
    pub(super) fn features(axes: usize) -> usize {
        axes * (1 + PLAY.len() + LAG_S.len()) + axes * (axes + 1) / 2
    }

    /// Appends the features of the next sample, all of order 1.
    pub(super) fn push(&mut self, wrench: &[f64], features: &mut Vec<f64>) {
        let start = features.len();
        features.extend(wrench.iter().zip(&self.largest).map(|(w, largest)| w / largest));
        for axis in 0..self.axes {
            let w = features[start + axis];
            if self.at_rest {
                self.play[axis * PLAY.len()..][..PLAY.len()].fill(w);
                self.lag[axis * LAG_S.len()..][..LAG_S.len()].fill(w);
            }
            let (mut effective, mut shares) = (w, self.memory.0[axis * MEMORIES..].iter());
            let mut take = |memory: f64| {
                effective += shares.next().copied().unwrap_or(0.0) * (memory - w);
                features.push(memory);
            };
            for (play, width) in self.play[axis * PLAY.len()..].iter_mut().zip(PLAY) {
                *play = play.clamp(w - width, w + width);
                take(*play);
            }
            for (lag, retained) in self.lag[axis * LAG_S.len()..].iter_mut().zip(self.retained) {
                *lag = w + retained * (*lag - w);
                take(*lag);
            }
            self.effective[axis] = effective;
        }
        self.at_rest = false;
        for i in 0..self.axes {
            for j in i..self.axes {
                features.push(self.effective[i] * self.effective[j]);
            }
        }
    }
}
