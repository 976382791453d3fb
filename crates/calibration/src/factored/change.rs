//! Features of one model as sums of those of another.
//!
//! With `z = (s − c)/k` and `z' = (s − c')/k'` a reading is `z' = a·z + b`, `a = k/k'`, `b = (c − c')/k'`, so every
//! product of `z'` is a sum of products of `z`: `X' = X·T`. Scales are powers of two, which leaves `a` exact.

use std::collections::HashMap;

use faer::Mat;

use crate::features::Features;
use crate::model::{Model, Term};
use crate::scaling::Scaling;

/// `T`, terms of `from` × terms of `model`; `None` where `from` lacks a product that it takes.
pub(super) fn change(from: &Features, model: &Model, scaling: &Scaling) -> Option<Mat<f64>> {
    let (own, wanted) = (from.model().terms(), model.terms());
    let positions: HashMap<Term, usize> = own.iter().copied().zip(0..).collect();
    let channel = |&channel: &u8| {
        let (i, about) = (usize::from(channel), from.scaling());
        let scale = scaling.scale[i];
        (about.scale[i] / scale, (about.centre[i] - scaling.centre[i]) / scale)
    };
    let mut change = Mat::zeros(own.len(), wanted.len());
    for (column, term) in wanted.iter().enumerate() {
        let factors = term.factors();
        for chosen in 0..1_u32 << factors.len() {
            let (mut share, mut kept) = (1.0, Vec::new());
            for (i, factor) in factors.iter().enumerate() {
                let (a, b) = channel(factor);
                if chosen & (1 << i) != 0 {
                    share *= a;
                    kept.push(*factor);
                } else {
                    share *= b;
                }
            }
            if share != 0.0 {
                change[(*positions.get(&Term::product(&kept))?, column)] += share;
            }
        }
    }
    Some(change)
}
