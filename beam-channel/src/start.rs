//! Where Newton's method starts in a bracket.
//!
//! Solved for `z`, the travel `s(z)` has two branch points: at a release, where `ds/dz` is zero,
//! and a little before the first touch, where that of `s ≈ α·z + β·z²` is, at `s = −α²/4β`. In
//!
//! ```text
//! w = √(s + α²/4β) / (√(s + α²/4β) + √(s_end − s))
//! ```
//!
//! `z` is smooth at both, and a polynomial of low degree gives it to three digits: from there
//! Newton's method takes three steps to rounding.

use core::f64::consts::PI;

use libm::{cos, sqrt};

use crate::bracket::Bracket;
use crate::contact::Contact;
use crate::path::Path;

const NODES: usize = 8;

/// `z` as a polynomial of `w`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Start {
    /// How far before the bracket the travel would turn, as a share of it.
    before: f64,
    /// One over the travel of the bracket, in 1/m.
    scale: f64,
    nodes: [f64; NODES],
    /// Divided differences: the coefficients of Newton's form.
    coefficients: [f64; NODES],
}

impl Start {
    /// Interpolates `z` at Chebyshev's nodes of `w`.
    pub(crate) fn new(path: &Path, bracket: &Bracket, first: &Contact) -> Self {
        let length = bracket.travel[1] - bracket.travel[0];
        let mut start = Self { before: 1.0, scale: 1.0 / length, ..Self::default() };
        if bracket.z[0] == 0.0 {
            let (slope, bend) = (first.slope(), 2.0 * first.back);
            let before = slope * slope / (4.0 * bend);
            if before > 0.0 && before < length {
                start.before = before / length;
            }
        }
        let low = start.w(bracket.travel, bracket.travel[0]);
        for i in 0..NODES {
            // From both ends in turns, for the sake of rounding.
            let position = if i % 2 == 0 { i / 2 } else { NODES - 1 - i / 2 };
            let share = 0.5 + 0.5 * cos(PI * (position as f64 + 0.5) / NODES as f64);
            let w = low + (1.0 - low) * share;
            // The travel at w, in shares: (s + before)·(1 − w)² = (1 − s)·w².
            let (near, far) = (w * w, (1.0 - w) * (1.0 - w));
            let travel = length * (near - start.before * far) / (near + far);
            start.nodes[i] = w;
            let contact = bracket.locate(path, bracket.travel[0] + travel);
            start.coefficients[i] = sqrt(contact.sin_a);
        }
        for order in 1..NODES {
            for i in (order..NODES).rev() {
                let [before, at] = [i - 1, i].map(|i| start.coefficients[i]);
                start.coefficients[i] = (at - before) / (start.nodes[i] - start.nodes[i - order]);
            }
        }
        start
    }

    #[inline]
    pub(crate) fn z(&self, travel: [f64; 2], at: f64) -> f64 {
        let w = self.w(travel, at);
        let terms = self.nodes.iter().zip(&self.coefficients).rev();
        terms.fold(0.0, |sum, (node, coefficient)| sum * (w - node) + coefficient)
    }

    #[inline]
    fn w(&self, travel: [f64; 2], at: f64) -> f64 {
        let near = sqrt(((at - travel[0]) * self.scale + self.before).max(0.0));
        let far = sqrt(((travel[1] - at) * self.scale).max(0.0));
        near / (near + far)
    }
}
