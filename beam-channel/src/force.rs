use libm::{atan2, sqrt};

use crate::path::{Contact, Path};
use crate::setup::LEAST_FRICTION;
use crate::{Angle, Normal, Setup, Wall};

/// The force of one beam on the body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BeamForce {
    /// Forward force, N: negative resists.
    pub fx_n: f64,
    /// Force to the left, N.
    pub fy_n: f64,
    /// Moment about the body's middle, N·m, positive from x to y.
    pub mz_nm: f64,
    /// `Δθ`, rad.
    pub deflection_rad: f64,
}

/// The paper's force of a beam, `(k_t/L)·Δθ·(n̂ + μ_k·t̂)`. Bar and spring balance if the component
/// across the bar, along `ê = (upright, reach)/L`, is `(k_t/L)·Δθ`: if requested, the force is
/// divided by `(n̂ + μ_k·t̂)·ê`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Law {
    stiffness: f64,
    friction: f64,
    angle: Angle,
    normal: Normal,
    axes: f64,
}

impl Law {
    pub(crate) fn new(setup: &Setup) -> Self {
        let (rx, ry) = (setup.ellipse.semi_length_m, setup.ellipse.semi_width_m);
        Self {
            stiffness: setup.beam.torsional_stiffness() / setup.beam.length_m,
            friction: setup.beam.friction,
            angle: setup.rules.angle,
            normal: setup.rules.normal,
            axes: rx * rx + ry * ry,
        }
    }

    #[inline]
    pub(crate) fn force(&self, path: &Path, contact: &Contact, wall: Wall) -> BeamForce {
        let deflection_rad = self.deflection(path, contact);
        let push = self.push(path, contact);
        let Contact { sin, cos, back, out, .. } = *contact;
        let fx_n = -push * (out + self.friction * back);
        let fy_n = -push * (back - self.friction * out);
        let (x, y) = (path.half_length * cos + path.shear * sin, path.half_width * sin);
        let (mz_nm, sign) = (x * fy_n - y * fx_n, wall.sign());
        BeamForce { fx_n, fy_n: sign * fy_n, mz_nm: sign * mz_nm, deflection_rad }
    }

    pub(crate) fn drag(&self, path: &Path, contact: &Contact) -> f64 {
        self.push(path, contact) * (contact.out + self.friction * contact.back)
    }

    /// Returns the factor that turns normal and tangent into forces, N/m.
    #[inline]
    fn push(&self, path: &Path, contact: &Contact) -> f64 {
        // EI/L² is k_t/L.
        self.stiffness
            * match &path.bending {
                None => self.deflection(path, contact) / self.divisor(path, contact),
                Some(bending) => contact.z() * bending.piece(contact.z()).push.at(contact.z()).0,
            }
    }

    /// Returns a value with the sign and size of `d drag/d travel`, N/m, on the arc of `contact`:
    /// `drag = (k_t/L)·Δθ·n/N`, `n = out + μ·back`, `dΔθ/dτ = ±out/r`, `ds/dτ = steepness/r`.
    pub(crate) fn drag_slope(&self, path: &Path, contact: &Contact) -> f64 {
        let Contact { rise, reach_m: reach, sin, cos, back, out, steepness, .. } = *contact;
        let push = out + self.friction * back;
        let back_slope = path.half_length * cos + path.shear * sin;
        let out_slope = -path.half_width * sin;
        let push_slope = out_slope + self.friction * back_slope;
        if let Some(bending) = &path.bending {
            let (over_z, slope) = bending.piece(contact.z()).push.at(contact.z());
            let of_z = (over_z + contact.z() * slope) * push
                + over_z * push_slope * 4.0 * contact.sin_a / contact.cos_a;
            return self.stiffness * of_z / contact.slope();
        }
        // Relative slope of the divisor.
        let divisor_slope = match self.normal {
            Normal::Unit | Normal::Elastica | Normal::Plate => {
                (back * back_slope + out * out_slope) / self.square(contact)
            }
            Normal::AsPrinted => -(back * back_slope + out * out_slope) / self.square(contact),
            Normal::MomentBalance => {
                let upright = path.beam - rise;
                let along = back - self.friction * out;
                let along_slope = back_slope - self.friction * out_slope;
                let slope = upright * push_slope - out * push
                    + reach * along_slope
                    + upright * out * along / reach;
                slope / (upright * push + reach * along)
            }
        };
        let past = self.angle == Angle::Folded && rise > path.beam;
        let turned = if past { -out } else { out };
        let slope = turned * push
            + reach * self.deflection(path, contact) * (push_slope - push * divisor_slope);
        self.stiffness * slope / (self.divisor(path, contact) * steepness)
    }

    /// Returns `Δθ`, rad. The arctangent is exact to rounding near 90°, unlike the paper's arcsine.
    #[inline]
    fn deflection(&self, path: &Path, contact: &Contact) -> f64 {
        let upright = path.beam - contact.rise;
        match self.angle {
            Angle::Folded => atan2(contact.reach_m, upright.abs()),
            Angle::True => atan2(contact.reach_m, upright),
        }
    }

    #[inline]
    fn divisor(&self, path: &Path, contact: &Contact) -> f64 {
        match self.normal {
            Normal::Unit | Normal::AsPrinted | Normal::Elastica | Normal::Plate => {
                sqrt(self.square(contact))
            }
            Normal::MomentBalance => self.across(path, contact),
        }
    }

    /// Returns true if the tip slides; without a force across the bar, friction locks it.
    pub(crate) fn slides(&self, path: &Path, contact: &Contact) -> bool {
        self.across(path, contact) > 0.5 * LEAST_FRICTION * sqrt(self.square(contact))
    }

    /// Returns the component of normal and tangent across the bar, unscaled, in m.
    fn across(&self, path: &Path, contact: &Contact) -> f64 {
        let Contact { rise, reach_m: reach, back, out, .. } = *contact;
        let (push, along) = (out + self.friction * back, back - self.friction * out);
        ((path.beam - rise) * push + reach * along) / path.beam
    }

    /// Returns the squared length of normal and tangent by the paper's definition, m².
    #[inline]
    fn square(&self, contact: &Contact) -> f64 {
        let length = contact.back * contact.back + contact.out * contact.out;
        match self.normal {
            Normal::Unit | Normal::MomentBalance | Normal::Elastica | Normal::Plate => length,
            // R_x² cos² φ + R_y² sin² φ, whereas the above is R_y² cos² φ + R_x² sin² φ.
            Normal::AsPrinted => self.axes - length,
        }
    }
}
