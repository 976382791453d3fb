//! Sums of errors on held-out rows.

use crate::quality::AxisQuality;
use shell_data::wrench::PerAxis;

/// The level of the intervals whose coverage is counted.
pub const COVERAGE_LEVEL: f64 = 0.95;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HeldOutErrors {
    pub rows: u64,
    /// Predicted minus measured, in N or N·m.
    pub sum: f64,
    pub squares: f64,
}

impl HeldOutErrors {
    pub fn merge(&mut self, other: &HeldOutErrors) {
        self.rows += other.rows;
        self.sum += other.sum;
        self.squares += other.squares;
    }

    pub fn total<'a>(parts: impl IntoIterator<Item = &'a PerAxis<Self>>) -> PerAxis<Self> {
        let mut total = PerAxis::<Self>::default();
        for part in parts {
            total.iter_mut().zip(part).for_each(|(total, part)| total.merge(part));
        }
        total
    }

    /// NaN for zero rows.
    pub fn rms(&self) -> f64 {
        (self.squares / self.rows as f64).sqrt()
    }

    /// NaN for zero rows.
    pub fn bias(&self) -> f64 {
        self.sum / self.rows as f64
    }

    /// Quality of a fit. `total` is the sum of squared deviations of the measured wrench from its mean.
    pub(crate) fn quality(&self, total: f64) -> AxisQuality {
        let r_squared = (total > 0.0).then(|| 1.0 - self.squares / total);
        AxisQuality { rms: self.rms(), max: None, bias: self.bias(), r_squared }
    }
}
