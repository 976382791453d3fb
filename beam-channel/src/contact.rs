//! Where one beam touches.

use libm::atan2;

/// A beam's tip on the body, seen from its wall: x forward, y towards the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    pub(crate) travel: f64,
    pub(crate) rise: f64,
    pub(crate) reach: f64,
    /// Sine and cosine of `τ`.
    pub(crate) sin: f64,
    pub(crate) cos: f64,
    /// `−dx/dτ` and `dy/dτ` of the ellipse: the inward normal is `−(out, back)`, unscaled.
    pub(crate) back: f64,
    pub(crate) out: f64,
    /// Sine and cosine of `(τ − τ_e)/2`.
    pub(crate) sin_a: f64,
    pub(crate) cos_a: f64,
    /// `reach/z`.
    pub(crate) root: f64,
    /// `reach·ds/dτ`, of the sign of `ds/dz`.
    pub(crate) steepness: f64,
}

impl Contact {
    /// How far the body pushes the tip forward, in m.
    pub fn reach_m(&self) -> f64 {
        self.reach
    }

    /// `ds/dz`, in m.
    pub(crate) fn slope(&self) -> f64 {
        4.0 * self.steepness / (self.cos_a * self.root)
    }

    /// `(s − target)/(ds/dz)`: what Newton's method takes off `z`.
    #[inline]
    pub(crate) fn newton_step(&self, target: f64) -> f64 {
        (self.travel - target) * self.cos_a * self.root / (4.0 * self.steepness)
    }

    /// `τ − τ_e` in rad.
    pub(crate) fn turn(&self) -> f64 {
        2.0 * atan2(self.sin_a, self.cos_a)
    }
}
