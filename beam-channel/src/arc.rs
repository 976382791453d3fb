//! A stretch of a tip's way on which everything is smooth and the body only moves forward, and the root of
//! `s(z) = s` on it.
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

use core::array::from_fn;
use core::f64::consts::PI;

use libm::{cos, sqrt};

use crate::path::{Contact, Path};

/// An arc with a polynomial that says where Newton's method starts on it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Arc {
    /// `z` at its ends.
    pub(crate) z: [f64; 2],
    /// How far the body has travelled there since the touch, in m.
    pub(crate) travel: [f64; 2],
    /// How far before the arc the travel would turn, as a share of it.
    before: f64,
    /// One over the travel of the arc, in 1/m.
    scale: f64,
    /// Where the polynomial of `w` goes through `z`.
    nodes: [f64; NODES],
    /// Divided differences: the coefficients of Newton's form.
    coefficients: [f64; NODES],
}

const NODES: usize = 8;

/// Steps that nearly always suffice from where the polynomial lets them begin.
const PLAIN_STEPS: usize = 3;

/// A step of Newton's method that is so small, relative to `z`, leads to the root to rounding: its
/// square is what remains, over the distance to where the slope is zero, and where that distance
/// is no greater, rounding leaves more than that.
const CLOSE: f64 = 1e-8;

/// More steps than bisection alone takes.
const STEPS: usize = 200;

impl Arc {
    /// The arc between two `z`, with a polynomial through Chebyshev's nodes of `w`.
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
            // From both ends in turns, for the sake of rounding.
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

    /// `z` at a travel, to three digits.
    #[inline]
    fn start(&self, travel: f64) -> f64 {
        let w = self.w(travel);
        let terms = self.nodes.iter().zip(&self.coefficients).rev();
        let z = terms.fold(0.0, |sum, (node, coefficient)| sum * (w - node) + coefficient);
        z.clamp(self.z[0], self.z[1])
    }

    /// `z` at a travel, that of the nearer end outside this arc.
    pub(crate) fn z_at(&self, path: &Path, travel: f64) -> f64 {
        if travel <= self.travel[0] {
            return self.z[0];
        }
        if travel >= self.travel[1] {
            return self.z[1];
        }
        self.locate(path, travel).z()
    }

    /// The contact at a travel on this arc, at the nearer end outside.
    #[inline]
    pub(crate) fn locate(&self, path: &Path, travel: f64) -> Contact {
        let [contact] = Self::locate_all([self], path, [travel]);
        contact
    }

    /// The same for several arcs and travels, each with its own bits whatever its neighbours. A step
    /// waits for the one before it; steps for several contacts need not wait for each other.
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
            // Also false if the step is not a number.
            if steps[i].abs() <= CLOSE * z[i] {
                path.position(z[i])
            } else {
                arcs[i].search(path, travels[i])
            }
        })
    }

    /// As [`Self::locate`], whatever the polynomial says: by Newton's method while its steps stay within the arc and
    /// shrink, by bisection where they do not.
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
