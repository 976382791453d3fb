//! Scales that stay as they are while a signal moves a little.

/// The least of 1, 2 and 5 times a power of ten that is not below `largest`, and at least `least`.
pub(crate) fn nice_bound(largest: f64, least: f64) -> f64 {
    let largest = largest.abs().max(least);
    if !largest.is_finite() || largest <= 0.0 {
        return least.max(f64::MIN_POSITIVE);
    }
    let decade = 10_f64.powf(largest.log10().floor());
    // A rounding error in the logarithm must not put the signal outside.
    let steps = [1.0, 2.0, 5.0, 10.0, 20.0].map(|step| step * decade);
    steps.into_iter().find(|&bound| bound >= largest * (1.0 - 1e-12)).unwrap_or(largest)
}

/// A range of round numbers about `low` to `high`, at least `least` long.
pub(crate) fn nice_range(low: f64, high: f64, least: f64) -> (f64, f64) {
    if !(low.is_finite() && high.is_finite() && low <= high) {
        return (0.0, least);
    }
    let length = nice_bound((high - low).max(least), least);
    let step = length / 10.0;
    let start = ((low + high - length) / 2.0 / step).round() * step;
    // Rounding moves by up to half a step at either end.
    match start <= low && high <= start + length {
        true => (start, start + length),
        false => (start - step, start + length + step),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_are_round_and_hold_what_they_are_for() {
        let cases = [(0.0, 0.1), (0.03, 0.1), (0.11, 0.2), (0.2, 0.2), (3.1, 5.0), (70.0, 100.0)];
        for (largest, expected) in cases {
            let bound = nice_bound(largest, 0.1);
            // A power of ten is right to a rounding error.
            assert!((bound - expected).abs() < 1e-12 * expected, "{largest}: {bound}");
        }
        assert_eq!(nice_bound(f64::NAN, 0.1), 0.1);
        assert!(nice_bound(1e-300, 1e-3) >= 1e-3);
    }

    #[test]
    fn ranges_hold_their_values_and_are_not_much_longer() {
        for (low, high) in
            [(1980.0, 2011.0), (0.0, 4095.0), (5.0, 5.0), (-3.0, 40.0), (99.9, 100.1)]
        {
            let (start, end) = nice_range(low, high, 20.0);
            assert!(start <= low && high <= end, "{low} {high}: {start} {end}");
            assert!(end - start <= 3.0 * (high - low).max(20.0), "{low} {high}: {start} {end}");
        }
        assert_eq!(nice_range(f64::NAN, 1.0, 20.0), (0.0, 20.0));
    }
}
