//! Householder's reflections.

use super::{add_multiple, product};

/// `I − β·v·vᵀ`, which leaves of a vector its first number alone.
#[derive(Clone, Debug)]
pub(super) struct Reflection {
    v: Vec<f64>,
    beta: f64,
}

impl Reflection {
    /// That of a vector, and what is left of it.
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

    /// `H·A·H`.
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
