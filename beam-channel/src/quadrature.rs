//! Integrals over the body's path, as integrals over `z`.
//!
//! The drag of a beam is smooth in `z` on every arc, so Gauss–Legendre quadrature converges
//! geometrically; samples over positions have a corner at every touch and a jump at every release.

use crate::arc::Arc;
use crate::{Model, Side};

/// Gauss–Legendre nodes and weights of order 20, positive half (Abramowitz and Stegun, table 25.4).
#[expect(clippy::excessive_precision, reason = "as the table has them")]
const NODES: [(f64, f64); 10] = [
    (0.076_526_521_133_497_333_75, 0.152_753_387_130_725_850_70),
    (0.227_785_851_141_645_078_08, 0.149_172_986_472_603_746_79),
    (0.373_706_088_715_419_560_67, 0.142_096_109_318_382_051_33),
    (0.510_867_001_950_827_098_00, 0.131_688_638_449_176_626_90),
    (0.636_053_680_726_515_025_45, 0.118_194_531_961_518_417_31),
    (0.746_331_906_460_150_792_61, 0.101_930_119_817_240_435_04),
    (0.839_116_971_822_218_823_39, 0.083_276_741_576_704_748_72),
    (0.912_234_428_251_325_905_87, 0.062_672_048_334_109_063_57),
    (0.963_971_927_277_913_791_27, 0.040_601_429_800_386_941_33),
    (0.993_128_599_185_094_924_79, 0.017_614_007_139_152_118_31),
];

/// Relative difference of two results due to rounding.
const AGREEMENT: f64 = 4.0 * f64::EPSILON;

const PIECES: u32 = 256;

/// Integrates `f` on more and more equal pieces, until the result no longer changes.
pub(crate) fn integrate(f: impl Fn(f64) -> f64, from: f64, to: f64) -> f64 {
    let on = |pieces: u32| {
        let half = 0.5 * (to - from) / f64::from(pieces);
        let mut sum = 0.0;
        for piece in 0..pieces {
            let middle = from + half * f64::from(2 * piece + 1);
            for (node, weight) in NODES {
                sum += weight * (f(middle - half * node) + f(middle + half * node));
            }
        }
        half * sum
    };
    let mut pieces = 1;
    let mut coarse = on(pieces);
    loop {
        pieces *= 2;
        let fine = on(pieces);
        if (fine - coarse).abs() <= AGREEMENT * fine.abs() || pieces >= PIECES {
            return fine;
        }
        coarse = fine;
    }
}

impl Model {
    /// Returns the work on all beams, J, while the body's middle moves from `from_m` to `to_m`, m
    /// past the first beam: the integral of the drag.
    pub fn work(&self, from_m: f64, to_m: f64) -> f64 {
        let channel = &self.setup().channel;
        let of_side = |side: &Side| {
            let passage = self.passage(side);
            let at = |x: f64| side.touching(x, channel.beams, channel.pitch_m);
            (at(from_m).start..at(to_m).end)
                .map(|beam| {
                    let travel =
                        |x| side.travel_at(x, self.base_m(beam)).clamp(0.0, side.travel_m());
                    let (from, to) = (travel(from_m), travel(to_m));
                    if from <= 0.0 && to >= side.travel_m() {
                        passage
                    } else {
                        self.partial_passage(side, from, to)
                    }
                })
                .fold(0.0, |sum, work| sum + work)
        };
        self.weight() * self.solved().fold(0.0, |sum, side| sum + of_side(side))
    }

    /// Returns the work of the body on all beams in a whole passage, J.
    pub fn energy(&self) -> f64 {
        // An empty sum would be −0.
        let passages = self.solved().fold(0.0, |sum, side| sum + self.passage(side));
        self.weight() * f64::from(self.setup().channel.beams) * passages
    }

    pub(crate) fn passage(&self, side: &Side) -> f64 {
        side.arcs().iter().map(|arc| self.work_on(side, arc.z)).sum()
    }

    fn partial_passage(&self, side: &Side, from: f64, to: f64) -> f64 {
        let part = |arc: &Arc| {
            let z = [from, to].map(|travel| arc.z_at(&side.path, travel));
            if z[1] > z[0] { self.work_on(side, z) } else { 0.0 }
        };
        side.arcs().iter().map(part).sum()
    }

    fn work_on(&self, side: &Side, [from, to]: [f64; 2]) -> f64 {
        let path = &side.path;
        let integrand = |z| {
            let contact = path.position(z);
            self.law.drag(path, &contact) * contact.slope()
        };
        integrate(integrand, from, to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rule_is_exact_for_polynomials_up_to_degree_39() {
        // ∫ (1 + x)ⁿ dx over [−1, 1] = 2ⁿ⁺¹/(n + 1), with all powers of x: 21 rounded terms.
        let rule = |n: i32| {
            let term = |x: f64| libm::pow(1.0 + x, f64::from(n));
            NODES.iter().map(|&(x, weight)| weight * (term(x) + term(-x))).sum::<f64>()
        };
        for n in 0..40 {
            let exact = libm::pow(2.0, f64::from(n + 1)) / f64::from(n + 1);
            assert!((rule(n) / exact - 1.0).abs() < 1e-14, "{n}: {} {exact}", rule(n));
        }
    }
}
