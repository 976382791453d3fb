//! Range of an analogue-to-digital converter, which defines when a reading is saturated.

/// The range of a converter, in counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Converter {
    /// 0, or minus half the range for a signed converter.
    pub low: f64,
    pub high: f64,
}

impl Converter {
    pub const fn new(high: f64) -> Self {
        Self { low: 0.0, high }
    }

    /// Returns the smallest usual converter (12, 16, 24 or 32 bits) with `min` to `max` in its range; signed if `min`
    /// is negative. `None` if readings may be in volts, or exceed 32 bits.
    pub fn of_extremes(min: f64, max: f64) -> Option<Self> {
        let is_whole = |value: f64| value.fract() == 0.0;
        let is_large = max.abs().max(min.abs()) > LARGEST_VOLTAGE;
        if !(is_large || (is_whole(min) && is_whole(max) && max > 1.0)) {
            return None;
        }
        let converters = [12, 16, 24, 32].map(|bits| {
            let range = 2_f64.powi(bits);
            match min < 0.0 {
                true => Self { low: -range / 2.0, high: range / 2.0 - 1.0 },
                false => Self::new(range - 1.0),
            }
        });
        converters.into_iter().find(|of| of.low <= min && max <= of.high)
    }

    /// Returns true at an end of the range, or for NaN. A negative reading comes from a signed
    /// converter, so it is not at the end of a range from 0.
    pub fn is_at_end(self, reading: f64) -> bool {
        let is_low = if self.low < 0.0 { reading <= self.low } else { reading == 0.0 };
        is_low || reading >= self.high || reading.is_nan()
    }
}

/// The largest fractional reading that may be in volts.
const LARGEST_VOLTAGE: f64 = 50.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_equals_that_of_the_smallest_converter_that_fits() {
        for (min, max, ends) in [
            (1.0, 4000.0, Some((0.0, 4095.0))),
            (0.0, 4095.0, Some((0.0, 4095.0))),
            (12.25, 4096.0, Some((0.0, 65_535.0))),
            (100.0, 9e6, Some((0.0, 16_777_215.0))),
            (-300.0, 300.0, Some((-2048.0, 2047.0))),
            (-3000.0, 3000.0, Some((-32_768.0, 32_767.0))),
            (-2e6, 5e6, Some((-8_388_608.0, 8_388_607.0))),
            (0.02, 3.3, None),
            (-9.5, 9.5, None),
            (0.0, 1.0, None),
        ] {
            let found = Converter::of_extremes(min, max).map(|of| (of.low, of.high));
            assert_eq!(found, ends, "{min} to {max}");
        }
    }

    #[test]
    fn readings_of_a_signed_converter_are_alive() {
        let signed = Converter::of_extremes(-3000.0, 3000.0).unwrap();
        assert!([0.0, -1.0, -32_767.0].iter().all(|&reading| !signed.is_at_end(reading)));
        assert!([-32_768.0, 32_767.0, f64::NAN].iter().all(|&reading| signed.is_at_end(reading)));
        let unsigned = Converter::new(4095.0);
        assert!([0.0, 4095.0, 5000.0].iter().all(|&reading| unsigned.is_at_end(reading)));
        assert!([1.0, -5.0].iter().all(|&reading| !unsigned.is_at_end(reading)));
    }
}
