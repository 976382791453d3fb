//! Eigenvalues and eigenvectors, by tridiagonalisation and implicit QL steps (Bowdler, Martin, Reinsch & Wilkinson,
//! Numer. Math. 11, 1968), to a few rounding errors of the largest. Eigenvectors stay a product of Householder
//! reflections and rotations, which is cheaper for a few vectors.

use super::{SymmetricMatrix, add_multiple, product};
use shell_data::vectorised;

/// Maximum number of steps for one eigenvalue; usually two.
const MOST_STEPS: usize = 60;

/// The decomposition `A = Z·diag(values)·Zᵀ`.
#[derive(Clone, Debug)]
pub struct Eigen {
    pub values: Vec<f64>,
    /// Reflections of all elements but the first, of all but the first two, …
    reflections: Vec<Reflection>,
    /// Rotations of the elements at a position and the next: position, cosine and sine.
    rotations: Vec<(usize, f64, f64)>,
}

impl SymmetricMatrix {
    /// Eigenvalue decomposition; `None` if the matrix is not finite or an eigenvalue does not converge.
    pub fn eigen(mut self) -> Option<Eigen> {
        let (mut values, mut beside, reflections) = tridiagonal(&mut self);
        let rotations = implicit_ql(&mut values, &mut beside)?;
        Some(Eigen { values, reflections, rotations })
    }
}

impl Eigen {
    pub fn vector(&self, position: usize) -> Vec<f64> {
        let mut vector = vec![[0.0; TOGETHER]; self.values.len()];
        vector[position][0] = 1.0;
        self.turn_back(&mut vector);
        vector.into_iter().map(|lanes| lanes[0]).collect()
    }

    /// Replaces each vector `x` with `Zᵀ·x`.
    pub fn turn(&self, x: &mut [Lanes]) {
        turn(self, x);
    }

    /// Replaces each vector `x` with `Z·x`.
    pub fn turn_back(&self, x: &mut [Lanes]) {
        turn_back(self, x);
    }
}

/// Number of vectors transformed together. A rotation waits for the one before, so several take no longer than one.
pub(crate) const TOGETHER: usize = 8;

pub(crate) type Lanes = [f64; TOGETHER];

vectorised! {
    fn turn(eigen: &Eigen, x: &mut [Lanes]) {
        for (k, reflection) in eigen.reflections.iter().enumerate() {
            reflection.apply_lanes(&mut x[k + 1..]);
        }
        for &(i, cos, sin) in &eigen.rotations {
            rotate(x, i, cos, -sin);
        }
    }

    fn turn_back(eigen: &Eigen, x: &mut [Lanes]) {
        for &(i, cos, sin) in eigen.rotations.iter().rev() {
            rotate(x, i, cos, sin);
        }
        for (k, reflection) in eigen.reflections.iter().enumerate().rev() {
            reflection.apply_lanes(&mut x[k + 1..]);
        }
    }
}

#[inline(always)]
fn rotate(x: &mut [Lanes], i: usize, cos: f64, sin: f64) {
    let (a, b) = (x[i], x[i + 1]);
    x[i] = std::array::from_fn(|lane| cos * a[lane] + sin * b[lane]);
    x[i + 1] = std::array::from_fn(|lane| cos * b[lane] - sin * a[lane]);
}

vectorised! {
    fn tridiagonal(a: &mut SymmetricMatrix) -> (Vec<f64>, Vec<f64>, Vec<Reflection>) {
        let size = a.size;
        let mut rest = a.upper.as_mut_slice();
        let (mut diagonal, mut beside) = (Vec::with_capacity(size), Vec::with_capacity(size));
        let mut reflections = Vec::with_capacity(size);
        for length in (1..=size).rev() {
            let (row, below) = rest.split_at_mut(length);
            diagonal.push(row[0]);
            rest = below;
            if length > 1 {
                let (reflection, left) = Reflection::new(&row[1..]);
                beside.push(left);
                reflection.apply_both(rest);
                reflections.push(reflection);
            }
        }
        (diagonal, beside, reflections)
    }
}

/// Turns the diagonal into the eigenvalues; `None` if a value is not finite or does not converge.
fn implicit_ql(diagonal: &mut [f64], beside: &mut Vec<f64>) -> Option<Vec<(usize, f64, f64)>> {
    let size = diagonal.len();
    beside.resize(size, 0.0);
    let mut rotations = Vec::with_capacity(2 * size * size);
    // Relative to the whole matrix: if its rank is low, other elements are rounding errors, which do not converge.
    let sums = diagonal.iter().zip(&*beside).map(|(d, e)| d.abs() + e.abs());
    let zero = f64::EPSILON * sums.fold(0.0, f64::max);
    for first in 0..size {
        for step in 0.. {
            let is_small = |i: &usize| beside[*i].abs() <= zero;
            let last = (first..size - 1).find(is_small).unwrap_or(size - 1);
            if last == first {
                break;
            }
            if step == MOST_STEPS {
                return None;
            }
            ql_step(diagonal, beside, (first, last), &mut rotations);
        }
    }
    diagonal.iter().all(|value| value.is_finite()).then_some(rotations)
}

/// One QL step with Wilkinson's shift, on the rows from the first to the last.
fn ql_step(
    diagonal: &mut [f64],
    beside: &mut [f64],
    (first, last): (usize, usize),
    rotations: &mut Vec<(usize, f64, f64)>,
) {
    let g = (diagonal[first + 1] - diagonal[first]) / (2.0 * beside[first]);
    let r = (g * g + 1.0).sqrt().copysign(g);
    let mut g = diagonal[last] - diagonal[first] + beside[first] / (g + r);
    let (mut sin, mut cos, mut shift) = (1.0, 1.0, 0.0);
    for i in (first..last).rev() {
        let (f, b) = (sin * beside[i], cos * beside[i]);
        let r = (f * f + g * g).sqrt();
        beside[i + 1] = r;
        if r == 0.0 {
            diagonal[i + 1] -= shift;
            beside[last] = 0.0;
            return;
        }
        (sin, cos) = (f / r, g / r);
        g = diagonal[i + 1] - shift;
        let r = (diagonal[i] - g) * sin + 2.0 * cos * b;
        shift = sin * r;
        diagonal[i + 1] = g + shift;
        g = cos * r - b;
        rotations.push((i, cos, sin));
    }
    diagonal[first] -= shift;
    beside[first] = g;
    beside[last] = 0.0;
}

/// The reflection `I − β·v·vᵀ`, which maps a vector to a multiple of the first unit vector.
#[derive(Clone, Debug)]
pub(super) struct Reflection {
    v: Vec<f64>,
    beta: f64,
}

impl Reflection {
    /// Reflection for a vector, and the first element of the reflected vector.
    #[inline(always)]
    pub(super) fn new(x: &[f64]) -> (Self, f64) {
        let length = product(x, x).sqrt();
        let mut v = x.to_vec();
        if x.len() == 1 || length == 0.0 {
            return (Self { v, beta: 0.0 }, x[0]);
        }
        let beta = 1.0 / (length * (length + x[0].abs()));
        let left = -length.copysign(x[0]);
        v[0] -= left;
        (Self { v, beta }, left)
    }

    #[inline(always)]
    pub(super) fn apply(&self, x: &mut [f64]) {
        add_multiple(x, -self.beta * product(&self.v, x), &self.v);
    }

    #[inline(always)]
    fn apply_lanes(&self, x: &mut [Lanes]) {
        let mut sums = [[0.0; TOGETHER]; 4];
        let ((v, v_rest), (fours, rest)) = (self.v.as_chunks::<4>(), x.as_chunks::<4>());
        for (v, x) in v.iter().zip(fours) {
            for (sum, (v, x)) in sums.iter_mut().zip(v.iter().zip(x)) {
                sum.iter_mut().zip(x).for_each(|(sum, x)| *sum += v * x);
            }
        }
        let [p, q, r, s] = sums;
        let mut last = [0.0; TOGETHER];
        for (v, x) in v_rest.iter().zip(rest) {
            last.iter_mut().zip(x).for_each(|(sum, x)| *sum += v * x);
        }
        let share: Lanes = std::array::from_fn(|lane| {
            -self.beta * ((p[lane] + q[lane]) + (r[lane] + s[lane]) + last[lane])
        });
        for (x, v) in x.iter_mut().zip(&self.v) {
            x.iter_mut().zip(share).for_each(|(x, share)| *x += share * v);
        }
    }

    /// Replaces `A` with `H·A·H`.
    #[inline(always)]
    pub(super) fn apply_both(&self, rows: &mut [f64]) {
        let size = self.v.len();
        // p = β·A·v, w = p − β/2·(pᵀv)·v, A − v·wᵀ − w·vᵀ.
        let mut w = vec![0.0; size];
        let mut rest = &*rows;
        for i in 0..size {
            let (row, below) = rest.split_at(size - i);
            w[i] += product(row, &self.v[i..]);
            add_multiple(&mut w[i + 1..], self.v[i], &row[1..]);
            rest = below;
        }
        w.iter_mut().for_each(|w| *w *= self.beta);
        let half = -0.5 * self.beta * product(&w, &self.v);
        add_multiple(&mut w, half, &self.v);
        let mut rest = rows;
        for i in 0..size {
            let (row, below) = rest.split_at_mut(size - i);
            let (vi, wi) = (self.v[i], w[i]);
            let columns = self.v[i..].iter().zip(&w[i..]);
            row.iter_mut().zip(columns).for_each(|(x, (v, w))| *x -= vi * w + wi * v);
            rest = below;
        }
    }
}
