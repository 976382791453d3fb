//! A stretch of a tip's way on which everything is smooth and the body only moves forward.

use core::array::from_fn;

use libm::sqrt;

use crate::contact::Contact;
use crate::path::Path;
use crate::start::Start;

/// From `z[0]` to `z[1]`, where the body has travelled `travel[0]` to `travel[1]` since the touch.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Arc {
    pub(crate) z: [f64; 2],
    pub(crate) travel: [f64; 2],
    start: Start,
}

/// A step of Newton's method that is so small, relative to `z`, leads to the root to rounding: its
/// square is what remains, over the distance to where the slope is zero, and where that distance
/// is no greater, rounding leaves more than that.
const CLOSE: f64 = 1e-8;

/// Steps that nearly always suffice from where [`Start`] lets them begin.
const PLAIN_STEPS: usize = 3;

/// More steps than bisection alone takes.
const GUARDED_STEPS: usize = 200;

impl Arc {
    pub(crate) fn new(path: &Path, z: [f64; 2]) -> Self {
        let ends = z.map(|z| path.place(z));
        let travel = [ends[0].travel, ends[1].travel.max(ends[0].travel)];
        let mut arc = Self { z, travel, start: Start::default() };
        arc.start = Start::new(path, &arc, &ends[0]);
        arc
    }

    pub(crate) fn length(&self) -> f64 {
        self.travel[1] - self.travel[0]
    }

    /// `z` at a travel, that of the nearer end outside this arc.
    pub(crate) fn z_at(&self, path: &Path, travel: f64) -> f64 {
        if travel <= self.travel[0] {
            return self.z[0];
        }
        if travel >= self.travel[1] {
            return self.z[1];
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
            let [low, high] = arcs[i].z;
            arcs[i].start.z(arcs[i].travel, travels[i]).clamp(low, high)
        });
        let mut steps = [0.0; N];
        for _ in 0..PLAIN_STEPS {
            for i in 0..N {
                let [low, high] = arcs[i].z;
                steps[i] = path.place(z[i]).newton_step(travels[i]);
                z[i] = (z[i] - steps[i]).clamp(low, high);
            }
        }
        from_fn(|i| {
            // Also false if the step is not a number.
            if steps[i].abs() <= CLOSE * z[i] {
                path.place(z[i])
            } else {
                arcs[i].locate_guarded(path, travels[i])
            }
        })
    }

    /// The same by Newton's method within a bracket that shrinks, and by bisection where that does
    /// not converge.
    #[cold]
    pub(crate) fn locate_guarded(&self, path: &Path, travel: f64) -> Contact {
        if travel <= self.travel[0] {
            return path.place(self.z[0]);
        }
        if travel >= self.travel[1] {
            return path.place(self.z[1]);
        }
        let [mut low, mut high] = self.z;
        let mut z = 0.5 * (low + high);
        let mut last_step = high - low;
        let mut contact = path.place(z);
        for _ in 0..GUARDED_STEPS {
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
            contact = path.place(z);
            if good && last_step <= CLOSE * z || high - low <= f64::EPSILON * high {
                break;
            }
        }
        contact
    }
}
