//! A range of `z` that holds one root of `s(z) = s`, and the root by a bracketed Newton iteration.

use crate::contact::Contact;
use crate::path::Path;

/// From `z[0]` to `z[1]`, where the body has travelled `travel[0]` to `travel[1]` since the touch.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Bracket {
    pub(crate) z: [f64; 2],
    pub(crate) travel: [f64; 2],
}

/// A step of Newton's method that is so small, relative to `z`, leads to the root to rounding: its
/// square is what remains, over the distance to where the slope is zero, and where that distance
/// is no greater, rounding leaves more than that.
pub(crate) const CLOSE: f64 = 1e-8;

/// More steps than bisection alone takes.
const STEPS: usize = 200;

impl Bracket {
    /// The contact at a travel, at the nearer end outside this bracket: by Newton's method while its
    /// steps stay within the bracket and shrink, by bisection where they do not.
    #[cold]
    pub(crate) fn locate(&self, path: &Path, travel: f64) -> Contact {
        if travel <= self.travel[0] {
            return path.position(self.z[0]);
        }
        if travel >= self.travel[1] {
            return path.position(self.z[1]);
        }
        let [mut low, mut high] = self.z;
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
