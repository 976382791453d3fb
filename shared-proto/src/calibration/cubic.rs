//! The `cubic` model in single precision.

use super::Range;
use crate::{AXES, CHANNELS};

/// Features of the model: z, z², z³ of each channel, channel by channel.
pub const FEATURES: usize = 3 * CHANNELS;

/// Powers of the readings.
///
/// Every reading r is made `z = (r - centre) · scale`, and the wrench is the sum of z, z², z³ of each channel
/// times their coefficients, plus the intercept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cubic {
    /// Centre of each channel, in counts of a sample's readings.
    pub centre: [f32; CHANNELS],
    /// One over the spread of each channel, in 1/count.
    pub scale: [f32; CHANNELS],
    /// Per feature (z1, z1², z1³, z2, …), the coefficients of Fx, Fy, Fz in N, Mx, My, Mz in N·m.
    pub coefficients: [[f32; AXES]; FEATURES],
    /// What is added to each axis, in N and N·m.
    pub intercept: [f32; AXES],
}

impl Cubic {
    /// Its kind, the first byte.
    pub(super) const KIND: u8 = 1;

    /// Length in bytes.
    pub(super) const SIZE: usize = 4 + 4 * (2 * CHANNELS + FEATURES * AXES + AXES);

    /// Without numbers.
    pub(super) const BLANK: Self = Self {
        centre: [0.0; CHANNELS],
        scale: [0.0; CHANNELS],
        coefficients: [[0.0; AXES]; FEATURES],
        intercept: [0.0; AXES],
    };

    /// Calls `number` for each of its numbers in their order, with the range that it is in, until one is not taken.
    pub(super) fn each(
        &mut self,
        mut number: impl FnMut(&mut f32, &Range) -> Option<()>,
    ) -> Option<()> {
        let parts: [&mut [f32]; 4] = [
            &mut self.centre,
            &mut self.scale,
            self.coefficients.as_flattened_mut(),
            &mut self.intercept,
        ];
        parts.into_iter().flatten().try_for_each(|value| number(value, &(f32::MIN..=f32::MAX)))
    }
}
