//! How figures are printed.

/// A length in cm, without digits that rounding made.
pub(super) fn cm(length_m: f64) -> String {
    let rounded = (length_m * 1e8).round() / 1e6;
    // Not −0.
    format!("{}", rounded + 0.0)
}

/// A share in %, without digits that rounding made.
pub(super) fn percent(share: f64) -> f64 {
    (share * 1e8).round() / 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_printed_without_rounding_noise() {
        assert_eq!([cm(2.0 * (0.05 - 0.01)), cm(-1e-12), cm(0.0255)], ["8", "0", "2.55"]);
        assert_eq!(percent(0.95), 95.0);
    }
}
