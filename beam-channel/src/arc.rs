//! A stretch of a tip's way on which everything is smooth and the body only moves forward.

use libm::sqrt;

use crate::contact::Contact;
use crate::path::Path;

/// From `z[0]` to `z[1]`, where the body has travelled `travel[0]` to `travel[1]` since the touch.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Arc {
    pub(crate) z: [f64; 2],
    pub(crate) travel: [f64; 2],
    /// Slopes at the two ends of `travel` over `z`, both scaled to run from 0 to 1.
    slopes: [f64; 2],
}

/// A first guess needs no more: the step after this one is exact to rounding.
const CLOSE: f64 = 1e-8;

/// More steps than bisection alone takes from one end of the numbers to the other.
const STEPS: usize = 200;

impl Arc {
    pub(crate) fn new(path: &Path, z: [f64; 2]) -> Self {
        let ends = z.map(|z| path.place(z));
        let travel = [ends[0].travel, ends[1].travel.max(ends[0].travel)];
        let scale = (z[1] - z[0]) / (travel[1] - travel[0]);
        let slopes = ends.map(|end| {
            let slope = end.slope() * scale;
            if slope.is_finite() { slope.clamp(0.0, 3.0) } else { 1.0 }
        });
        Self { z, travel, slopes }
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

    /// The contact at a travel on this arc: Newton's method within a bracket that shrinks, and
    /// bisection where that does not converge.
    #[inline]
    pub(crate) fn locate(&self, path: &Path, travel: f64) -> Contact {
        if travel <= self.travel[0] {
            return path.place(self.z[0]);
        }
        if travel >= self.travel[1] {
            return path.place(self.z[1]);
        }
        let [mut low, mut high] = self.z;
        let mut z = self.guess(travel);
        let mut last_step = high - low;
        let mut contact = path.place(z);
        for _ in 0..STEPS {
            if contact.travel > travel {
                high = z;
            } else {
                low = z;
            }
            let newton = contact.newton_step(travel);
            let next = z - newton;
            // Also false if the step is not a number.
            let good = next >= low && next <= high && 2.0 * newton.abs() <= last_step;
            let next = if good { next } else { 0.5 * (low + high) };
            let step = (next - z).abs();
            z = next;
            contact = path.place(z);
            if step <= CLOSE * z && good || high - low <= f64::EPSILON * high {
                break;
            }
            last_step = step;
        }
        contact
    }

    /// `z` from the cubic that has the ends and end slopes of the arc.
    #[inline]
    fn guess(&self, travel: f64) -> f64 {
        // From the far end, where the slope is often zero.
        let v = (self.travel[1] - travel) / self.length();
        let [m, c] = self.slopes;
        let (square, cube) = (3.0 - 2.0 * c - m, c + m - 2.0);
        let mut y = sqrt(v);
        for _ in 0..2 {
            let value = y * (c + y * (square + y * cube)) - v;
            let slope = c + y * (2.0 * square + y * 3.0 * cube);
            y -= value / slope;
        }
        let z = self.z[1] - y * (self.z[1] - self.z[0]);
        if z > self.z[0] && z < self.z[1] { z } else { 0.5 * (self.z[0] + self.z[1]) }
    }
}
