//! How far readings are from the curves: noise of the readings and play of the displacement.
//!
//! A reading is off by noise of its own, and because the reflector does not come to rest at the
//! same place twice (play, creep): where the curve is steep the second counts, on a plateau not.
//!
//! ```text
//! var(y − f) = σ² + τ²·(df/dq)²
//! ```
//!
//! Both variances are those of greatest likelihood for normal errors, found by fixed-point steps
//! that keep them positive (each is multiplied by the ratio of the two sides of its likelihood
//! equation). What the fitted parameters took from a residual is given back: its expected square
//! is `r² + gᵀCg`, with `C` the covariance of the parameters (Dempster, Laird & Rubin, J. R. Stat.
//! Soc. B 39, 1977).

use super::lanes::MOST_LANES;
use pulp::NullaryFnOnce;
use shell_data::instructions::arch;

/// Least variances, of a reading in units of its range: a thousandth squared, less than one count
/// of ten bits.
const LEAST: f64 = 1e-6;

/// The two variances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// `σ²`, in squared ranges of a channel.
    pub reading: f64,
    /// `τ²`, in squared units of q.
    pub displacement: f64,
}

/// A residual that the variances are estimated from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Residual {
    /// Its expected square.
    pub(super) square: f64,
    /// `(df/dq)²` there.
    pub(super) slope_square: f64,
}

impl Noise {
    /// Where an estimate begins: readings repeat to a fiftieth of their range, displacements to
    /// 0.15 units of q (of some 6 from plateau to plateau).
    pub(super) const START: Self = Self { reading: 4e-4, displacement: 0.0225 };

    /// The variance of an answer where the curve has this slope.
    #[inline]
    pub(crate) fn variance(&self, slope: f64) -> f64 {
        self.variance_at(slope * slope)
    }

    /// The variance of an answer where the curve has a slope of this square.
    #[inline]
    pub(super) fn variance_at(&self, slope_square: f64) -> f64 {
        slope_square.mul_add(self.displacement, self.reading)
    }

    /// The variances of greatest likelihood, `steps` fixed-point steps on from these.
    pub(super) fn refine(self, residuals: &[Vec<Residual>], steps: usize) -> Self {
        (0..steps).fold(self, |noise, _| {
            let mut sums = LikelihoodSums::default();
            for column in residuals {
                sums = arch().dispatch(Add { sums, noise, column });
            }
            let [a, b, c, d, e] = sums.0.map(|lanes| lanes.iter().sum::<f64>());
            let Self { reading, displacement } = noise;
            let next = |old: f64, found: f64, expected: f64| {
                if expected > 0.0 { (old * found / expected).max(LEAST) } else { old }
            };
            Self {
                reading: next(reading, d, a * reading + b * displacement),
                displacement: next(displacement, e, b * reading + c * displacement),
            }
        })
    }
}

/// Sums of `1`, `g`, `g²`, `r²` and `g·r²` over `v²`, with `g = (df/dq)²`, in interleaved lanes.
#[derive(Clone, Copy, Default)]
struct LikelihoodSums([[f64; MOST_LANES]; 5]);

/// Adds the residuals of a sensor, inlined whole into code for the widest vectors of the machine.
struct Add<'a> {
    sums: LikelihoodSums,
    noise: Noise,
    column: &'a [Residual],
}

impl NullaryFnOnce for Add<'_> {
    type Output = LikelihoodSums;

    #[inline(always)]
    fn call(self) -> LikelihoodSums {
        let Self { sums: LikelihoodSums(mut sums), noise, column } = self;
        let mut add = |lane: usize, &Residual { square, slope_square: g }: &Residual| {
            let variance = g.mul_add(noise.displacement, noise.reading);
            let weight = 1.0 / (variance * variance);
            let terms = [weight, weight * g, weight * g * g, weight * square, weight * g * square];
            sums.iter_mut().zip(terms).for_each(|(sum, term)| sum[lane] += term);
        };
        let (chunks, rest) = column.as_chunks::<MOST_LANES>();
        for chunk in chunks {
            chunk.iter().enumerate().for_each(|(lane, residual)| add(lane, residual));
        }
        rest.iter().enumerate().for_each(|(lane, residual)| add(lane, residual));
        LikelihoodSums(sums)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_variances_that_made_the_residuals() {
        let truth = Noise { reading: 3e-4, displacement: 0.01 };
        // Squares that are exactly as expected: the likelihood is then greatest at the truth.
        let residuals: Vec<Residual> = (0..100)
            .map(|i| f64::from(i) / 300.0)
            .map(|slope| Residual { square: truth.variance(slope), slope_square: slope * slope })
            .collect();
        let found = Noise::START.refine(&[residuals], 500);
        assert!((found.reading / truth.reading - 1.0).abs() < 1e-6, "{found:?}");
        assert!((found.displacement / truth.displacement - 1.0).abs() < 1e-6);
    }
}
