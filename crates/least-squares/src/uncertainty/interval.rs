//! Prediction intervals: the number of standard errors for a given coverage.
//!
//! For normal errors that is the quantile of Student's t. Where the model does not fit, such as at
//! a hard tap or an extreme pose, errors are far larger, and normal intervals cover too much (97 %
//! instead of 95 %, on the sensor model). Let `q(L)` be the size below which a share L of the
//! training errors lies, over their root mean square. The interval of level L is
//!
//! ```text
//! prediction ± q(L)·t_ν(L)/z(L)·se
//! ```
//!
//! with z and `t_ν` the two-sided quantiles of the normal distribution and of Student's t with ν
//! degrees of freedom. For normal errors `q = z`, which gives the textbook formula.

use super::group_intervals::TooFewGroups;
use super::quantile::normal_quantile;
use crate::magnitudes::Magnitudes;
use shell_data::wrench::PerAxis;

const LEVELS: [f64; 12] = [0.1, 0.25, 0.5, 0.683, 0.8, 0.9, 0.95, 0.975, 0.99, 0.995, 0.998, 0.999];

/// Highest level of an interval; higher ones would depend on a handful of rows.
pub const HIGHEST_LEVEL: f64 = 0.999;

#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NoIntervals {
    /// Rows of one pose are correlated: counted as observations, they would cover far too little.
    #[error(
        "no groups were held out, so an interval would be too narrow: rows of one pose are not independent"
    )]
    IndependentRows,
    #[error(transparent)]
    TooFewGroups(#[from] TooFewGroups),
}

/// Error sizes relative to their root mean square.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ErrorShape {
    /// Levels in ascending order, above 0 and below 1.
    pub levels: Vec<f64>,
    /// Size below which that fraction of the errors lies, for each axis and level.
    #[serde(with = "shell_data::by_axis")]
    pub quantiles: PerAxis<Vec<f64>>,
}

impl ErrorShape {
    /// Shape of sizes in units of `unit[axis]`; `rms` is their root mean square, in N and N·m.
    pub fn from_errors(
        sizes: &PerAxis<Magnitudes>,
        unit: &PerAxis<f64>,
        rms: &PerAxis<f64>,
    ) -> Self {
        let quantiles = std::array::from_fn(|axis| {
            let ratio = if rms[axis] > 0.0 { unit[axis] / rms[axis] } else { 0.0 };
            let quantiles = sizes[axis].quantiles(&LEVELS);
            quantiles.into_iter().map(|quantile| ratio * quantile).collect()
        });
        Self { levels: LEVELS.to_vec(), quantiles }
    }

    /// `q(level)` of an axis, interpolated linearly in the normal quantile between the levels.
    pub(super) fn quantile(&self, axis: usize, level: f64) -> f64 {
        let z = normal_quantile(level);
        let (mut below, mut at) = ((0.0, 0.0), (0.0, 0.0));
        for (&level, &size) in self.levels.iter().zip(&self.quantiles[axis]) {
            (below, at) = (at, (normal_quantile(level), size));
            if at.0 >= z {
                break;
            }
        }
        if z > at.0 {
            return at.1 * z / at.0;
        }
        below.1 + (at.1 - below.1) * (z - below.0) / (at.0 - below.0)
    }

    pub fn check(&self) -> Result<(), &'static str> {
        let mut levels = std::iter::once(&0.0).chain(&self.levels);
        let mut next = self.levels.iter();
        let ascending = next.all(|level| levels.next() < Some(level) && *level < 1.0);
        if self.levels.is_empty() || !ascending {
            return Err("`covariance.shape.levels` do not ascend between 0 and 1");
        }
        let fits = |sizes: &Vec<f64>| {
            sizes.len() == self.levels.len() && sizes.iter().all(|&size| size >= 0.0)
        };
        if !self.quantiles.iter().all(fits) {
            return Err("`covariance.shape.quantiles` are not one for each level, from zero up");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{CoefficientCovariance, Covariance};
    use super::*;

    fn covariance(shape: Option<ErrorShape>) -> Covariance {
        Covariance {
            residual: PerAxis::default(),
            degrees_of_freedom: 10,
            coefficients: CoefficientCovariance::Groups {
                groups: 11,
                factors: PerAxis::default(),
                degrees_of_freedom: None,
            },
            shape,
            shared: None,
            intervals: None,
        }
    }

    #[test]
    fn intervals_without_shape_or_with_normal_shape_are_students() {
        let mut sizes = PerAxis::<Magnitudes>::default();
        for i in 0..100_000 {
            let z = normal_quantile((f64::from(i) + 0.5) / 1e5);
            sizes.iter_mut().for_each(|sizes| sizes.add(z));
        }
        let normal = ErrorShape::from_errors(&sizes, &[0.3; 6], &[0.3; 6]);
        for level in [0.05, 0.3, 0.683, 0.93, 0.95, 0.999] {
            let plain = covariance(None).interval_factors(level).unwrap()[0];
            let shaped = covariance(Some(normal.clone())).interval_factors(level).unwrap()[5];
            // Bins of four parts in a thousand; interpolating a straight line is exact.
            assert!((shaped / plain - 1.0).abs() < 4e-3, "{level}: {shaped} {plain}");
        }
        assert!((covariance(None).interval_factors(0.95).unwrap()[0] - 2.228).abs() < 6e-4);
    }

    #[test]
    fn an_axis_without_errors_has_intervals_without_width() {
        let shape = ErrorShape::from_errors(&PerAxis::default(), &[1.0; 6], &[0.0; 6]);
        assert_eq!(covariance(Some(shape)).interval_factors(0.95), Ok([0.0; 6]));
    }

    #[test]
    fn inconsistent_shapes_are_refused() {
        let shape = ErrorShape { levels: vec![0.5, 0.9], quantiles: Default::default() };
        assert!(shape.check().unwrap_err().contains("quantiles"));
        let shape = ErrorShape { levels: vec![0.9, 0.5], quantiles: PerAxis::default() };
        assert!(shape.check().unwrap_err().contains("levels"));
        let quantiles = std::array::from_fn(|_| vec![1.0, 2.0]);
        assert_eq!(ErrorShape { levels: vec![0.5, 0.9], quantiles }.check(), Ok(()));
    }
}
