//! Two-sided quantiles of the normal distribution and of Student's t, and quantiles of Fisher's F.

use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor, Normal, StudentsT};

/// The size below which a fraction `level` of standard normal magnitudes lies.
pub(super) fn normal_quantile(level: f64) -> f64 {
    Normal::standard().inverse_cdf(0.5 + level / 2.0)
}

/// The size below which a fraction `level` of magnitudes with Student's t distribution lies.
pub fn student_quantile(level: f64, degrees_of_freedom: f64) -> f64 {
    /// Number of degrees above which the series is exact to 10⁻¹⁵. There, the distribution is too flat for a search
    /// for the quantile: it loses digits (three remain at 4·10⁶ degrees) and eventually does not terminate.
    const MANY: f64 = 1e5;
    if degrees_of_freedom > MANY {
        // Abramowitz & Stegun, 26.7.5.
        let (z, nu) = (normal_quantile(level), degrees_of_freedom);
        let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * nu * nu);
        return z + (z.powi(3) + z) / (4.0 * nu) + second;
    }
    let t = StudentsT::new(0.0, 1.0, degrees_of_freedom.max(1.0)).expect("one degree or more");
    t.inverse_cdf(0.5 + level / 2.0)
}

/// The value below which a fraction `level` of the ratios of two mean squares lies, with these degrees of freedom of
/// the numerator and of the denominator, one or more each. Infinity is possible for the denominator.
pub fn fisher_quantile(level: f64, numerator: f64, denominator: f64) -> f64 {
    /// Number of degrees from which on the mean square of the denominator counts as the exact variance.
    const MANY: f64 = 1e5;
    let numerator = numerator.clamp(1.0, MANY);
    if denominator >= MANY {
        let squares = ChiSquared::new(numerator).expect("one degree or more");
        return squares.inverse_cdf(level) / numerator;
    }
    let ratios = FisherSnedecor::new(numerator, denominator.max(1.0));
    ratios.expect("one degree or more each").inverse_cdf(level)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_of_mean_squares_have_the_quantiles_of_the_tables() {
        // Abramowitz & Stegun, table 26.9; four digits.
        for ((numerator, denominator), expected) in [
            ((1.0, 4.0), 12.22),
            ((3.0, 10.0), 4.826),
            ((10.0, 3.0), 14.42),
            ((40.0, 60.0), 1.744),
            ((3.0, f64::INFINITY), 3.116),
            ((60.0, f64::INFINITY), 1.388),
        ] {
            let found = fisher_quantile(0.975, numerator, denominator);
            assert!((found / expected - 1.0).abs() < 1e-3, "{numerator} {denominator}: {found}");
        }
        for numerator in [1.0, 7.0, 300.0, 1e7] {
            let [below, above] = [0.99999e5, 1e5].map(|of| fisher_quantile(0.975, numerator, of));
            assert!((below / above - 1.0).abs() < 1e-2, "{numerator}: {below} {above}");
        }
    }

    #[test]
    fn quantiles_equal_those_of_the_tables() {
        // Abramowitz & Stegun, tables 26.5 and 26.10.
        for (level, expected) in [(0.5, 0.67449), (0.95, 1.95996), (0.99, 2.57583)] {
            assert!((normal_quantile(level) - expected).abs() < 1e-5);
        }
        for (nu, expected) in [(1.0, 12.706), (4.0, 2.776), (10.0, 2.228), (120.0, 1.980)] {
            assert!((student_quantile(0.95, nu) - expected).abs() < 6e-4, "{nu}");
        }
        // Both methods agree where one replaces the other.
        let (below, above) = (student_quantile(0.95, 1e5), student_quantile(0.95, 1.00001e5));
        assert!((below - above).abs() < 1e-5, "{below} {above}");
        for nu in [2e5, 1e7, 1e12] {
            assert!(
                (student_quantile(0.95, nu) - 1.959_963_985 - 2.3723 / nu).abs() < 1e-9,
                "{nu}"
            );
        }
    }
}
