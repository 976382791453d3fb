//! Gauss-Newton steps for several rows at a time. Lanes stop independently of their neighbours.

use pulp::{Simd, WithSimd};

use super::{Estimates, Flags, Inversion, Ready};
use crate::cholesky::LaneCholesky;
use crate::fit::MOST_CHANNELS;
use crate::lanes::{LaneResponse, Lanes, MOST_LANES, linear, quadratic_form};

/// Largest number of steps, including halved ones; five or six are usual.
const STEPS: usize = 16;

/// Limit of convergence: squared length of a step, in standard errors.
const SETTLED: f64 = 1e-6;

const HALVINGS: f64 = 4.0;

/// A reading is inconsistent with the wrench if it is this many standard deviations from its curve.
pub(super) const FAR: f64 = 5.0;

/// Inversion of all rows, inlined as a whole into code for the widest vectors of the machine.
pub(super) struct Invert<'a, const N: usize> {
    pub(super) inversion: &'a Inversion,
    /// One column per channel, counts.
    pub(super) readings: &'a [Vec<f64>],
}

impl<const N: usize> WithSimd for Invert<'_, N> {
    type Output = (Estimates, Vec<f64>);

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> (Estimates, Vec<f64>) {
        let rows = self.readings.first().map_or(0, Vec::len);
        let column = || vec![0.0; rows];
        let mut sums = column();
        let mut out = Estimates {
            wrench: std::array::from_fn(|_| column()),
            standard_errors: std::array::from_fn(|_| column()),
            flags: vec![Flags::default(); rows],
        };
        for first in (0..rows).step_by(S::F64_LANES) {
            let count = S::F64_LANES.min(rows - first);
            let frames = Frames::<S>::new(simd, self.inversion, self.readings, first, count);
            let found = self.inversion.descend::<S, N>(simd, &frames);
            self.inversion.write(&frames, &found, (first, count), &mut out);
            sums[first..first + count].copy_from_slice(&found.sum.values()[..count]);
        }
        (out, sums)
    }
}

/// A frame per lane. Lanes without a row repeat the first.
struct Frames<S: Simd> {
    /// Scaled readings by position of the sensor; zero if not in use.
    y: [Lanes<S>; MOST_CHANNELS],
    /// One if the sensor is in use, zero if its reading is not a number.
    used: [Lanes<S>; MOST_CHANNELS],
    /// Displacement minus b according to the reading alone, and its weight.
    start: [(Lanes<S>, Lanes<S>); MOST_CHANNELS],
}

/// Curves at one wrench per lane, for the next step.
#[derive(Clone, Copy)]
struct LaneState<S: Simd, const N: usize> {
    x: [Lanes<S>; N],
    residual: [Lanes<S>; MOST_CHANNELS],
    slope: [Lanes<S>; MOST_CHANNELS],
    /// Inverse variances; zero for a sensor that is not in use.
    weight: [Lanes<S>; MOST_CHANNELS],
    /// `xᵀPx`, the term of the prior.
    held_back: Lanes<S>,
}

struct NewtonResult<S: Simd, const N: usize> {
    state: LaneState<S, N>,
    /// The last step, which is too short to evaluate the curves again.
    rest: [Lanes<S>; N],
    sum: Lanes<S>,
    converged: Lanes<S>,
}

/// Curvature of half the sum (lower triangle), and its descent.
type StepEquations<S, const N: usize> = ([[Lanes<S>; N]; N], [Lanes<S>; N]);

impl<S: Simd> Frames<S> {
    #[inline(always)]
    fn new(
        simd: S,
        inversion: &Inversion,
        readings: &[Vec<f64>],
        first: usize,
        count: usize,
    ) -> Self {
        let zero = Lanes::splat(simd, 0.0);
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
            let [y, used, q, weight] = lanes.each_ref().map(|lanes| Lanes::load(simd, lanes, 0));
            (frames.y[position], frames.used[position]) = (y, used);
            frames.start[position] = (q, weight);
        }
        frames
    }
}

impl Inversion {
    #[inline(always)]
    fn descend<S: Simd, const N: usize>(&self, simd: S, frames: &Frames<S>) -> NewtonResult<S, N> {
        let (zero, one) = (Lanes::splat(simd, 0.0), Lanes::splat(simd, 1.0));
        let mut state = self.state(simd, frames, &self.start(simd, frames));
        let mut before = self.sum(&state, &state.weight);
        let mut step = self.step(&state).0;
        let mut rest = [zero; N];
        let (mut active, mut converged, mut halvings) = (one, zero, zero);
        for _ in 0..STEPS {
            let at = std::array::from_fn(|axis| state.x[axis] + step[axis]);
            let next = self.state(simd, frames, &at);
            // The sum with the previous variances decides whether this step goes down. The next step is compared with
            // the sum with the new variances.
            let (by_old, by_new) = (self.sum(&next, &state.weight), self.sum(&next, &next.weight));
            let is_down = simd.less_than_or_equal_f64s(by_old.1, before.1);
            let down = zero.replaced(is_down, active);
            let taken = down.is_positive();
            state.take(taken, &next, self.sensors.len());
            before = before.replaced(taken, by_new);
            let (next_step, length) = self.step(&next);
            let settled = zero.replaced(length.is_below(SETTLED), down);
            let is_settled = settled.is_positive();
            for axis in 0..N {
                rest[axis] = rest[axis].replaced(is_settled, next_step[axis]);
                step[axis] = (step[axis] * 0.5).replaced(taken, next_step[axis]);
            }
            converged = converged + settled;
            halvings = (halvings + 1.0).replaced(taken, zero);
            let may_halve = halvings.is_below(HALVINGS);
            active = zero.replaced(may_halve, active - settled);
            if simd.reduce_max_f64s(active.1) <= 0.0 {
                break;
            }
        }
        NewtonResult { state, rest, sum: before, converged }
    }

    #[inline(always)]
    fn sum<S: Simd, const N: usize>(
        &self,
        state: &LaneState<S, N>,
        weight: &[Lanes<S>; MOST_CHANNELS],
    ) -> Lanes<S> {
        let mut sum = state.held_back;
        for (&weight, &residual) in weight.iter().zip(&state.residual).take(self.sensors.len()) {
            sum = weight * residual * residual + sum;
        }
        sum
    }

    /// Wrench that fits the displacements implied by each reading alone.
    #[inline(always)]
    fn start<S: Simd, const N: usize>(&self, simd: S, frames: &Frames<S>) -> [Lanes<S>; N] {
        let mut equations = (self.prior_lanes(simd), [Lanes::splat(simd, 0.0); N]);
        for (sensor, &(q, weight)) in self.sensors.iter().zip(&frames.start) {
            add(&mut equations, sensor, weight, weight * q);
        }
        LaneCholesky::new(&equations.0).solve(&equations.1)
    }

    #[inline(always)]
    fn state<S: Simd, const N: usize>(
        &self,
        simd: S,
        frames: &Frames<S>,
        x: &[Lanes<S>; N],
    ) -> LaneState<S, N> {
        let zero = Lanes::splat(simd, 0.0);
        let zeros = [zero; MOST_CHANNELS];
        let mut state =
            LaneState { x: *x, residual: zeros, slope: zeros, weight: zeros, held_back: zero };
        for (position, sensor) in self.sensors.iter().enumerate() {
            let response =
                LaneResponse::at(linear(sensor.offset, &sensor.gains, x), sensor.h, sensor.nu);
            let noise = self.model.noise.variance_at(response.slope * response.slope);
            let triangle = sensor.covariance.iter().enumerate().map(|(i, row)| &row[..=i]);
            let variance = noise + quadratic_form(&response.gradient(x), triangle);
            state.residual[position] = frames.y[position] - (response.height + sensor.lo);
            state.slope[position] = response.slope;
            state.weight[position] = frames.used[position] / variance;
        }
        for (row, &xi) in self.prior.iter().zip(x) {
            state.held_back = xi * linear(0.0, row, x) + state.held_back;
        }
        state
    }

    #[inline(always)]
    fn prior_lanes<S: Simd, const N: usize>(&self, simd: S) -> [[Lanes<S>; N]; N] {
        std::array::from_fn(|i| std::array::from_fn(|j| Lanes::splat(simd, self.prior[i][j])))
    }

    #[inline(always)]
    fn equations<S: Simd, const N: usize>(&self, state: &LaneState<S, N>) -> StepEquations<S, N> {
        let simd = state.held_back.0;
        let held_back = |i: usize| {
            let pull = linear(0.0, &self.prior[i], &state.x);
            Lanes(simd, simd.neg_f64s(pull.1))
        };
        let mut equations = (self.prior_lanes(simd), std::array::from_fn(held_back));
        for (position, sensor) in self.sensors.iter().enumerate() {
            let weighted = state.weight[position] * state.slope[position];
            let pull = weighted * state.residual[position];
            add(&mut equations, sensor, weighted * state.slope[position], pull);
        }
        equations
    }

    /// Step to take from `state`, and its squared length in standard errors.
    #[inline(always)]
    fn step<S: Simd, const N: usize>(&self, state: &LaneState<S, N>) -> ([Lanes<S>; N], Lanes<S>) {
        let (curvature, descent) = self.equations(state);
        let step = LaneCholesky::new(&curvature).solve(&descent);
        let mut length = Lanes::splat(state.held_back.0, 0.0);
        for (&s, &d) in step.iter().zip(&descent) {
            length = s * d + length;
        }
        (step, length)
    }

    #[inline(always)]
    fn write<S: Simd, const N: usize>(
        &self,
        frames: &Frames<S>,
        found: &NewtonResult<S, N>,
        (first, count): (usize, usize),
        out: &mut Estimates,
    ) {
        let (curvature, _) = self.equations(&found.state);
        let variances = LaneCholesky::new(&curvature).inverse_diagonal();
        for (axis, variance) in variances[..6].iter().enumerate() {
            let x = found.state.x[axis] + found.rest[axis];
            let scale = self.model.wrench_scale[axis];
            let wrench = (x * scale).values();
            let error = (variance.sqrt() * scale).values();
            out.wrench[axis][first..first + count].copy_from_slice(&wrench[..count]);
            out.standard_errors[axis][first..first + count].copy_from_slice(&error[..count]);
        }
        let flags = &mut out.flags[first..first + count];
        for (flags, converged) in flags.iter_mut().zip(found.converged.values()) {
            let converged = converged > 0.0;
            *flags = Flags { left_out: self.dead, converged, ..Flags::default() };
        }
        for (position, sensor) in self.sensors.iter().enumerate() {
            let bit = 1 << sensor.channel;
            let (used, state) = (frames.used[position].values(), &found.state);
            let (slope, residual) = (state.slope[position].values(), state.residual[position]);
            let square = (residual * residual * state.weight[position]).values();
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
    #[inline(always)]
    fn take(&mut self, taken: S::m64s, next: &Self, sensors: usize) {
        for axis in 0..N {
            self.x[axis] = self.x[axis].replaced(taken, next.x[axis]);
        }
        for position in 0..sensors {
            let replace = |old: &mut Lanes<S>, new| *old = old.replaced(taken, new);
            replace(&mut self.residual[position], next.residual[position]);
            replace(&mut self.slope[position], next.slope[position]);
            replace(&mut self.weight[position], next.weight[position]);
        }
    }
}

/// `A += weight·g·gᵀ` (lower triangle), `b += pull·g`.
#[inline(always)]
fn add<S: Simd, const N: usize>(
    (a, b): &mut StepEquations<S, N>,
    sensor: &Ready,
    weight: Lanes<S>,
    pull: Lanes<S>,
) {
    for i in 0..N {
        b[i] = pull * sensor.gains[i] + b[i];
        let weighted = weight * sensor.gains[i];
        for (sum, &other) in a[i][..=i].iter_mut().zip(&sensor.gains) {
            *sum = weighted * other + *sum;
        }
    }
}
