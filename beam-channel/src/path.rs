//! The path of a beam's tip along the body, in a variable in which it is algebraic and smooth.
//!
//! Seen from a wall, with x forward and y towards it, the ellipse is `x = W·cos τ + S·sin τ`,
//! `y = H·sin τ`: upright (`W = R_x`, `S = 0`, `H = R_y`) or, if the body is yawed, sheared. The
//! tips of the unbent beams lie on `y = g`, which the ellipse crosses at `sin τ_e = g/H`.

use libm::{atan2, cbrt, sqrt};

use crate::bending::Bending;

/// Ellipse, wall line and beam length, which determine the path of a tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Path {
    pub(crate) half_length: f64,
    pub(crate) shear: f64,
    /// `H`: extent of the ellipse towards the wall.
    pub(crate) half_width: f64,
    pub(crate) beam: f64,
    pub(crate) sin_e: f64,
    pub(crate) cos_e: f64,
    /// Position of the tip of a bending beam; a bar's follows from its length.
    pub(crate) bending: Option<Bending>,
}

impl Path {
    /// Returns the tip's position at `z = √sin((τ − τ_e)/2)`, from 0 to [`last`](Self::last).
    ///
    /// With `a = (τ − τ_e)/2` the ellipse rises above the wall line by `h = H(sin τ − sin τ_e) =
    /// 2H·cos(τ_e + a)·sin a`. The tip has moved forward by `r = √(h(2L − h)) = z·√(2H·cos(τ_e +
    /// a)·(2L − h))`, and the body since the first touch by
    /// `s = x(τ_e) − x(τ) + r = 2z²(W·sin(τ_e + a) − S·cos(τ_e + a)) + r`. No step subtracts numbers
    /// of similar size.
    #[inline]
    pub(crate) fn position(&self, z: f64) -> Contact {
        let Self { half_length, shear, half_width, beam, sin_e, cos_e, ref bending } = *self;
        let sin_a = z * z;
        let cos_a = sqrt((1.0 - sin_a) * (1.0 + sin_a));
        let sin_mid = sin_e * cos_a + cos_e * sin_a;
        let cos_mid = cos_e * cos_a - sin_e * sin_a;
        let sin = sin_mid * cos_a + cos_mid * sin_a;
        let cos = cos_mid * cos_a - sin_mid * sin_a;
        let width = 2.0 * half_width * cos_mid;
        let rise = width * sin_a;
        let bar = sqrt((width * (2.0 * beam - rise)).max(f64::MIN_POSITIVE));
        let back = half_length * sin - shear * cos;
        let out = half_width * cos;
        let (root, steepness) = match bending {
            None => (bar, z * bar * back + out * (beam - rise)),
            Some(bending) => {
                let (root, slope) = bending.piece(z).reach.at(z);
                (root, root * (z * back + 0.25 * cos_a * (root + z * slope)))
            }
        };
        let reach = z * root;
        Contact {
            travel: 2.0 * sin_a * (half_length * sin_mid - shear * cos_mid) + reach,
            rise,
            reach_m: reach,
            sin,
            cos,
            back,
            out,
            sin_a,
            cos_a,
            root,
            steepness,
        }
    }

    /// Returns `z` at the slowest progress on the way in, where the body moves on, and after the release.
    pub(crate) fn landmarks(&self) -> [f64; 3] {
        match &self.bending {
            None => [self.slowest(), self.widest(), self.last()],
            Some(bending) => bending.landmarks,
        }
    }

    /// Returns `z` where the ellipse comes back to the wall line, `τ = π − τ_e`.
    pub(crate) fn last(&self) -> f64 {
        sqrt(self.cos_e)
    }

    /// Returns `z` where the ellipse is widest, `τ = π/2`.
    fn widest(&self) -> f64 {
        // sin² a = (1 − cos 2a)/2 with cos 2a = sin τ_e, and cos² τ_e = (1 − sin τ_e)(1 + sin τ_e).
        sqrt(self.cos_e / sqrt(2.0 * (1.0 + self.sin_e)))
    }

    /// Returns `z` on the way in and out where the ellipse is `rise`, at most
    /// [`depth`](Self::depth), above the wall line.
    pub(crate) fn at_rise(&self, rise: f64) -> [f64; 2] {
        let sin = self.sin_e + rise / self.half_width;
        let cos = sqrt(((1.0 - sin) * (1.0 + sin)).max(0.0));
        // 2·cos(τ_e + a)·sin a = rise/H, where cos(τ_e + a) follows from the half-angle formula.
        [cos, -cos].map(|cos| {
            let cos_2a = self.cos_e * cos + self.sin_e * sin;
            let sin_2a = self.cos_e * sin - self.sin_e * cos;
            let sin_a = sin_2a / sqrt(2.0 * (1.0 + cos_2a));
            sqrt(sin_a.max(0.0))
        })
    }

    /// Returns the extent of the ellipse beyond the wall line, `d`, m.
    pub(crate) fn depth(&self) -> f64 {
        let Self { half_width, sin_e, cos_e, .. } = *self;
        half_width * cos_e * cos_e / (1.0 + sin_e)
    }

    /// Returns `z` on the way in where the body's progress per turn of the beam is slowest.
    ///
    /// There `ds/dτ` has the sign of `E = W·tan τ + H·cot θ − S`, with the angle `θ` of the beam,
    /// `cos θ = (L − h)/L`. `E` falls from `∞` at the first touch to a single minimum and rises to
    /// `∞` at the widest position: its derivative has the sign of `κ²·sin² θ − cos² τ`, `κ³ =
    /// W·L/H²`, quadratic in `h`, negative at the first touch and positive at the widest position.
    /// So the travel falls with `z` on at most one interval on the way in. On the way out `E` rises
    /// throughout, and the travel has one maximum.
    fn slowest(&self) -> f64 {
        let Self { half_length, half_width, beam, sin_e, cos_e, .. } = *self;
        let kappa = cbrt(half_length * beam / (half_width * half_width));
        // In units of H: h = H·x and L = H·l.
        let l = beam / half_width;
        let square = 1.0 - kappa * kappa / (l * l);
        let linear = 2.0 * sin_e + 2.0 * kappa * kappa / l;
        let root = sqrt((linear * linear + 4.0 * square * cos_e * cos_e).max(0.0));
        let rise = 2.0 * cos_e * cos_e / (linear + root);
        self.at_rise((half_width * rise).min(self.depth()))[0]
    }
}

/// A beam's tip on the body, seen from its wall: x forward, y towards the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    pub(crate) travel: f64,
    pub(crate) rise: f64,
    /// Forward displacement of the tip by the body, m.
    pub reach_m: f64,
    pub(crate) sin: f64,
    pub(crate) cos: f64,
    /// `−dx/dτ` and `dy/dτ` of the ellipse: the inward normal is `−(out, back)`, unscaled.
    pub(crate) back: f64,
    pub(crate) out: f64,
    pub(crate) sin_a: f64,
    pub(crate) cos_a: f64,
    pub(crate) root: f64,
    /// `reach·ds/dτ`, with the sign of `ds/dz`.
    pub(crate) steepness: f64,
}

impl Contact {
    pub(crate) fn z(&self) -> f64 {
        sqrt(self.sin_a)
    }

    /// Returns `ds/dz`, m.
    pub(crate) fn slope(&self) -> f64 {
        4.0 * self.steepness / (self.cos_a * self.root)
    }

    /// Returns `(s − target)/(ds/dz)`, Newton's step.
    #[inline]
    pub(crate) fn newton_step(&self, target: f64) -> f64 {
        (self.travel - target) * self.cos_a * self.root / (4.0 * self.steepness)
    }

    /// Returns `τ − τ_e`, rad.
    pub(crate) fn turn(&self) -> f64 {
        2.0 * atan2(self.sin_a, self.cos_a)
    }
}
