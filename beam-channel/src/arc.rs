//! A stretch of a tip's way on which everything is smooth and the body only moves forward.

use core::array::from_fn;

use libm::sqrt;

use crate::bracket::{Bracket, CLOSE};
use crate::contact::Contact;
use crate::path::Path;
use crate::start::Start;

/// A bracket with a polynomial that says where Newton's method starts in it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Arc {
    pub(crate) bracket: Bracket,
    start: Start,
}

/// Steps that nearly always suffice from where [`Start`] lets them begin.
const PLAIN_STEPS: usize = 3;

impl Arc {
    pub(crate) fn new(path: &Path, z: [f64; 2]) -> Self {
        let ends = z.map(|z| path.position(z));
        let travel = [ends[0].travel, ends[1].travel.max(ends[0].travel)];
        let bracket = Bracket { z, travel };
        Self { bracket, start: Start::new(path, &bracket, &ends[0]) }
    }

    /// `z` at a travel, that of the nearer end outside this arc.
    pub(crate) fn z_at(&self, path: &Path, travel: f64) -> f64 {
        let Bracket { z, travel: ends } = self.bracket;
        if travel <= ends[0] {
            return z[0];
        }
        if travel >= ends[1] {
            return z[1];
        }
        sqrt(self.locate(path, travel).sin_a)
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
        let mut z: [f64; N] = from_fn(|i| {
            let Bracket { z: [low, high], travel } = arcs[i].bracket;
            arcs[i].start.z(travel, travels[i]).clamp(low, high)
        });
        let mut steps = [0.0; N];
        for _ in 0..PLAIN_STEPS {
            for i in 0..N {
                let [low, high] = arcs[i].bracket.z;
                steps[i] = path.position(z[i]).newton_step(travels[i]);
                z[i] = (z[i] - steps[i]).clamp(low, high);
            }
        }
        from_fn(|i| {
            // Also false if the step is not a number.
            if steps[i].abs() <= CLOSE * z[i] {
                path.position(z[i])
            } else {
                arcs[i].bracket.locate(path, travels[i])
            }
        })
    }
}
