//! A smooth part of a tip's path on which the body moves forward, and the root of `s(z) = s` on it.
//!
//! As a function of the travel `s`, `z` has two branch points: at a release, where `ds/dz` is zero,
//! and just before the first touch, at `s = −α²/4β`, the zero of the slope of `s ≈ α·z + β·z²`. In
//!
//! ```text
//! w = √(s + α²/4β) / (√(s + α²/4β) + √(s_end − s))
//! ```
//!
//! `z` is smooth at both. A polynomial of low degree gives `z` to three digits, three Newton steps
//! to rounding error.

use core::array::from_fn;
use core::f64::consts::PI;

use libm::{cos, sqrt};

use crate::path::{Contact, Path};

/// An arc with the polynomial that starts Newton's method.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Arc {
    pub(crate) z: [f64; 2],
    /// Travel of the body at the ends since the touch, m.
    pub(crate) travel: [f64; 2],
    /// Distance before the arc at which the travel would turn, as a share of the arc's travel.
    before: f64,
    scale: f64,
    nodes: [f64; NODES],
    /// Divided differences: the coefficients of Newton's form.
    coefficients: [f64; NODES],
}

const NODES: usize = 8;

/// Newton steps that nearly always suffice.
const PLAIN_STEPS: usize = 3;

/// Newton step, relative to `z`, after which the root is exact to rounding. The remaining error is the square of the
/// step over the distance to the zero of the slope, unless rounding dominates.
const CLOSE: f64 = 1e-8;

const STEPS: usize = 200;

impl Arc {
    /// Creates the arc between two `z`, with a polynomial through the Chebyshev nodes of `w`.
    pub(crate) fn new(path: &Path, z: [f64; 2]) -> Self {
        let ends = z.map(|z| path.position(z));
        let travel = [ends[0].travel, ends[1].travel.max(ends[0].travel)];
        let length = travel[1] - travel[0];
        let mut arc = Self { z, travel, before: 1.0, scale: 1.0 / length, ..Self::default() };
        if z[0] == 0.0 {
            let (slope, bend) = (ends[0].slope(), 2.0 * ends[0].back);
            let before = slope * slope / (4.0 * bend);
            if before > 0.0 && before < length {
                arc.before = before / length;
            }
        }
        let low = arc.w(travel[0]);
        for i in 0..NODES {
            // Take nodes from both ends in turn, which reduces rounding error.
            let position = if i % 2 == 0 { i / 2 } else { NODES - 1 - i / 2 };
            let share = 0.5 + 0.5 * cos(PI * (position as f64 + 0.5) / NODES as f64);
            let w = low + (1.0 - low) * share;
            // The travel at w, in shares: (s + before)·(1 − w)² = (1 − s)·w².
            let (near, far) = (w * w, (1.0 - w) * (1.0 - w));
            let past = length * (near - arc.before * far) / (near + far);
            arc.nodes[i] = w;
            arc.coefficients[i] = arc.search(path, travel[0] + past).z();
        }
        for order in 1..NODES {
            for i in (order..NODES).rev() {
                let [before, at] = [i - 1, i].map(|i| arc.coefficients[i]);
                arc.coefficients[i] = (at - before) / (arc.nodes[i] - arc.nodes[i - order]);
            }
        }
        arc
    }

    #[inline]
    fn w(&self, travel: f64) -> f64 {
        let near = sqrt(((travel - self.travel[0]) * self.scale + self.before).max(0.0));
        let far = sqrt(((self.travel[1] - travel) * self.scale).max(0.0));
        near / (near + far)
    }

    #[inline]
    fn start(&self, travel: f64) -> f64 {
        let w = self.w(travel);
        let terms = self.nodes.iter().zip(&self.coefficients).rev();
        let z = terms.fold(0.0, |sum, (node, coefficient)| sum * (w - node) + coefficient);
        z.clamp(self.z[0], self.z[1])
    }

    /// Returns `z` at a travel, or at the nearer end outside this arc.
    pub(crate) fn z_at(&self, path: &Path, travel: f64) -> f64 {
        if travel <= self.travel[0] {
            return self.z[0];
        }
        if travel >= self.travel[1] {
            return self.z[1];
        }
        self.locate(path, travel).z()
    }

    /// Returns the contact at a travel, or at the nearer end outside this arc.
    #[inline]
    pub(crate) fn locate(&self, path: &Path, travel: f64) -> Contact {
        let [contact] = Self::locate_all([self], path, [travel]);
        contact
    }

    /// Computes [`Self::locate`] for several contacts, with steps in parallel and the same bits.
    #[inline]
    pub(crate) fn locate_all<const N: usize>(
        arcs: [&Self; N],
        path: &Path,
        travels: [f64; N],
    ) -> [Contact; N] {
        let mut z: [f64; N] = from_fn(|i| arcs[i].start(travels[i]));
        let mut steps = [0.0; N];
        for _ in 0..PLAIN_STEPS {
            for i in 0..N {
                let [low, high] = arcs[i].z;
                steps[i] = path.position(z[i]).newton_step(travels[i]);
                z[i] = (z[i] - steps[i]).clamp(low, high);
            }
        }
        from_fn(|i| {
            // Also false if the step is NaN.
            if steps[i].abs() <= CLOSE * z[i] {
                path.position(z[i])
            } else {
                arcs[i].search(path, travels[i])
            }
        })
    }

    /// Computes [`Self::locate`] without the polynomial, by Newton's method while steps stay inside
    /// and shrink, otherwise by bisection.
    #[cold]
    fn search(&self, path: &Path, travel: f64) -> Contact {
        let [mut low, mut high] = self.z;
        if travel <= self.travel[0] {
            return path.position(low);
        }
        if travel >= self.travel[1] {
            return path.position(high);
        }
        let mut z = 0.5 * (low + high);
        let mut last_step = high - low;
        let mut contact = path.position(z);
        for _ in 0..STEPS {
            if contact.travel > travel {
                high = z;
            } else {
                low = z;
            }
            let newton = contact.newton_step(travel);
            let next = z - newton;
            let good = next >= low && next <= high && 2.0 * newton.abs() <= last_step;
            let next = if good { next } else { 0.5 * (low + high) };
            last_step = (next - z).abs();
            z = next;
            contact = path.position(z);
            if good && last_step <= CLOSE * z || high - low <= f64::EPSILON * high {
                break;
            }
        }
        contact
    }
}
