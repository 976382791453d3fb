//! Equal bins whose width doubles as the data spread.
//!
//! Bin `i` at exponent `k` covers `[i·2ᵏ, (i+1)·2ᵏ)`, so the bins of one exponent nest exactly in
//! those of the next. The exponent is the smallest at which the range seen so far fits into the
//! bins that there are: it depends on that range alone, not on the order in which it was seen.

/// A window of bins over the real line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Bins {
    /// Bins are 2^exponent wide.
    pub(super) exponent: i32,
    /// Index of the first bin of the window.
    pub(super) first: i64,
    /// Number of bins in the window.
    pub(super) count: usize,
}

/// Indices stay exact integers in `f64`.
const LARGEST_INDEX: f64 = (1u64 << 52) as f64;
/// Below this width a scale factor would leave the range of `f64`.
const SMALLEST_EXPONENT: i32 = -1000;

impl Bins {
    /// The window of `count` bins around the finite range `[low, high]`, in its middle.
    pub(super) fn around(low: f64, high: f64, count: usize) -> Self {
        Self::around_from(SMALLEST_EXPONENT, low, high, count)
    }

    /// As [`Self::around`], with bins at least `2^exponent` wide.
    pub(super) fn around_from(exponent: i32, low: f64, high: f64, count: usize) -> Self {
        // An exponent that is certainly too small, near enough to try the next few.
        let width = (high / count as f64 - low / count as f64)
            .max(high.abs().max(low.abs()) * 2f64.powi(-52));
        let estimate =
            if width > 0.0 { width.log2().floor() as i32 - 1 } else { SMALLEST_EXPONENT };
        let mut exponent = exponent.max(estimate);
        loop {
            let (from, to) = (floor_index(low, exponent), floor_index(high, exponent));
            if from.abs().max(to.abs()) < LARGEST_INDEX && to - from < count as f64 {
                let spare = count as i64 - 1 - (to - from) as i64;
                return Self { exponent, first: from as i64 - spare / 2, count };
            }
            exponent += 1;
        }
    }

    /// A window that holds the finite range `[low, high]`: this one if it does, else one with the same or wider bins.
    pub(super) fn widened(self, low: f64, high: f64) -> Self {
        match self.contains(low) && self.contains(high) {
            true => self,
            false => Self::around_from(self.exponent, low, high, self.count),
        }
    }

    /// Whether a value lies in the window.
    pub(super) fn contains(&self, value: f64) -> bool {
        let offset = floor_index(value, self.exponent) - self.first as f64;
        offset >= 0.0 && offset < self.count as f64
    }

    /// A function from a value in the window to its position there.
    pub(super) fn locator(&self) -> impl Fn(f64) -> usize + use<> {
        let (scale, first) = (2f64.powi(-self.exponent), self.first as f64);
        move |value| ((value * scale).floor() - first) as usize
    }

    /// Where bin `position` of the finer or equal `other` falls in this window.
    pub(super) fn position_of(&self, other: &Self, position: usize) -> usize {
        let index = (other.first + position as i64) >> (self.exponent - other.exponent).min(63);
        (index - self.first) as usize
    }

    /// Lower edge of the bin at `position`; that of `position + 1` is its upper edge.
    pub(super) fn edge(&self, position: usize) -> f64 {
        (self.first + position as i64) as f64 * 2f64.powi(self.exponent)
    }

    /// The same line in bins 2^`doublings` times as wide, window as narrow as can be.
    pub(super) fn coarsened(&self, doublings: u32) -> Self {
        let first = self.first >> doublings;
        let last = (self.first + self.count as i64 - 1) >> doublings;
        Self {
            exponent: self.exponent + doublings as i32,
            first,
            count: (last - first + 1) as usize,
        }
    }
}

fn floor_index(value: f64, exponent: i32) -> f64 {
    (value * 2f64.powi(-exponent)).floor()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_window_holds_the_range_with_at_least_half_of_its_bins(
            low in -1e9..1e9_f64, span in 1e-6..1e9_f64,
        ) {
            let high = low + span;
            let bins = Bins::around(low, high, 256);
            prop_assert!(bins.contains(low) && bins.contains(high));
            let used = bins.locator()(high) - bins.locator()(low) + 1;
            // One bin finer would not have fitted: at least 257 bins of half the width.
            prop_assert!((128..=256).contains(&used), "{used}");
        }

        #[test]
        fn coarse_bins_hold_what_the_fine_ones_held(value in -1e3..1e3_f64, more in 0.0..1e6_f64) {
            let fine = Bins::around(value, value + 1e-3, 64);
            let coarse = Bins::around_from(fine.exponent, value - more, value + 1.0, 64);
            let position = coarse.position_of(&fine, fine.locator()(value));
            prop_assert_eq!(position, coarse.locator()(value));
            let coarser = fine.coarsened(3);
            prop_assert_eq!(coarser.position_of(&fine, fine.locator()(value)), coarser.locator()(value));
        }
    }

    #[test]
    fn ranges_at_the_ends_of_what_a_double_can_hold() {
        for (low, high) in [
            (0.0, 0.0),
            (-0.0, 0.0),
            (5e-324, 5e-324),
            (-5e-324, 5e-324),
            (1e300, 1e300),
            (f64::MIN, f64::MAX),
            (1.0, 1.0 + f64::EPSILON),
        ] {
            let bins = Bins::around(low, high, 16);
            assert!(bins.contains(low) && bins.contains(high), "{low} {high} {bins:?}");
            assert!(bins.edge(0) <= low || bins.edge(0) == f64::NEG_INFINITY);
        }
    }
}
