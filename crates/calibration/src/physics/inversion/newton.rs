//! Gauss's and Newton's steps of several rows at a time.
//!
//! A lane takes the steps that its row needs and then rests, so no row's result depends on those
//! beside it.

use pulp::{Simd, WithSimd};

use super::ready::Ready;
use super::{Estimates, Inversion};
use crate::physics::cholesky::LaneCholesky;
use crate::physics::lanes::{Answers, MOST_LANES, linear, load_rows, store};
use crate::physics::observation::MOST_CHANNELS;

/// Most steps, halved ones among them; five or six are usual.
const STEPS: usize = 16;

/// Rest: a step that is shorter than this many standard errors, squared.
const REST: f64 = 1e-6;

/// Halvings of a step that does not lower the sum.
const HALVINGS: f64 = 4.0;

/// A reading this many standard deviations from its curve does not belong to the wrench found.
pub(super) const FAR: f64 = 5.0;

/// The rows of some columns, inlined whole into code for the widest vectors of the machine.
pub(super) struct Invert<'a, const N: usize> {
    pub(super) inversion: &'a Inversion,
    /// One column per channel, counts.
    pub(super) readings: &'a [Vec<f64>],
    pub(super) out: &'a mut Estimates,
    /// The sum that was minimised.
    pub(super) sums: &'a mut [f64],
}

impl<const N: usize> WithSimd for Invert<'_, N> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let rows = self.readings.first().map_or(0, Vec::len);
        for first in (0..rows).step_by(S::F64_LANES) {
            let count = S::F64_LANES.min(rows - first);
            let frames = Frames::<S>::new(simd, self.inversion, self.readings, first, count);
            let found = self.inversion.descend::<S, N>(simd, &frames);
            self.inversion.write(simd, &frames, &found, (first, count), self.out);
            let sum = store::<S>(found.sum);
            self.sums[first..first + count].copy_from_slice(&sum[..count]);
        }
    }
}

/// A frame of readings per lane. Lanes without a row repeat the first.
struct Frames<S: Simd> {
    /// Scaled readings, by position of the sensor; zero where not in use.
    y: [S::f64s; MOST_CHANNELS],
    /// One where the sensor is in use, zero where its reading is not a number.
    used: [S::f64s; MOST_CHANNELS],
    /// The displacement less b that the reading alone says, and its weight.
    start: [(S::f64s, S::f64s); MOST_CHANNELS],
}

/// The curves at one wrench per lane, and the equations of the next step.
#[derive(Clone, Copy)]
struct LaneState<S: Simd, const N: usize> {
    /// The wrench, then the factors.
    x: [S::f64s; N],
    residual: [S::f64s; MOST_CHANNELS],
    slope: [S::f64s; MOST_CHANNELS],
    /// Inverse variances; zero of a sensor that is not in use.
    weight: [S::f64s; MOST_CHANNELS],
    /// `xᵀPx`, of the prior.
    held_back: S::f64s,
}

/// Where the steps of each lane ended.
struct NewtonResult<S: Simd, const N: usize> {
    state: LaneState<S, N>,
    /// The last step, too short for the curves to be looked at again.
    rest: [S::f64s; N],
    /// The sum at `state`.
    sum: S::f64s,
    /// One where the steps came to rest.
    converged: S::f64s,
}

/// The curvature of half the sum, lower triangle, and its descent.
type StepEquations<S, const N: usize> = ([[<S as Simd>::f64s; N]; N], [<S as Simd>::f64s; N]);

impl<S: Simd> Frames<S> {
    #[inline(always)]
    fn new(
        simd: S,
        inversion: &Inversion,
        readings: &[Vec<f64>],
        first: usize,
        count: usize,
    ) -> Self {
        let zero = simd.splat_f64s(0.0);
        let mut frames = Self {
            y: [zero; MOST_CHANNELS],
            used: [zero; MOST_CHANNELS],
            start: [(zero, zero); MOST_CHANNELS],
        };
        for (position, sensor) in inversion.sensors.iter().enumerate() {
            let mut lanes = [[0.0; MOST_LANES]; 4];
            let column = &readings[sensor.channel][first..];
            for lane in 0..S::F64_LANES {
                let y = sensor.scaled(column[if lane < count { lane } else { 0 }]);
                if y.is_finite() {
                    let (q, weight) = sensor.start(y);
                    [y, 1.0, q, weight].iter().zip(&mut lanes).for_each(|(x, l)| l[lane] = *x);
                }
            }
            let [y, used, q, weight] = lanes.each_ref().map(|lanes| load_rows::<S>(lanes, 0));
            (frames.y[position], frames.used[position], frames.start[position]) =
                (y, used, (q, weight));
        }
        frames
    }
}

impl Inversion {
    /// Steps from the start until each lane rests.
    #[inline(always)]
    fn descend<S: Simd, const N: usize>(&self, simd: S, frames: &Frames<S>) -> NewtonResult<S, N> {
        let (zero, one, half) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0), simd.splat_f64s(0.5));
        let mut state = self.state(simd, frames, &self.start(simd, frames));
        let mut before = state.held_back;
        for position in 0..self.sensors.len() {
            before = add_square(simd, before, state.residual[position], state.weight[position]);
        }
        let mut step = self.step(simd, &state).0;
        let mut rest = [zero; N];
        let (mut active, mut converged, mut halvings) = (one, zero, zero);
        for _ in 0..STEPS {
            let at = std::array::from_fn(|axis| simd.add_f64s(state.x[axis], step[axis]));
            let next = self.state(simd, frames, &at);
            // The sum with the variances of before says whether this is a step down; with those of
            // now, it is what the next step is compared with.
            let (mut by_old, mut by_new) = (next.held_back, next.held_back);
            for position in 0..self.sensors.len() {
                by_old = add_square(simd, by_old, next.residual[position], state.weight[position]);
                by_new = add_square(simd, by_new, next.residual[position], next.weight[position]);
            }
            let is_down = simd.less_than_or_equal_f64s(by_old, before);
            let down = simd.select_f64s(is_down, active, zero);
            let taken = simd.greater_than_f64s(down, zero);
            state.take(simd, taken, &next, self.sensors.len());
            before = simd.select_f64s(taken, by_new, before);

            let (next_step, length) = self.step(simd, &next);
            let is_short = simd.less_than_f64s(length, simd.splat_f64s(REST));
            let rests = simd.select_f64s(is_short, down, zero);
            let is_resting = simd.greater_than_f64s(rests, zero);
            for axis in 0..N {
                rest[axis] = simd.select_f64s(is_resting, next_step[axis], rest[axis]);
                let halved = simd.mul_f64s(half, step[axis]);
                step[axis] = simd.select_f64s(taken, next_step[axis], halved);
            }
            converged = simd.add_f64s(converged, rests);
            halvings = simd.select_f64s(taken, zero, simd.add_f64s(halvings, one));
            let is_stuck = simd.greater_than_or_equal_f64s(halvings, simd.splat_f64s(HALVINGS));
            active = simd.select_f64s(is_stuck, zero, simd.sub_f64s(active, rests));
            if simd.reduce_max_f64s(active) <= 0.0 {
                break;
            }
        }
        NewtonResult { state, rest, sum: before, converged }
    }

    /// The wrench of the displacements that the readings alone say.
    #[inline(always)]
    fn start<S: Simd, const N: usize>(&self, simd: S, frames: &Frames<S>) -> [S::f64s; N] {
        let zero = simd.splat_f64s(0.0);
        let mut equations = (self.prior_lanes(simd), [zero; N]);
        for (sensor, &(q, weight)) in self.sensors.iter().zip(&frames.start) {
            add::<S, N>(simd, &mut equations, sensor, weight, simd.mul_f64s(weight, q));
        }
        LaneCholesky::new(simd, &equations.0).solve(simd, &equations.1)
    }

    #[inline(always)]
    fn state<S: Simd, const N: usize>(
        &self,
        simd: S,
        frames: &Frames<S>,
        x: &[S::f64s; N],
    ) -> LaneState<S, N> {
        let zeros = [simd.splat_f64s(0.0); MOST_CHANNELS];
        let mut state = LaneState {
            x: *x,
            residual: zeros,
            slope: zeros,
            weight: zeros,
            held_back: simd.splat_f64s(0.0),
        };
        for (position, sensor) in self.sensors.iter().enumerate() {
            let q = linear(simd, sensor.offset, &sensor.gains, x);
            let answers = Answers::at(simd, q, sensor.h, sensor.nu);
            let value = simd.add_f64s(answers.height, simd.splat_f64s(sensor.lo));
            let slope_square = simd.mul_f64s(answers.slope, answers.slope);
            let noise = self.noise.variances_at(simd, slope_square);
            let variance = simd.add_f64s(noise, parameter_variance(simd, sensor, &answers, x));
            state.residual[position] = simd.sub_f64s(frames.y[position], value);
            state.slope[position] = answers.slope;
            state.weight[position] = simd.div_f64s(frames.used[position], variance);
        }
        for (row, &xi) in self.prior.iter().zip(x) {
            let product = linear(simd, 0.0, row, x);
            state.held_back = simd.add_f64s(simd.mul_f64s(xi, product), state.held_back);
        }
        state
    }

    #[inline(always)]
    fn prior_lanes<S: Simd, const N: usize>(&self, simd: S) -> [[S::f64s; N]; N] {
        std::array::from_fn(|i| std::array::from_fn(|j| simd.splat_f64s(self.prior[i][j])))
    }

    #[inline(always)]
    fn equations<S: Simd, const N: usize>(
        &self,
        simd: S,
        state: &LaneState<S, N>,
    ) -> StepEquations<S, N> {
        let held_back = |i: usize| simd.neg_f64s(linear(simd, 0.0, &self.prior[i], &state.x));
        let mut equations = (self.prior_lanes(simd), std::array::from_fn(held_back));
        for (position, sensor) in self.sensors.iter().enumerate() {
            let weighted = simd.mul_f64s(state.weight[position], state.slope[position]);
            let pull = simd.mul_f64s(weighted, state.residual[position]);
            let weight = simd.mul_f64s(weighted, state.slope[position]);
            add::<S, N>(simd, &mut equations, sensor, weight, pull);
        }
        equations
    }

    /// The step to take from `state`, and its length in standard errors, squared.
    #[inline(always)]
    fn step<S: Simd, const N: usize>(
        &self,
        simd: S,
        state: &LaneState<S, N>,
    ) -> ([S::f64s; N], S::f64s) {
        let (curvature, descent) = self.equations(simd, state);
        let step = LaneCholesky::new(simd, &curvature).solve(simd, &descent);
        let mut length = simd.splat_f64s(0.0);
        for (&s, &d) in step.iter().zip(&descent) {
            length = simd.add_f64s(simd.mul_f64s(s, d), length);
        }
        (step, length)
    }

    #[inline(always)]
    fn write<S: Simd, const N: usize>(
        &self,
        simd: S,
        frames: &Frames<S>,
        found: &NewtonResult<S, N>,
        (first, count): (usize, usize),
        out: &mut Estimates,
    ) {
        let (curvature, _) = self.equations(simd, &found.state);
        let variances = LaneCholesky::new(simd, &curvature).inverse_diagonal(simd);
        for (axis, &variance) in variances[..6].iter().enumerate() {
            let scale = simd.splat_f64s(self.scale[axis]);
            let x = simd.add_f64s(found.state.x[axis], found.rest[axis]);
            let wrench = store::<S>(simd.mul_f64s(x, scale));
            let error = store::<S>(simd.mul_f64s(simd.sqrt_f64s(variance), scale));
            out.wrench[axis][first..first + count].copy_from_slice(&wrench[..count]);
            out.standard_errors[axis][first..first + count].copy_from_slice(&error[..count]);
        }
        let converged = store::<S>(found.converged);
        let flags = &mut out.flags[first..first + count];
        for (flags, converged) in flags.iter_mut().zip(converged) {
            *flags = super::Flags { left_out: self.dead, ..super::Flags::default() };
            flags.converged = converged > 0.0;
        }
        for (position, sensor) in self.sensors.iter().enumerate() {
            let bit = 1 << sensor.channel;
            let state = &found.state;
            let (used, slope) =
                (store::<S>(frames.used[position]), store::<S>(state.slope[position]));
            let square = simd.mul_f64s(state.residual[position], state.residual[position]);
            let square = store::<S>(simd.mul_f64s(square, state.weight[position]));
            for (lane, flags) in flags.iter_mut().enumerate() {
                let mask = |is: bool| if is { bit } else { 0 };
                let is_used = used[lane] > 0.0;
                flags.left_out |= mask(!is_used);
                flags.saturated |= mask(is_used && slope[lane] < sensor.flat);
                flags.misfit |= mask(is_used && square[lane] > FAR * FAR);
            }
        }
    }
}

impl<S: Simd, const N: usize> LaneState<S, N> {
    /// Becomes `next` in the lanes of `taken`.
    #[inline(always)]
    fn take(&mut self, simd: S, taken: S::m64s, next: &Self, sensors: usize) {
        for axis in 0..N {
            self.x[axis] = simd.select_f64s(taken, next.x[axis], self.x[axis]);
        }
        for position in 0..sensors {
            let choose = |new, old| simd.select_f64s(taken, new, old);
            self.residual[position] = choose(next.residual[position], self.residual[position]);
            self.slope[position] = choose(next.slope[position], self.slope[position]);
            self.weight[position] = choose(next.weight[position], self.weight[position]);
        }
    }
}

/// `gᵀCg`, the variance of an answer that comes from the parameters.
#[inline(always)]
fn parameter_variance<S: Simd>(
    simd: S,
    sensor: &Ready,
    answers: &Answers<S>,
    x: &[S::f64s],
) -> S::f64s {
    let (zero, g) = (simd.splat_f64s(0.0), answers.gradient(simd, x));
    let mut variance = zero;
    for (i, row) in sensor.covariance.iter().enumerate() {
        let product = linear(simd, 0.0, &row[..=i], &g);
        variance = simd.add_f64s(simd.mul_f64s(g[i], product), variance);
    }
    simd.max_f64s(variance, zero)
}

#[inline(always)]
fn add_square<S: Simd>(simd: S, sum: S::f64s, residual: S::f64s, weight: S::f64s) -> S::f64s {
    simd.add_f64s(simd.mul_f64s(simd.mul_f64s(weight, residual), residual), sum)
}

/// `A += weight·g·gᵀ` (lower triangle), `b += pull·g`.
#[inline(always)]
fn add<S: Simd, const N: usize>(
    simd: S,
    (a, b): &mut StepEquations<S, N>,
    sensor: &Ready,
    weight: S::f64s,
    pull: S::f64s,
) {
    for i in 0..N {
        let gain = simd.splat_f64s(sensor.gains[i]);
        b[i] = simd.add_f64s(simd.mul_f64s(pull, gain), b[i]);
        let weighted = simd.mul_f64s(weight, gain);
        for (sum, &other) in a[i][..=i].iter_mut().zip(&sensor.gains) {
            *sum = simd.add_f64s(simd.mul_f64s(weighted, simd.splat_f64s(other)), *sum);
        }
    }
}
